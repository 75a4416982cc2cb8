from .alignment.estimate import align
from .alignment.result import Alignment
from .alignment.trips import AlignmentError, Trip, read_trips
from .cli.version import __version__
from .files.parameters import LiftParameters
from .files.rail_profile import RailProfile
from .files.rail_profile_table import ProfileTable
from .lift.comfort import RideComfort, ride_comfort
from .lift.energy import EnergyBalance, corrective_actions, energy_balance
from .lift.lift import Lift
from .lift.modes import ModesAlong, modes_along_run, modes_along_trip
from .rig.recordings import make_lift
from .rig.rig import LiftRig
from .whatif.result import WhatIf
from .whatif.study import what_if

MOVED: dict[str, str]

__all__ = [
    "Alignment",
    "AlignmentError",
    "EnergyBalance",
    "Lift",
    "LiftParameters",
    "LiftRig",
    "ModesAlong",
    "ProfileTable",
    "RailProfile",
    "RideComfort",
    "Trip",
    "WhatIf",
    "__version__",
    "align",
    "corrective_actions",
    "energy_balance",
    "make_lift",
    "modes_along_run",
    "modes_along_trip",
    "read_trips",
    "ride_comfort",
    "what_if",
]
