"""The guide's alignment from a few sensors of the cabin: ``vtsdt align``.

Takes from `vtsdt.lift`, `vtsdt.rig` and `estimation`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
