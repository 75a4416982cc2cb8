"""The modelling core: components, models, assembly, simulation."""

from multibody.base.errors import EquationError, ModelError, SimulationError
from multibody.declare.component import Component
from multibody.declare.declarations import (
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
from multibody.machine.model import Model

__all__ = [
    "Component", "Energy", "EquationError", "Frame", "Input", "Model", "ModelError", "Option", "Output", "Parameter",
    "Pin", "Power", "Rotation", "SimulationError", "State", "Table", "Translation", "Unknown",
]

#: Modules that stand in files of earlier versions, and where they are now (`multibody.base.references`).
MOVED = {
    "multibody.spatial.body": "multibody.declare.rigid_body",
}
