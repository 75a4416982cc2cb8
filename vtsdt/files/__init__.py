"""Parameters of a lift and rail profiles, in memory and in files.

Takes from `multibody.base`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
