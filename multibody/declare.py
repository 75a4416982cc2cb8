"""What a component class declares beside its equations: parameters, states, signals, ports and options."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

__all__ = [
    "Declaration",
    "Energy",
    "Frame",
    "Input",
    "Option",
    "Output",
    "Parameter",
    "Pin",
    "Port",
    "Power",
    "Rotation",
    "State",
    "Table",
    "Translation",
    "Unit",
    "Unknown",
]


@dataclass(frozen=True)
class Declaration:
    """Base of everything that can stand in the body of a component class.

    ``when`` is a condition on one of the component's options, such as ``"lossy"``, ``"not lossy"`` or
    ``"order >= 2"``: where it does not hold the declaration does not exist.
    """

    name: str = field(default="", init=False, compare=False)
    when: str = field(default="", kw_only=True)

    def __set_name__(self, owner: type, name: str) -> None:
        object.__setattr__(self, "name", name)


@dataclass(frozen=True)
class Parameter(Declaration):
    """A number that stays constant during a simulation.

    Parameters
    ----------
    default : float or None
        Value when none is given; None makes the parameter required.
    unit : str
        SI unit.
    meaning : str
        One line for tables and error messages.
    min, max : float, optional
        Bounds, both included.
    """

    default: float | None
    unit: str
    meaning: str
    min: float | None = None
    max: float | None = None


@dataclass(frozen=True)
class Table(Declaration):
    """A curve given by points, called in equations as ``self.profile(x)``; constant beyond its ends.

    Parameters
    ----------
    x_unit, unit : str
        SI units of the argument and of the value.
    meaning : str
        One line for tables and error messages.
    interpolation : {"linear", "cubic"}
        ``"cubic"`` is the shape-preserving cubic (PCHIP).
    default : tuple of two sequences, optional
        Points ``(x, y)`` when none are given.
    """

    x_unit: str
    unit: str
    meaning: str
    interpolation: str = "linear"
    default: tuple[Any, Any] | None = None


@dataclass(frozen=True)
class Option(Declaration):
    """A choice of structure (True/False, a whole number or a word): it decides which equations exist."""

    default: bool | int | str
    meaning: str
    choices: tuple[Any, ...] | None = None


@dataclass(frozen=True)
class Unit(Declaration):
    """A unit that each instance chooses; other declarations use it in theirs, as in ``"{signal}/s"``.

    It lets one controller or filter serve signals of any kind while every connection is still checked.
    """

    default: str
    meaning: str


@dataclass(frozen=True)
class State(Declaration):
    """A quantity that is integrated; its equation is ``self.der.<name> = ...``."""

    unit: str
    meaning: str
    start: float = 0.0


@dataclass(frozen=True)
class Unknown(Declaration):
    """A quantity that an implicit equation determines at every instant: ``self.zero.<name> = ...`` vanishes."""

    unit: str
    meaning: str


@dataclass(frozen=True)
class Input(Declaration):
    """A signal that comes in; without a default it has to be connected."""

    unit: str
    meaning: str
    default: float | None = None


@dataclass(frozen=True)
class Output(Declaration):
    """A signal that goes out; it can be connected to inputs and is recorded in trajectories."""

    unit: str
    meaning: str


@dataclass(frozen=True)
class Energy(Output):
    """An output that counts as energy stored in the component, in J."""

    unit: str = "J"
    meaning: str = "energy stored"


@dataclass(frozen=True)
class Power(Output):
    """An output that counts in the energy balance, in W.

    ``kind`` is ``"loss"`` (turned into heat, positive when lost) or ``"supply"`` (brought in from outside).
    """

    kind: str = "loss"
    unit: str = "W"
    meaning: str = "power turned into heat"


@dataclass(frozen=True)
class Port(Declaration):
    """A point where components meet: they share its potential, and the flows at it sum to zero."""

    meaning: str = ""

    domain: ClassVar[str] = ""
    potential: ClassVar[str] = ""
    rate: ClassVar[str] = ""
    flow: ClassVar[str] = ""
    units: ClassVar[dict[str, str]] = {}
    #: names under which a law written for both domains finds this domain's quantities
    generic: ClassVar[dict[str, str]] = {}


@dataclass(frozen=True)
class Translation(Port):
    """A flange that moves along a line.

    ``position``, ``velocity`` and ``acceleration`` are shared by all that is connected; ``force`` is the force
    that this component exerts on the flange.

    Parameters
    ----------
    meaning : str
        One line.
    inertia : str, optional
        Name of the parameter (kg) by which the component resists acceleration of this flange.
    prescribed : bool
        True when the component's equations give the flange its position, velocity and acceleration.
    """

    inertia: str | None = None
    prescribed: bool = False

    domain: ClassVar[str] = "translation"
    potential: ClassVar[str] = "position"
    rate: ClassVar[str] = "velocity"
    flow: ClassVar[str] = "force"
    units: ClassVar[dict[str, str]] = {
        "position": "m", "velocity": "m/s", "acceleration": "m/s**2", "force": "N", "reaction": "N",
    }


@dataclass(frozen=True)
class Rotation(Port):
    """A flange that turns about an axis: ``angle``, ``speed``, ``acceleration`` shared, ``torque`` exerted on it.

    Parameters
    ----------
    meaning : str
        One line.
    inertia : str, optional
        Name of the parameter (kg m²) by which the component resists angular acceleration of this flange.
    prescribed : bool
        True when the component's equations give the flange its angle, speed and acceleration.
    """

    inertia: str | None = None
    prescribed: bool = False

    domain: ClassVar[str] = "rotation"
    potential: ClassVar[str] = "angle"
    rate: ClassVar[str] = "speed"
    flow: ClassVar[str] = "torque"
    units: ClassVar[dict[str, str]] = {
        "angle": "rad", "speed": "rad/s", "acceleration": "rad/s**2", "torque": "N*m", "reaction": "N*m",
    }
    generic: ClassVar[dict[str, str]] = {"position": "angle", "velocity": "speed", "force": "torque"}


@dataclass(frozen=True)
class Pin(Port):
    """An electrical terminal: ``voltage`` shared, ``current`` flows from the node into the component."""

    prescribed: bool = False

    domain: ClassVar[str] = "electrical"
    potential: ClassVar[str] = "voltage"
    rate: ClassVar[str] = ""
    flow: ClassVar[str] = "current"
    units: ClassVar[dict[str, str]] = {"voltage": "V", "current": "A", "reaction": "A"}


@dataclass(frozen=True)
class Frame(Port):
    """A point and directions fixed to a rigid body, where spatial forces and moments act."""

    domain: ClassVar[str] = "frame"
    units: ClassVar[dict[str, str]] = {}
