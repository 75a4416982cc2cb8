"""The virtual lift that writes recordings.

Takes from `vtsdt.lift` and `discrepancy.rigs`.  A study file names ``vtsdt.rig.models:build``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
