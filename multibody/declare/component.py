"""The base class of every component: it collects the declarations and checks the values."""

from __future__ import annotations

import dataclasses
import math
import operator
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar

import numpy as np

from multibody.base.spelling import nearest, nearest_or_choices
from multibody.base.units import UnitError, quantity, same_dimension
from multibody.declare.declarations import Declaration, Option, Parameter, Port, State, Table, Unit
from multibody.declare.signature import DocstringOfDeclarations, SignatureOfDeclarations, written_docstring
from multibody.declare.source_text import remember

__all__ = ["Component"]

_COMMON_UNITS = frozenset(
    ("", "1", "m", "m/s", "m/s**2", "rad", "rad/s", "rad/s**2", "N", "N*m", "A", "V", "W", "J", "kg", "s", "Hz")
)
_COMPARE = {">=": operator.ge, ">": operator.gt, "==": operator.eq, "<": operator.lt, "<=": operator.le}


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

    declarations: dict[str, Declaration] = {}  # noqa: RUF012 - an instance whose options or units decide has its own

    #: Narrow features that no step may jump over: ``{width: speed}``.  The width is a parameter, a table (the least
    #: distance of its points) or an output; the speed is the output at which the feature passes, or ``"time"``.
    features: ClassVar[dict[str, str]] = {}

    #: Whether the equations call what only Python can: a model with such a component is not compiled.
    only_python: bool = False

    #: Whether the component cannot be integrated and takes steps from sample to sample itself (`stepped_run`).
    steps_itself: bool = False

    #: Parameters whose unit, and tables whose argument's unit, an option decides: their dimension is not checked.
    units_by_option: ClassVar[tuple[str, ...]] = ()

    #: Names of states in their order; those that are not named here follow.
    state_order: ClassVar[tuple[str, ...]] = ()

    __signature__ = SignatureOfDeclarations()

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        remember(cls.__module__)
        collected: dict[str, Declaration] = {}
        for base in reversed(cls.__mro__):
            for name, item in vars(base).items():
                if isinstance(item, Declaration):
                    collected.pop(name, None)
                    collected[name] = item
                    collected.update({n: extra for n, extra in item.brings().items() if n not in vars(base)})
                elif name in collected:  # a subclass may remove a declaration by setting it to None
                    del collected[name]
        cls.declarations = collected
        documented = next(base for base in cls.__mro__ if vars(base).get("__doc__"))
        setattr(cls, "__doc__", DocstringOfDeclarations(written_docstring(documented)))  # noqa: B010 - no text but a descriptor

    def __init__(self, **given: Any):
        self.values: dict[str, float] = {}
        self.tables: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self.options: dict[str, bool | int | str] = {}
        self.starts: dict[str, float] = {}
        self.faults: list[str] = []
        self.units: dict[str, str] = {}
        self._given = dict(given)
        for name, option in self.of_kind(Option).items():
            self._take_option(option, given.pop(name, option.default))
        for name, unit in self.of_kind(Unit).items():
            self._take_unit(name, given.pop(name, unit.default))
        self._decide_declarations()
        starts = self.start_declarations()
        for name, item in self.declarations.items():
            if isinstance(item, Parameter):
                self._take_parameter(item, given.pop(name, item.default))
            elif isinstance(item, Table):
                self._take_table(item, given.pop(name, item.default))
        for name, state in starts.items():
            self._take_number(self.starts, name, state.unit, given.pop(name, state.start), "start value")
            if name in self.starts and (fault := out_of_bounds(state, self.starts[name], f"start value '{name}'")):
                self.faults.append(fault)
        for name in given:
            settable = [*self.values, *self.tables, *self.options, *starts]
            hint = nearest(name, settable) or nearest_or_choices(name, settable)
            self.faults.append(f"{type(self).__name__} has no parameter '{name}'{hint}")

    def of_kind(self, kind: type[Any]) -> dict[str, Any]:
        """Return the declarations of one kind, by name."""
        return {name: item for name, item in self.declarations.items() if isinstance(item, kind)}

    def start_declarations(self) -> dict[str, State]:
        """Return what may be given a start value: declared states, and position and rate of inertial flanges."""
        inertial = _inertial(self.declarations)
        return {**self.of_kind(State), **_motion_starts(inertial, prefixed=len(inertial) > 1)}

    @classmethod
    def possible_starts(cls) -> dict[str, State]:
        """Return what may be given a start value under some choice of the options, by name."""
        states = {name: item for name, item in cls.declarations.items() if isinstance(item, State)}
        inertial = _inertial(cls.declarations)
        always = [port for port in inertial if not port.when]
        alone = [] if len(always) > 1 else always or inertial  # where options leave one, its names have no prefix
        together = inertial if len(inertial) > 1 else []
        return {**states, **_motion_starts(alone, prefixed=False), **_motion_starts(together, prefixed=True)}

    def _decide_declarations(self) -> None:
        """Remove what the options exclude, and insert the chosen units."""
        named = {d.name for d in self.declarations.values() if d.when or "{" in getattr(d, "unit", "")}
        named |= {d.name for d in self.of_kind(Table).values() if "{" in d.x_unit}
        if not named:
            return
        chosen: dict[str, Declaration] = {}
        for name, item in self.declarations.items():
            if item.when and not _holds(item.when, self.options):
                continue
            if name in named and self.units:
                texts = {k: getattr(item, k) for k in ("unit", "x_unit") if hasattr(item, k)}
                own_name = item.name
                item = dataclasses.replace(item, **{k: _unit_text(t, self.units) for k, t in texts.items()})
                object.__setattr__(item, "name", own_name)
            chosen[name] = item
        self.declarations = chosen

    def _take_unit(self, name: str, value: Any) -> None:
        self.units[name] = value if isinstance(value, str) else self.declarations[name].default  # type: ignore[attr-defined]
        if not isinstance(value, str):
            self.faults.append(f"unit '{name}' is {value!r}: give a text such as 'rad/s' or 'A'")
        elif value not in _COMMON_UNITS:  # parsing a unit needs pint, which is slow to import
            try:
                same_dimension(value, "1")
            except UnitError as error:
                self.faults.append(f"unit '{name}': {error}")

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
        if number is not None and (fault := out_of_bounds(item, number, f"parameter '{item.name}'")):
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
        allowed = item.choices
        if allowed is None and isinstance(item.default, bool):
            allowed = (True, False)
        if type(value) is not type(item.default) or (allowed is not None and value not in allowed):
            hint = f"one of {', '.join(map(repr, allowed))}" if allowed else f"a {type(item.default).__name__}"
            self.faults.append(f"option '{item.name}' is {value!r}: give {hint} ({item.meaning})")
            return
        self.options[item.name] = value

    def copy(self, **changes: Any) -> Component:
        """Return a new component of the same class with some values replaced."""
        return type(self)(**{**self._given, **changes})

    def is_transmission(self) -> bool:
        """Tell whether the component couples the motions of its ports."""
        return type(self).coupling is not Component.coupling

    def needed_outputs(self, owner: str) -> list[str]:
        """Return the outputs without which a model with this component cannot be simulated."""
        return []

    def equations(self) -> None:
        """State the component's equations; read as text, never called."""

    def coupling(self) -> None:
        """State one port's position as a function of another's, for ideal transmissions; read as text."""

    def coupling_inverse(self) -> None:
        """State the same the other way round; read as text."""

    def __repr__(self) -> str:
        values = [f"{k}={v:g}" for k, v in self.values.items()]
        options = [f"{k}={v!r}" for k, v in self.options.items()]
        return f"{type(self).__name__}({', '.join([*values, *options])})"


def _inertial(declarations: Mapping[str, Declaration]) -> list[Port]:
    """Return the ports with an inertia of their own, whose motion has start values."""
    return [p for p in declarations.values() if isinstance(p, Port) and getattr(p, "inertia", None)]


def _motion_starts(ports: Iterable[Port], prefixed: bool) -> dict[str, State]:
    """Return the start values of the motion of ports: ``position``, or ``<port>_position`` where there are several."""
    return {
        f"{port.name}_{what}" if prefixed else what: State(port.units[what], f"{what} at the start", when=port.when)
        for port in ports
        for what in (port.potential, port.rate)
    }


def _holds(condition: str, options: dict[str, Any]) -> bool:
    """Tell whether a condition on one option holds.

    Examples
    --------
    >>> _holds("order >= 2", {"order": 3}), _holds("not lossy", {"lossy": True}), _holds("lossy", {"lossy": True})
    (True, False, True)
    """
    words = condition.split()
    if len(words) == 3 and words[1] in _COMPARE:
        return _COMPARE[words[1]](options.get(words[0], 0), int(words[2]))
    return not options.get(words[1]) if words[0] == "not" else bool(options.get(words[0]))


def _unit_text(text: str, units: dict[str, str]) -> str:
    """Replace the names of units by the chosen units, with brackets only where they are needed.

    Examples
    --------
    >>> _unit_text("{output}/{input}", {"output": "A", "input": "rad/s"})
    'A/(rad/s)'
    >>> _unit_text("{output}", {"output": "rad/s"})
    'rad/s'
    """
    if text.startswith("{") and text.count("{") == 1 and text.endswith("}"):
        return units[text[1:-1]]
    shown = {k: (u if u.isalnum() else f"({u or '1'})") for k, u in units.items()}
    return text.format(**shown) if "{" in text else text


def out_of_bounds(item: Parameter | State, number: float, what: str) -> str | None:
    """Return the fault of a number outside the bounds of its parameter or state, or None."""
    value = f"{what} is {number:g} {item.unit}"
    if item.min is not None and number < item.min:
        return f"{value}, below its least value {item.min:g}: {item.meaning}; choose more"
    if item.max is not None and number > item.max:
        return f"{value}, above its largest value {item.max:g}: {item.meaning}; choose less"
    return None
