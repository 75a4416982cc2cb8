"""Finding the missing effect: compare, locate, explain, add, and watch the error fall.

`Study` runs the loop on a study file; `Problem` is what it starts from when a program has the model and the records
already.  `discrepancy.effects.kinds` is the catalogue of effects and `register` adds a kind of one's own.
"""

from __future__ import annotations

import warnings
from importlib import import_module
from typing import Any

__all__ = ["Effect", "Kind", "KindText", "Problem", "Study", "make_experiments", "register"]

_WHERE = {
    "Effect": "discrepancy.effects.effect",
    "Kind": "discrepancy.effects.kinds",
    "KindText": "discrepancy.effects.kinds",
    "Problem": "discrepancy.problem.problem",
    "Study": "discrepancy.study.study",
    "make_experiments": "discrepancy.problem.problem",
    "register": "discrepancy.effects.kinds",
}


#: Public names of earlier versions, and what they are called now.
_RENAMED = {"Setup": "Problem", "experiments_of": "make_experiments"}


def __getattr__(name: str) -> Any:
    """Load a public name when it is first asked for, so that importing the package stays light."""
    if name in _RENAMED:
        warnings.warn(f"discrepancy.{name} is now discrepancy.{_RENAMED[name]}", FutureWarning, stacklevel=2)
        name = _RENAMED[name]
    if name not in _WHERE:
        raise AttributeError(f"module 'discrepancy' has no attribute '{name}'")
    return getattr(import_module(_WHERE[name]), name)

#: Modules that stand in files of earlier versions, and where they are now (`multibody.base.references`).
MOVED = {
    "discrepancy.axis_model": "discrepancy.rigs.axis_model",
    "discrepancy.effect_laws": "discrepancy.effects.laws",
    "discrepancy.inverse_parts": "discrepancy.residual.inverse_parts",
    "discrepancy.sensor_parts": "discrepancy.effects.sensor_errors",
    "discrepancy.unknown_laws": "discrepancy.effects.uncatalogued_laws",
}
