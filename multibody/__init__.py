"""The modelling core: components, models, assembly, simulation."""

from multibody.component import Component
from multibody.declare import (
    Energy,
    Frame,
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
    Unknown,
)
from multibody.errors import EquationError, ModelError, SimulationError
from multibody.model import Model

__all__ = [
    "Component", "Energy", "EquationError", "Frame", "Input", "Model", "ModelError", "Option", "Output", "Parameter",
    "Pin", "Power", "Rotation", "SimulationError", "State", "Table", "Translation", "Unknown",
]
