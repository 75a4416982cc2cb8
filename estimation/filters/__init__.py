"""Kalman filters and smoothers for any compiled machine: states, unknown parameters, forces nobody measures.

A :class:`FilterModel` says what is measured and what is unknown, :class:`Samples` what was read,
:class:`Noise` and :class:`Prior` how much is trusted; :func:`extended` and :func:`unscented` filter,
``run.smooth()`` looks back, :func:`virtual_sensors` gives outputs that nobody measures,
:func:`consistency` and :func:`observability` say whether to believe it.
"""

from estimation.filters.consistency import Consistency, consistency, nees
from estimation.filters.errors import FilterDivergence, FilterError
from estimation.filters.extended import extended
from estimation.filters.latent import Latent, Matern32, OrnsteinUhlenbeck, RandomWalk
from estimation.filters.linear import LinearModel, kalman, rauch_tung_striebel
from estimation.filters.model import FilterModel
from estimation.filters.noise import Noise, Prior
from estimation.filters.observability import Observability, observability
from estimation.filters.run import Estimate, FilterRun, Smoothed
from estimation.filters.samples import Channel, Samples
from estimation.filters.smoother import smooth
from estimation.filters.tuning import Tuned, tune
from estimation.filters.unscented import unscented
from estimation.filters.virtual import VirtualSensors, virtual_sensors

__all__ = [
    "Channel",
    "Consistency",
    "Estimate",
    "FilterDivergence",
    "FilterError",
    "FilterModel",
    "FilterRun",
    "Latent",
    "LinearModel",
    "Matern32",
    "Noise",
    "Observability",
    "OrnsteinUhlenbeck",
    "Prior",
    "RandomWalk",
    "Samples",
    "Smoothed",
    "Tuned",
    "VirtualSensors",
    "consistency",
    "extended",
    "kalman",
    "nees",
    "observability",
    "rauch_tung_striebel",
    "smooth",
    "tune",
    "unscented",
    "virtual_sensors",
]
