"""The declarations in a component class: parameters, states, signals, ports and options."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

__all__ = [
    "Declaration",
    "Energy",
    "FlowPort",
    "FluidPort",
    "Frame",
    "HeatPort",
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
    """Base of everything that can be declared in a component class.

    ``when`` is a condition on one of the component's options, such as ``"lossy"``, ``"not lossy"`` or
    ``"order >= 2"``; where it is false, the declaration does not exist.
    """

    name: str = field(default="", init=False, compare=False)
    when: str = field(default="", kw_only=True)

    def __set_name__(self, owner: type, name: str) -> None:
        object.__setattr__(self, "name", name)

    def brings(self) -> dict[str, Declaration]:
        """Return further declarations that this one adds, by name."""
        return {}


@dataclass(frozen=True)
class Parameter(Declaration):
    """A number that stays constant during a simulation.

    Parameters
    ----------
    default : float or None
        Default value; None makes the parameter required.
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
        Default points ``(x, y)``.
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

    One controller or filter then serves signals of any kind, and every connection is still checked.
    """

    default: str
    meaning: str


@dataclass(frozen=True)
class State(Declaration):
    """A quantity that is integrated; its equation is ``self.der.<name> = ...``.

    Its bounds say where it has a meaning: start values are held to them, and another tool is told of them.
    """

    unit: str
    meaning: str
    start: float = 0.0
    min: float | None = None
    max: float | None = None


@dataclass(frozen=True)
class Unknown(Declaration):
    """A quantity that an implicit equation determines at every instant: ``self.zero.<name> = ...`` vanishes."""

    unit: str
    meaning: str


@dataclass(frozen=True)
class Input(Declaration):
    """An input signal; without a default it has to be connected."""

    unit: str
    meaning: str
    default: float | None = None


@dataclass(frozen=True)
class Output(Declaration):
    """An output signal; it can be connected to inputs and is recorded in trajectories."""

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

    ``kind`` is ``"loss"`` (dissipated, positive when lost) or ``"supply"`` (supplied from outside).
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
        Name of the parameter (kg) by which the component resists acceleration of this flange, or of an output that
        its equations compute from parameters alone.
    prescribed : bool
        True when the component's equations give the flange its position, velocity and acceleration.
    coordinate : str, optional
        Name of the free motion of a rigid body that this flange is; the body's equations bring the inertia.
    """

    inertia: str | None = None
    prescribed: bool = False
    coordinate: str | None = None

    domain: ClassVar[str] = "translation"
    potential: ClassVar[str] = "position"
    rate: ClassVar[str] = "velocity"
    flow: ClassVar[str] = "force"
    units: ClassVar[dict[str, str]] = {
        "position": "m",
        "velocity": "m/s",
        "acceleration": "m/s**2",
        "force": "N",
        "reaction": "N",
    }


@dataclass(frozen=True)
class Rotation(Port):
    """A flange that turns about an axis: ``angle``, ``speed``, ``acceleration`` shared, ``torque`` exerted on it.

    Parameters
    ----------
    meaning : str
        One line.
    inertia : str, optional
        Name of the parameter (kg m²) by which the component resists angular acceleration of this flange, or of an
        output that its equations compute from parameters alone.
    prescribed : bool
        True when the component's equations give the flange its angle, speed and acceleration.
    coordinate : str, optional
        Name of the free motion of a rigid body that this flange is; the body's equations bring the inertia.
    """

    inertia: str | None = None
    prescribed: bool = False
    coordinate: str | None = None

    domain: ClassVar[str] = "rotation"
    potential: ClassVar[str] = "angle"
    rate: ClassVar[str] = "speed"
    flow: ClassVar[str] = "torque"
    units: ClassVar[dict[str, str]] = {
        "angle": "rad",
        "speed": "rad/s",
        "acceleration": "rad/s**2",
        "torque": "N*m",
        "reaction": "N*m",
    }
    generic: ClassVar[dict[str, str]] = {"position": "angle", "velocity": "speed", "force": "torque"}


@dataclass(frozen=True)
class FlowPort(Port):
    """A terminal that does not move: a potential is shared, and a flow goes from the node into the component.

    Parameters
    ----------
    meaning : str
        One line.
    prescribed : bool
        True when the component's equations give the node its potential; ``reaction`` is then what flows into the
        node from this component.
    """

    prescribed: bool = False


@dataclass(frozen=True)
class Pin(FlowPort):
    """An electrical terminal: ``voltage`` shared, ``current`` flows from the node into the component."""

    domain: ClassVar[str] = "electrical"
    potential: ClassVar[str] = "voltage"
    rate: ClassVar[str] = ""
    flow: ClassVar[str] = "current"
    units: ClassVar[dict[str, str]] = {"voltage": "V", "current": "A", "reaction": "A"}


@dataclass(frozen=True)
class FluidPort(FlowPort):
    """A connection of a pipe: ``pressure`` above ambient shared, ``volume_flow`` from the node into the component."""

    domain: ClassVar[str] = "fluid"
    potential: ClassVar[str] = "pressure"
    rate: ClassVar[str] = ""
    flow: ClassVar[str] = "volume_flow"
    units: ClassVar[dict[str, str]] = {"pressure": "Pa", "volume_flow": "m**3/s", "reaction": "m**3/s"}


@dataclass(frozen=True)
class HeatPort(FlowPort):
    """A place where heat passes: ``temperature`` (absolute) shared, ``heat_flow`` from the node into the component."""

    domain: ClassVar[str] = "thermal"
    potential: ClassVar[str] = "temperature"
    rate: ClassVar[str] = ""
    flow: ClassVar[str] = "heat_flow"
    units: ClassVar[dict[str, str]] = {"temperature": "K", "heat_flow": "W", "reaction": "W"}


@dataclass(frozen=True)
class Frame(Port):
    """A point and directions fixed to a rigid body, where spatial forces and moments act.

    Shared by all that is connected, in world axes: position ``px py pz``, rotation matrix ``r11 … r33`` (its columns
    are the frame's axes), velocity ``vx vy vz``, angular velocity ``wx wy wz``, acceleration ``ax ay az``, angular
    acceleration ``alx aly alz``, and gravity ``gx gy gz``.  ``fx fy fz`` and ``mx my mz`` are the force and the moment
    that this component exerts on the frame, world axes, the force at the frame's point.

    Parameters
    ----------
    meaning : str
        One line.
    offset : tuple, optional
        Given by a component that holds the frame: its position in body axes (in world axes on the ground).  Each of
        the three entries is a number (the default of a parameter ``<name>_x``, ``_y`` or ``_z`` that the frame adds),
        the name of a declared parameter (with a minus before it if need be), or None for zero.
    angles : tuple
        Roll, pitch and yaw of the frame against the body in the same manner (``<name>_roll``, …).
    parent : bool
        True for the frame by which a rigid body is attached to its parent.
    """

    offset: tuple[float | str | None, ...] | None = None
    angles: tuple[float | str | None, ...] = (None, None, None)
    parent: bool = False

    domain: ClassVar[str] = "frame"
    flows: ClassVar[tuple[str, ...]] = ("fx", "fy", "fz", "mx", "my", "mz")
    motions: ClassVar[tuple[str, ...]] = (
        *(f"{what}{axis}" for what in ("p", "v", "w", "a", "al", "g") for axis in "xyz"),
        *(f"r{i}{j}" for i in "123" for j in "123"),
    )
    units: ClassVar[dict[str, str]] = {
        f"{what}{axis}": unit
        for what, unit in (
            ("p", "m"),
            ("v", "m/s"),
            ("w", "rad/s"),
            ("a", "m/s**2"),
            ("al", "rad/s**2"),
            ("g", "m/s**2"),
            ("f", "N"),
            ("m", "N*m"),
        )
        for axis in "xyz"
    } | {f"r{i}{j}": "1" for i in "123" for j in "123"}

    @property
    def offset_names(self) -> tuple[str | None, ...]:
        """Names of the parameters of the offset, None for zero."""
        return self._names(self.offset or (None, None, None), ("x", "y", "z"))

    @property
    def angle_names(self) -> tuple[str | None, ...]:
        """Names of the parameters of roll, pitch and yaw, None for zero."""
        return self._names(self.angles, ("roll", "pitch", "yaw"))

    def _names(self, entries: tuple[float | str | None, ...], kinds: tuple[str, ...]) -> tuple[str | None, ...]:
        return tuple(
            e if e is None or isinstance(e, str) else f"{self.name}_{kind}"
            for e, kind in zip(entries, kinds, strict=True)
        )

    def brings(self) -> dict[str, Declaration]:
        """Return the parameters of the frame's position and attitude on the body."""
        what = self.meaning or "frame"
        numbers = [*zip(self.offset_names, self.offset or (), ["m"] * 3, "xyz", strict=False)]
        numbers += zip(self.angle_names, self.angles, ["rad"] * 3, ("roll", "pitch", "yaw"), strict=True)
        parameters: dict[str, Declaration] = {}
        for name, default, unit, kind in numbers:
            if name is not None and not isinstance(default, str):
                item = Parameter(default, unit, f"{kind} of the {what} on the body", when=self.when)
                object.__setattr__(item, "name", name)
                parameters[name] = item
        return parameters
