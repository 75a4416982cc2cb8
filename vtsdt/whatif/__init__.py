"""What straightening and lubricating the guides would save: ``vtsdt what-if``.

Takes from `vtsdt.lift` and `estimation`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
