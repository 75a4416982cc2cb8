from .estimate import align, balance, calibrated
from .filter import TUNINGS, GuideFilter, Tuning
from .rail import equivalent_deviation, pressing_deviation, rail_profile
from .result import Alignment
from .sections import Section
from .sensors import sensor_table
from .trips import AlignmentError, Trip, prepare, read_trips

__all__ = [
    "TUNINGS",
    "Alignment",
    "AlignmentError",
    "GuideFilter",
    "Section",
    "Trip",
    "Tuning",
    "align",
    "balance",
    "calibrated",
    "equivalent_deviation",
    "prepare",
    "pressing_deviation",
    "rail_profile",
    "read_trips",
    "sensor_table",
]
