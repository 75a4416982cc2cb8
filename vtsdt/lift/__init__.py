"""The lift: its model, its trips, and their analyses: energy, modes, reduction, ride comfort, pictures.

Takes from `vtsdt.parts` and `vtsdt.files`.  A study file names ``vtsdt.lift:reference`` and its like.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
