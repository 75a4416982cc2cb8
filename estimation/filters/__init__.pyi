from .consistency import Consistency
from .errors import FilterDivergence, FilterError
from .estimation_error import Nees, nees
from .extended_kalman import extended_kalman_filter
from .latent import Latent, Matern32, OrnsteinUhlenbeck, RandomWalk
from .linear_kalman import LinearModel, kalman_filter, rauch_tung_striebel
from .model import FilterModel
from .noise import Noise, Prior
from .observability_gramian import Observability, observability
from .online import OnlineFilter
from .online_state import OnlineState
from .run import Estimate, FilterRun, Smoothed
from .samples import FilterSamples, TimeSeries
from .tuning import Tuned, tune
from .unscented_kalman import unscented_kalman_filter
from .virtual import VirtualSensors, virtual_sensors

__all__ = [
    "Consistency",
    "Estimate",
    "FilterDivergence",
    "FilterError",
    "FilterModel",
    "FilterRun",
    "FilterSamples",
    "Latent",
    "LinearModel",
    "Matern32",
    "Nees",
    "Noise",
    "Observability",
    "OnlineFilter",
    "OnlineState",
    "OrnsteinUhlenbeck",
    "Prior",
    "RandomWalk",
    "Smoothed",
    "TimeSeries",
    "Tuned",
    "VirtualSensors",
    "extended_kalman_filter",
    "kalman_filter",
    "nees",
    "observability",
    "rauch_tung_striebel",
    "tune",
    "unscented_kalman_filter",
    "virtual_sensors",
]
