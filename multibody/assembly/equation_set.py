"""The equations of an assembled model as data: named quantities, statements, coordinates, inertias."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from multibody.base.parsing import parse
from multibody.equations.statements import Statement, variable

if TYPE_CHECKING:
    from multibody.assembly.dynamics import Contribution, Coordinate
    from multibody.assembly.places import Place

__all__ = ["Assembly", "Quantity", "Unknown", "statement"]


@dataclass(frozen=True)
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


@dataclass
class Assembly:
    """The equations of a model, still without an order.

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
        self.parameters.append(Quantity(name, unit, meaning, var, value, **bounds))
        return var

    def output(self, name: str, unit: str, meaning: str, var: str) -> None:
        """Add an output that shows a variable."""
        self.outputs.append(Quantity(name, unit, meaning, var))


def statement(text: str, origin: str) -> Statement:
    """Return one assignment, given as text, as a statement."""
    return Statement.parsed([parse(text).body[0]], origin)
