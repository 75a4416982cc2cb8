from .compare import TripComparison, compare_trips, read_measured_trips
from .result import Interval, WhatIf
from .run import run_what_if
from .settings import Settings, read_settings
from .study import Uncertainty, default_uncertainties, what_if
from .threshold import Configuration, Threshold, configuration_of, threshold_of

__all__ = [
    "Configuration",
    "Interval",
    "Settings",
    "Threshold",
    "TripComparison",
    "Uncertainty",
    "WhatIf",
    "compare_trips",
    "configuration_of",
    "default_uncertainties",
    "read_measured_trips",
    "read_settings",
    "run_what_if",
    "threshold_of",
    "what_if",
]
