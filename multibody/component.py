"""The base class of every component: declarations collected, values checked, equations beside them."""

from __future__ import annotations

import difflib
import math
from typing import Any, ClassVar

import numpy as np

from multibody.declare import Declaration, Input, Option, Output, Parameter, Port, State, Table
from multibody.units import UnitError, quantity

__all__ = ["Component", "nearest"]


def nearest(word: str, known: Any) -> str:
    """Return a hint ``; did you mean 'x'?`` for a misspelt name, or an empty text.

    Examples
    --------
    >>> nearest("stifness", ["stiffness", "damping"])
    "; did you mean 'stiffness'?"
    """
    close = difflib.get_close_matches(word, [str(k) for k in known], n=1, cutoff=0.55)
    return f"; did you mean '{close[0]}'?" if close else ""


class Component:
    """A part of a machine: its parameters, states, signals, ports and equations.

    Subclasses declare these in the class body and write ``equations(self)`` in the subset of Python described in
    the docs ("Writing a component").  Values are given by keyword: parameters (number in SI, text such as
    ``"95 kg"``, or a pint quantity), start values of states, tables ``(x, y)`` and options.

    Examples
    --------
    >>> from multibody.library import Spring
    >>> Spring(stiffness="2 N/mm").values["stiffness"]
    2000.0
    """

    declarations: ClassVar[dict[str, Declaration]] = {}

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        collected: dict[str, Declaration] = {}
        for base in reversed(cls.__mro__):
            for name, item in vars(base).items():
                if isinstance(item, Declaration):
                    collected.pop(name, None)
                    collected[name] = item
                elif name in collected:  # a subclass may take a declaration away by setting it to None
                    del collected[name]
        cls.declarations = collected

    def __init__(self, **given: Any):
        self.values: dict[str, float] = {}
        self.tables: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self.options: dict[str, bool | int | str] = {}
        self.starts: dict[str, float] = {}
        self.faults: list[str] = []
        self._given = dict(given)
        starts = self.start_declarations()
        for name, item in self.declarations.items():
            if isinstance(item, Parameter):
                self._take_parameter(item, given.pop(name, item.default))
            elif isinstance(item, Table):
                self._take_table(item, given.pop(name, item.default))
            elif isinstance(item, Option):
                self._take_option(item, given.pop(name, item.default))
        for name, state in starts.items():
            self._take_number(self.starts, name, state.unit, given.pop(name, state.start), "start value")
        for name in given:
            settable = [*self.values, *self.tables, *self.options, *starts]
            self.faults.append(f"{type(self).__name__} has no parameter '{name}'{nearest(name, settable)}")

    @classmethod
    def of_kind(cls, kind: type[Any]) -> dict[str, Any]:
        """Return this class's declarations of one kind, by name."""
        return {name: item for name, item in cls.declarations.items() if isinstance(item, kind)}

    @classmethod
    def start_declarations(cls) -> dict[str, State]:
        """Return what may be given a start value: declared states, and position and rate of inertial flanges."""
        starts: dict[str, State] = dict(cls.of_kind(State))
        inertial = [port for port in cls.of_kind(Port).values() if getattr(port, "inertia", None)]
        for port in inertial:
            prefix = "" if len(inertial) == 1 else f"{port.name}_"
            starts[prefix + port.potential] = State(port.units[port.potential], f"{port.potential} at the start")
            starts[prefix + port.rate] = State(port.units[port.rate], f"{port.rate} at the start")
        return starts

    def _take_number(self, into: dict[str, float], name: str, unit: str, value: Any, what: str) -> None:
        try:
            number = quantity(value, unit)
        except (UnitError, TypeError, ValueError) as error:
            self.faults.append(f"{what} '{name}': {error}")
            return
        if not math.isfinite(number):
            self.faults.append(f"{what} '{name}' is {number}: give a finite number in {unit or 'plain units'}")
            return
        into[name] = number

    def _take_parameter(self, item: Parameter, value: Any) -> None:
        if value is None:
            self.faults.append(f"parameter '{item.name}' ({item.meaning}, {item.unit or '1'}) is required")
            return
        self._take_number(self.values, item.name, item.unit, value, "parameter")
        number = self.values.get(item.name)
        if number is not None and (fault := out_of_bounds(item, number)):
            self.faults.append(fault)

    def _take_table(self, item: Table, value: Any) -> None:
        if value is None:
            self.faults.append(f"table '{item.name}' ({item.meaning}) is required: give ({item.x_unit}, {item.unit})")
            return
        try:
            x, y = (np.ascontiguousarray(part, dtype=float) for part in value)
        except (TypeError, ValueError):
            self.faults.append(f"table '{item.name}' needs two sequences of numbers (x, y)")
            return
        if x.ndim != 1 or x.shape != y.shape or x.size < 2:
            self.faults.append(f"table '{item.name}' needs at least two points, as many x as y")
        elif not (np.all(np.isfinite(x)) and np.all(np.isfinite(y))):
            self.faults.append(f"table '{item.name}' has values that are not finite")
        elif not np.all(np.diff(x) > 0):
            row = int(np.argmax(np.diff(x) <= 0)) + 1
            self.faults.append(f"table '{item.name}': x must increase, but point {row} does not")
        else:
            self.tables[item.name] = (x, y)

    def _take_option(self, item: Option, value: Any) -> None:
        allowed = item.choices if item.choices is not None else ((True, False) if item.default in (True, False) else None)
        if type(value) is not type(item.default) or (allowed is not None and value not in allowed):
            hint = f"one of {', '.join(map(repr, allowed))}" if allowed else f"a {type(item.default).__name__}"
            self.faults.append(f"option '{item.name}' is {value!r}: give {hint} ({item.meaning})")
            return
        self.options[item.name] = value

    def copy(self, **changes: Any) -> Component:
        """Return a new component of the same class with some values replaced."""
        return type(self)(**{**self._given, **changes})

    def is_transmission(self) -> bool:
        """Tell whether the component ties the motion of its ports to each other."""
        return type(self).coupling is not Component.coupling

    def equations(self) -> None:
        """State the component's equations; read as text, never called."""

    def coupling(self) -> None:
        """State one port's position as a function of another's, for ideal transmissions; read as text."""

    def coupling_inverse(self) -> None:
        """State the same the other way round; read as text."""

    def __repr__(self) -> str:
        told = ", ".join(f"{k}={v:g}" for k, v in self.values.items())
        flags = ", ".join(f"{k}={v!r}" for k, v in self.options.items())
        return f"{type(self).__name__}({', '.join(part for part in (told, flags) if part)})"


def out_of_bounds(item: Parameter, number: float) -> str | None:
    """Return the fault of a number outside its parameter's bounds, or None."""
    if item.min is not None and number < item.min:
        return f"parameter '{item.name}' is {number:g} {item.unit}, below its least value {item.min:g}: {item.meaning}"
    if item.max is not None and number > item.max:
        return f"parameter '{item.name}' is {number:g} {item.unit}, above its largest value {item.max:g}: {item.meaning}"
    return None


SIGNALS = (Input, Output)
