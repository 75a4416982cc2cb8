"""The gear stage as a model, how it is run, and what may be wrong with it.

From here users import `GearStage`, `simulate` and `build`; they are imported on first use.  Takes from `gearbox.parts`,
`gearbox.signals` and `gearbox.files`.
"""

import warnings

import lazy_loader

_attribute, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """Import a public name on first use; `Stage` is the former name of `GearStage`."""
    if name == "Stage":
        warnings.warn("gearbox.stage.Stage is now GearStage: use the new name", FutureWarning, stacklevel=2)
        name = "GearStage"
    return _attribute(name)
