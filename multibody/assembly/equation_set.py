"""The equations of an assembled model as data: named quantities, statements, coordinates, inertias."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from multibody.assembly.places import Place
from multibody.base.parsing import parse
from multibody.equations.statements import Statement, variable

__all__ = ["Assembly", "Contribution", "Coordinate", "Quantity", "Unknown", "owner_rank", "statement"]


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A named number of the assembled model: a state, an input, a parameter or an output."""

    name: str
    unit: str
    meaning: str
    variable: str
    value: float = 0.0
    min: float | None = None
    max: float | None = None


@dataclass(frozen=True)
class Unknown:
    """A quantity that an implicit equation determines: ``residual`` is zero at the right value of
    ``variable``.
    """

    name: str
    variable: str
    residual: str


@dataclass(frozen=True, kw_only=True)
class Coordinate:
    """An independent motion.

    Parameters
    ----------
    key : str
        Name by which contributions refer to it.
    name : str
        Name for messages.
    velocity, acceleration : str
        Variables.
    kind : {"free", "prescribed"}
        Whether the acceleration follows from the forces or is given; then ``reaction`` names the variable of
        the force that is needed.
    """

    key: str
    name: str
    velocity: str
    acceleration: str
    kind: str = "free"
    reaction: str | None = None


@dataclass(frozen=True, kw_only=True)
class Contribution:
    """Inertia and forces of one part, row by row, as texts over variables.

    Parameters
    ----------
    origin : str
        Component name.
    rows : tuple of dict
        For each row the factors J of the independent coordinates, by key; ``"1.0"`` and missing entries are
        known.
    mass : dict
        Entries ``(i, j)`` (both triangles) of the part's own mass matrix; empty for a massless part.
    bias : tuple of (str or None)
        Velocity-product acceleration of each row.
    force : tuple of (str or None)
        Force along each row.
    """

    origin: str
    rows: tuple[dict[str, str], ...]
    mass: dict[tuple[int, int], str] = field(default_factory=dict)
    bias: tuple[str | None, ...] = ()
    force: tuple[str | None, ...] = ()


@dataclass(kw_only=True)
class Assembly:
    """The equations of a model, not yet ordered.

    ``derivatives`` maps each state's variable to the variable of its rate.  ``renamed`` maps the port
    quantities of components to the node quantities they share.
    """

    name: str
    states: list[Quantity] = field(default_factory=list)
    inputs: list[Quantity] = field(default_factory=list)
    parameters: list[Quantity] = field(default_factory=list)
    outputs: list[Quantity] = field(default_factory=list)
    statements: list[Statement] = field(default_factory=list)
    derivatives: dict[str, str] = field(default_factory=dict)
    unknowns: list[Unknown] = field(default_factory=list)
    coordinates: list[Coordinate] = field(default_factory=list)
    contributions: list[Contribution] = field(default_factory=list)
    constants: dict[str, int] = field(default_factory=dict)
    kernels: dict[str, Callable[..., Any]] = field(default_factory=dict)
    places: list[Place] = field(default_factory=list)
    renamed: dict[str, str] = field(default_factory=dict)
    input_delays: dict[str, str] = field(default_factory=dict)
    kinetic: list[tuple[str, str]] = field(default_factory=list)
    potential: list[tuple[str, str]] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)

    def add(self, text: str, origin: str) -> None:
        """Add a statement given as text."""
        self.statements.append(statement(text, origin))

    def parameter(self, name: str, unit: str, meaning: str, value: float, **bounds: float | None) -> str:
        """Add a parameter and return its variable."""
        var = variable(name)
        self.parameters.append(Quantity(name=name, unit=unit, meaning=meaning, variable=var, value=value, **bounds))
        return var

    def output(self, name: str, unit: str, meaning: str, var: str) -> None:
        """Add an output that shows a variable."""
        self.outputs.append(Quantity(name=name, unit=unit, meaning=meaning, variable=var))


def statement(text: str, origin: str) -> Statement:
    """Return one assignment, given as text, as a statement."""
    return Statement.parsed([parse(text).body[0]], origin)


def owner_rank(name: str, order: list[str]) -> int:
    """Return the place of a quantity's component among the components, or their number when it has none."""
    owners = [k for k, owner in enumerate(order) if name.startswith(owner + ".")]
    return max(owners, key=lambda k: len(order[k])) if owners else len(order)
