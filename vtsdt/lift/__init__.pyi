from .comfort import ComfortError, RideComfort, peak_to_peak, ride_comfort
from .energy import EnergyBalance, TripEnergy, corrective_actions, energy_balance
from .lift import Lift, cabin, one_dimensional, reference
from .model import LiftModel, Structure
from .modes import Modes, ModesAlong, modes_along_run, modes_along_trip
from .pictures import animate_trip, diagram, mode_shapes, trip_strip
from .reduction import Reduction, cabin_against_reference, one_dimensional_against_reference

__all__ = [
    "ComfortError",
    "EnergyBalance",
    "Lift",
    "LiftModel",
    "Modes",
    "ModesAlong",
    "Reduction",
    "RideComfort",
    "Structure",
    "TripEnergy",
    "animate_trip",
    "cabin",
    "cabin_against_reference",
    "corrective_actions",
    "diagram",
    "energy_balance",
    "mode_shapes",
    "modes_along_run",
    "modes_along_trip",
    "one_dimensional",
    "one_dimensional_against_reference",
    "peak_to_peak",
    "reference",
    "ride_comfort",
    "trip_strip",
]
