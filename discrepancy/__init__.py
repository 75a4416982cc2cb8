"""Missing effects: compare a model with records, locate its error, explain it, add effects, and conclude.

`Study.from_file` reads a study file and `Study.diagnose` searches; `Problem` is for programs that have model and
records already, and `register` adds a kind to the catalogue of effects.  The public names stand in ``__init__.pyi`` and
are imported on first use.  Takes from `estimation` and `multibody`.
"""

import warnings
from typing import Any

import lazy_loader

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

#: Public names of earlier versions, and what they are called now.
RENAMED = {"Setup": "Problem", "experiments_of": "make_experiments"}


def __getattr__(name: str) -> Any:
    """Import a public name on first use; warn where it is the name of an earlier version."""
    if name in RENAMED:
        warnings.warn(f"discrepancy.{name} is now discrepancy.{RENAMED[name]}", FutureWarning, stacklevel=2)
        name = RENAMED[name]
    return _public(name)


#: Modules that stand in files of earlier versions, and where they are now (`multibody.base.references`).
MOVED = {
    "discrepancy.axis_model": "discrepancy.rigs.axis_model",
    "discrepancy.effect_laws": "discrepancy.effects.laws",
    "discrepancy.inverse_parts": "discrepancy.residual.recorded_motion",
    "discrepancy.sensor_parts": "discrepancy.effects.sensor_errors",
    "discrepancy.unknown_laws": "discrepancy.effects.uncatalogued_laws",
}
