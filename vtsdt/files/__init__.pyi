from .parameters import (
    BodyParameters,
    ControlParameters,
    GuideParameters,
    HoistwayParameters,
    LiftParameters,
    MotorParameters,
    PulleyParameters,
    RopeParameters,
    SupportParameters,
    TripParameters,
)
from .rail_profile import RailProfile
from .rail_profile_table import ProfileTable

__all__ = [
    "BodyParameters",
    "ControlParameters",
    "GuideParameters",
    "HoistwayParameters",
    "LiftParameters",
    "MotorParameters",
    "ProfileTable",
    "PulleyParameters",
    "RailProfile",
    "RopeParameters",
    "SupportParameters",
    "TripParameters",
]
