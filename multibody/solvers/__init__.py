"""Compiled integrators behind SciPy's extension point `OdeSolver`, and what they integrate.

Modules with a function of their own name are imported by path: ``from multibody.solvers.batch import batch``,
``from multibody.solvers.state_transition import state_transition_matrices``.
"""

from __future__ import annotations

import importlib
from typing import Any

_PLACES = {
    "Automatic": "automatic",
    "DormandPrince54": "dormand_prince",
    "Directions": "problem",
    "Exponential43": "exponential",
    "NativeProblem": "problem",
    "Rodas5P": "rosenbrock",
    "ProblemError": "problem",
    "Run": "batch",
    "Samples": "base",
    "StateTransitionMatrices": "state_transition",
    "choose_method": "choose",
    "spectral_radius": "choose",
    "integrate": "run",
}

__all__ = sorted(_PLACES)


def __getattr__(name: str) -> Any:
    if name in _PLACES:
        return getattr(importlib.import_module(f"multibody.solvers.{_PLACES[name]}"), name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
