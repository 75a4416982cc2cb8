from .comparison import OptimiserComparison, compare_optimisers
from .evaluation import evaluate
from .firefly import FireflySettings
from .fitting import RankDeficiencyError, fit_response_surface, surface_study
from .optimisation_result import OptimisationResult, StopReason
from .optimise import METHODS, local_maxima, maximise
from .polynomial import Terms, polynomial_terms
from .quality import FitQuality, TestQuality
from .response_surface import ResponseSurface
from .sampling import Design, latin_hypercube
from .sensitivity import MorrisResult, OneAtATimeResult, morris, one_at_a_time
from .space import DesignSpace, SurrogateWarning
from .variance import SobolResult, sobol

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
