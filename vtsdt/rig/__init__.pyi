from .one_dimensional import PlainLiftRig
from .rails import RailSpectrum
from .recordings import make_configurations, make_lift
from .rig import LiftRig

__all__ = [
    "LiftRig",
    "PlainLiftRig",
    "RailSpectrum",
    "make_configurations",
    "make_lift",
]
