from .car import Accelerometer, Car, Hoist
from .control import FieldOrientedControl
from .guide import GuidingSystem
from .machine import GearedPMSM, MachineSupport
from .rope import DrivingPulley, Ropes

__all__ = [
    "Accelerometer",
    "Car",
    "DrivingPulley",
    "FieldOrientedControl",
    "GearedPMSM",
    "GuidingSystem",
    "Hoist",
    "MachineSupport",
    "Ropes",
]
