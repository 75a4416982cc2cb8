from .faults import FAULTS, Fault, FaultKind, combined, damageable, fault
from .model import GearModel, Structure
from .stage import GearStage, build, simulate

__all__ = [
    "FAULTS",
    "Fault",
    "FaultKind",
    "GearModel",
    "GearStage",
    "Structure",
    "build",
    "combined",
    "damageable",
    "fault",
    "simulate",
]
