"""The modelling core: components and their equations, models put together from them, simulation and linearisation.

From here users import `Component` and what it declares, `Model`, `System` and the results of its analyses; components
that ship with the package are in `multibody.library`.  The public names stand in ``__init__.pyi`` and are imported on
first use.  Takes from no other package.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

#: Modules that stand in files of earlier versions, and where they are now (`multibody.base.references`).
MOVED = {
    "multibody.spatial.body": "multibody.declare.rigid_body",
}
