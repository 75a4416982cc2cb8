from .base.errors import EquationError, ModelError, SimulationError
from .declare.component import Component
from .declare.declarations import (
    Energy,
    FlowPort,
    FluidPort,
    Frame,
    HeatPort,
    Input,
    Option,
    Output,
    Parameter,
    Pin,
    Power,
    Rotation,
    State,
    Table,
    Translation,
    Unit,
    Unknown,
)
from .machine.model import Model, System
from .machine.run_many import Outcome, run_many, simulate_many
from .system.equilibrium import Equilibrium
from .system.linearize import Linearization
from .system.trajectory import Trajectory

__all__ = [
    "Component",
    "Energy",
    "EquationError",
    "Equilibrium",
    "FlowPort",
    "FluidPort",
    "Frame",
    "HeatPort",
    "Input",
    "Linearization",
    "Model",
    "ModelError",
    "Option",
    "Outcome",
    "Output",
    "Parameter",
    "Pin",
    "Power",
    "Rotation",
    "SimulationError",
    "State",
    "System",
    "Table",
    "Trajectory",
    "Translation",
    "Unit",
    "Unknown",
    "run_many",
    "simulate_many",
]

MOVED: dict[str, str]
