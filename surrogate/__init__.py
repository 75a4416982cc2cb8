"""Stand-ins for expensive models: sampling plans, sensitivity, polynomial response surfaces, optimisation.

Nothing here knows what the model is: a function takes parameter values and returns one number (a similarity,
a misfit, an output), and a :class:`DesignSpace` says what the parameters are called, their units and bounds.
Everything is loaded when it is first asked for, so that importing the package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .comparison import OptimiserComparison, compare_optimisers
    from .evaluation import evaluate
    from .firefly import FireflySettings
    from .fitting import RankDeficiencyError, fit_response_surface, surface_study
    from .optimise import METHODS, local_maxima, maximise
    from .outcome import OptimisationResult, StopReason
    from .polynomial import Terms, polynomial_terms
    from .quality import FitQuality, TestQuality
    from .response_surface import ResponseSurface
    from .sampling import Design, latin_hypercube
    from .sensitivity import MorrisResult, OneAtATimeResult, morris, one_at_a_time
    from .space import DesignSpace, SurrogateWarning
    from .variance import SobolResult, sobol

_HOME = {
    "DesignSpace": "space",
    "SurrogateWarning": "space",
    "Design": "sampling",
    "latin_hypercube": "sampling",
    "evaluate": "evaluation",
    "Terms": "polynomial",
    "polynomial_terms": "polynomial",
    "FitQuality": "quality",
    "TestQuality": "quality",
    "ResponseSurface": "response_surface",
    "RankDeficiencyError": "fitting",
    "fit_response_surface": "fitting",
    "surface_study": "fitting",
    "one_at_a_time": "sensitivity",
    "OneAtATimeResult": "sensitivity",
    "morris": "sensitivity",
    "MorrisResult": "sensitivity",
    "sobol": "variance",
    "SobolResult": "variance",
    "FireflySettings": "firefly",
    "METHODS": "optimise",
    "maximise": "optimise",
    "local_maxima": "optimise",
    "OptimisationResult": "outcome",
    "StopReason": "outcome",
    "compare_optimisers": "comparison",
    "OptimiserComparison": "comparison",
}

__all__ = [
    "METHODS",
    "Design",
    "DesignSpace",
    "FireflySettings",
    "FitQuality",
    "MorrisResult",
    "OneAtATimeResult",
    "OptimisationResult",
    "OptimiserComparison",
    "RankDeficiencyError",
    "ResponseSurface",
    "SobolResult",
    "StopReason",
    "SurrogateWarning",
    "Terms",
    "TestQuality",
    "compare_optimisers",
    "evaluate",
    "fit_response_surface",
    "latin_hypercube",
    "local_maxima",
    "maximise",
    "morris",
    "one_at_a_time",
    "polynomial_terms",
    "sobol",
    "surface_study",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"surrogate has no '{name}'; it has {', '.join(__all__)}")
    return getattr(import_module(f".{_HOME[name]}", __name__), name)


def __dir__() -> list[str]:
    return __all__
