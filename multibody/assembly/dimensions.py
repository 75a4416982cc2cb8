"""Dimensions of equations: every sum, comparison and assignment joins like with like, every angle is a number.

Nothing is run and no model is built for it: the statements of each component are followed with the units that it
declares.  What has no unit of its own stays free: a bare number beside a plus sign, and in a product every number that
is no small fraction, because ``9.81`` may be an acceleration.  A difference that is reported is therefore one.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from typing import Any

from multibody.assembly.called_functions import plain_function
from multibody.base.errors import EquationError
from multibody.base.units import UnitError, base_exponents
from multibody.declare.component import Component
from multibody.declare.declarations import Input, Option, Output, Parameter, Port, State, Table, Unknown
from multibody.equations import tables
from multibody.equations.reading import method_statements
from multibody.equations.scope import Scope
from multibody.equations.statements import Statement, readable, variable
from multibody.model.graph import ModelGraph

__all__ = ["component_dimension_faults", "dimension_faults"]

#: Powers of the base units in their order; None is free: it fits everything.
Dimension = tuple[Fraction, ...] | None
Value = Dimension | tuple["Dimension", ...]

BASE = ("kg", "m", "s", "A", "K", "mol", "cd")
NUMBER: Dimension = (Fraction(0),) * len(BASE)
#: Largest number, and denominator of its fraction, that is taken for a plain factor such as 2, 0.5 or 4/3: chosen so
#: that factors of laws pass and constants of nature do not.
LARGEST_FACTOR, DENOMINATOR = 64.0, 24
#: Functions of a number that give a number; the others of the subset keep, compare or halve dimensions.
OF_NUMBERS = frozenset(
    ("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log"),
)
KEEPING = frozenset(("abs", "fabs", "floor"))
ALIKE = frozenset(("min", "max", "hypot", "fmod"))


@lru_cache(maxsize=512)
def _of_unit(unit: str) -> Dimension:
    try:
        exponents = base_exponents(unit or "1")
    except UnitError:
        return None  # what is wrong with the unit is a fault of the declaration
    return tuple(Fraction(exponents.get(name, 0)) for name in BASE)  # an angle is a number


def _in_words(dimension: Dimension) -> str:
    if dimension is None or dimension == NUMBER:
        return "a plain number"
    top = [_power(name, p) for name, p in zip(BASE, dimension, strict=True) if p > 0]
    below = [_power(name, -p) for name, p in zip(BASE, dimension, strict=True) if p < 0]
    text = "*".join(top) or "1"
    return text + (f"/{below[0]}" if len(below) == 1 else f"/({'*'.join(below)})" if below else "")


def _power(name: str, power: Fraction) -> str:
    return name if power == 1 else f"{name}**{power}" if power.denominator == 1 else f"{name}**({power})"


def _is_factor(number: float) -> bool:
    """Tell whether a number is a plain factor: a small fraction, or one of pi.

    Examples
    --------
    >>> [_is_factor(x) for x in (2.0, 0.5, 4 / 3, math.tau, 9.81, 1e-3)]
    [True, True, True, True, False, False]
    """
    near = (Fraction(x).limit_denominator(DENOMINATOR) for x in (number, number / math.pi))
    exact = zip(near, (number, number / math.pi), strict=True)
    return abs(number) <= LARGEST_FACTOR and any(abs(float(f) - x) <= 1e-12 * abs(x) for f, x in exact)


class _Names(ast.NodeTransformer):
    """Write variables as the user knows them."""

    def visit_Name(self, node: ast.Name) -> ast.Name:
        return ast.Name(readable(node.id), node.ctx)


def _shown(node: ast.AST) -> str:
    copy = ast.parse(ast.unparse(node), mode="eval").body
    return ast.unparse(_Names().visit(copy))


@dataclass(kw_only=True)
class _Checker:
    """Follows dimensions through statements; what it finds wrong is collected once."""

    known: dict[str, Dimension]
    tables: Mapping[str, tuple[Table, Dimension, Dimension]]
    kernels: dict[str, Callable[..., Any]]
    faults: dict[str, None] = field(default_factory=dict)
    calling: tuple[str, ...] = ()

    # ---------------------------------------------------------------- statements

    def statements(self, nodes: Iterable[ast.stmt], where: str) -> Value:
        """Follow statements, and return the dimensions of what they return."""
        returned: Value = None
        for node in nodes:
            if isinstance(node, ast.Assign):
                self._assign(node, where)
            elif isinstance(node, ast.If):
                self.of(node.test, where)
                results = [self.statements(branch, where) for branch in (node.body, node.orelse)]
                returned = returned or results[0] or results[1]
            elif isinstance(node, ast.For):
                self.known[node.target.id] = NUMBER  # type: ignore[attr-defined]
                returned = self.statements(node.body, where) or returned
            elif isinstance(node, ast.Return) and node.value is not None:
                value = self.of(node.value, where)
                returned = returned or value
        return returned

    def _assign(self, node: ast.Assign, where: str) -> None:
        target, value = node.targets[0], self.of(node.value, where)
        names: list[Any] = target.elts if isinstance(target, ast.Tuple) else [target]
        several: list[Any] = list(value) if value is not None and _is_several(value) else [value]
        if len(several) != len(names):
            several = [None] * len(names)
        for name, each in zip(names, several, strict=True):
            self._give(name.id, each, node.value, where)

    def _give(self, name: str, value: Dimension, source: ast.expr, where: str) -> None:
        if name not in self.known:
            self.known[name] = value
        elif self.known[name] is None:
            if "___local" in name or self.calling:  # a declared name without a unit stays free
                self.known[name] = value
        elif value is not None and value != self.known[name]:
            self._fault(where, f"'{readable(name)}' is in {_in_words(self.known[name])}", source, value)

    def _fault(self, where: str, what: str, other: ast.expr, value: Dimension) -> None:
        self.faults[f"{where}: {what}, and '{_shown(other)}' is in {_in_words(value)}"] = None

    # ---------------------------------------------------------------- expressions

    def of(self, node: ast.expr, where: str) -> Value:
        """Return the dimension of an expression, or those of a tuple."""
        if isinstance(node, ast.Tuple):
            return tuple(self._single(each, where) for each in node.elts)
        if isinstance(node, ast.Call):
            return self._call(node, where)
        return self._single(node, where)

    def _single(self, node: ast.expr, where: str) -> Dimension:
        if isinstance(node, ast.Name):
            return self.known.get(node.id)
        if isinstance(node, ast.UnaryOp):
            return self._single(node.operand, where)
        if isinstance(node, ast.BinOp):
            return self._operation(node, where)
        if isinstance(node, ast.IfExp):
            self._single(node.test, where)
            return self._alike((node.body, node.orelse), where)
        if isinstance(node, ast.Compare):
            self._alike((node.left, *node.comparators), where)
            return None
        if isinstance(node, ast.BoolOp):
            for each in node.values:
                self._single(each, where)
            return None
        if isinstance(node, ast.Call):
            value = self._call(node, where)
            return None if _is_several(value) else value  # type: ignore[return-value]
        return None

    def _operation(self, node: ast.BinOp, where: str) -> Dimension:
        if isinstance(node.op, ast.Add | ast.Sub | ast.Mod):
            return self._alike((node.left, node.right), where)
        if isinstance(node.op, ast.Pow):
            return self._power(node, where)
        left, right = self._factor(node.left, where), self._factor(node.right, where)
        if left is None or right is None:
            return None
        sign = 1 if isinstance(node.op, ast.Mult) else -1
        return tuple(a + sign * b for a, b in zip(left, right, strict=True))

    def _factor(self, node: ast.expr, where: str) -> Dimension:
        number = _number(node)
        if number is not None:
            return NUMBER if _is_factor(number) else None
        return self._single(node, where)

    def _power(self, node: ast.BinOp, where: str) -> Dimension:
        base, exponent = self._factor(node.left, where), _number(node.right)
        if exponent is None:
            self._plain(node.right, where, "an exponent")
            return NUMBER if base == NUMBER else None
        return None if base is None else tuple(Fraction(exponent).limit_denominator(12) * p for p in base)

    def _alike(self, nodes: Iterable[ast.expr], where: str) -> Dimension:
        """Return the common dimension of expressions that are added or compared."""
        first: tuple[ast.expr, Dimension] | None = None
        for node in nodes:
            value = None if _number(node) is not None else self._single(node, where)
            if value is None:
                continue
            if first is None:
                first = node, value
            elif value != first[1]:
                self._fault(where, f"'{_shown(first[0])}' is in {_in_words(first[1])}", node, value)
        return first[1] if first else None

    def _plain(self, node: ast.expr, where: str, what: str) -> None:
        value = self._single(node, where)
        if value is not None and value != NUMBER:
            self._fault(where, f"{what} has to be a plain number", node, value)

    # ---------------------------------------------------------------- calls

    def _call(self, node: ast.Call, where: str) -> Value:
        name = node.func.attr if isinstance(node.func, ast.Attribute) else node.func.id  # type: ignore[attr-defined]
        if isinstance(node.func, ast.Name) and name in self.kernels:
            return self._kernel(name, node, where)
        if name in OF_NUMBERS:
            self._plain(node.args[0], where, f"the argument of {name}")
            return NUMBER
        if name == "sqrt":
            value = self._single(node.args[0], where)
            return None if value is None else tuple(p / 2 for p in value)
        if name in KEEPING:
            return self._single(node.args[0], where)
        if name in ALIKE:
            return self._alike(node.args, where)
        if name == "atan2":
            self._alike(node.args, where)
            return NUMBER
        if name == "copysign":
            self._single(node.args[1], where)
            return self._single(node.args[0], where)
        if name == "pow":
            return self._power(ast.BinOp(node.args[0], ast.Pow(), node.args[1]), where)
        return None

    def _kernel(self, name: str, node: ast.Call, where: str) -> Value:
        function = self.kernels[name]
        if function in tables.SLOPES:
            return self._table(node, where, slope=function in (tables.linear_rate, tables.cubic_rate))
        arguments = [self._single(each, where) for each in node.args]
        if name in self.calling or hasattr(function, "tangent_text"):
            return None
        try:
            text = plain_function(name, function, self.kernels)
        except EquationError:
            return None  # reported when the model is built
        inner = dict(zip((a.arg for a in text.args.args), arguments, strict=False))
        below = _Checker(
            known=inner, tables={}, kernels=self.kernels, faults=self.faults, calling=(*self.calling, name)
        )
        return below.statements(text.body, f"{where}, in {function.__name__}")

    def _table(self, node: ast.Call, where: str, slope: bool) -> Dimension:
        if not isinstance(node.args[1], ast.Name) or node.args[1].id not in self.tables:
            return None
        table, along, value = self.tables[node.args[1].id]
        given = self._single(node.args[3], where)
        if given is not None and along is not None and given != along:
            self._fault(where, f"table '{table.name}' is over {_in_words(along)}", node.args[3], given)
        if not slope or value is None or along is None:
            return None if slope else value
        return tuple(a - b for a, b in zip(value, along, strict=True))


def _is_several(value: Value) -> bool:
    return isinstance(value, tuple) and not (value and isinstance(value[0], Fraction))


def _number(node: ast.expr) -> float | None:
    """Return the number that an expression of numbers alone is."""
    try:
        value = ast.literal_eval(node)
    except (ValueError, TypeError, SyntaxError):
        return None
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _declared(
    name: str, component: Component
) -> tuple[dict[str, Dimension], dict[str, tuple[Table, Dimension, Dimension]]]:
    known: dict[str, Dimension] = {"t": _of_unit("s"), "p": None}
    tables: dict[str, tuple[Table, Dimension, Dimension]] = {}
    for key, item in component.declarations.items():
        if isinstance(item, Port):
            known |= {variable(name, key, what): _of_unit(unit) for what, unit in item.units.items()}
        elif isinstance(item, Table):
            along = None if key in component.units_by_option else _of_unit(item.x_unit)
            tables[variable(name, key, "_start")] = item, along, _of_unit(item.unit)
        elif key in component.units_by_option:
            known[variable(name, key)] = None
        elif isinstance(item, Parameter | State | Input | Output | Unknown) and not isinstance(item, Option):
            known[variable(name, key)] = _of_unit(item.unit)
            if isinstance(item, State):
                known[variable(name, "_der", key)] = _of_unit(f"({item.unit or '1'})/s")
            elif isinstance(item, Unknown):
                known[variable(name, "_zero", key)] = None  # what vanishes may be of any kind
    return known, tables


def _in_order(statements: list[Statement]) -> list[Statement]:
    """Return statements so that a name of the component's own is assigned before it is read, as far as that goes."""
    waiting, done = list(statements), []
    while waiting:
        pending = {name for each in waiting for name in each.writes}
        ready = next((s for s in waiting if not (s.reads - s.writes) & pending), waiting[0])
        waiting.remove(ready)
        done.append(ready)
    return done


def component_dimension_faults(name: str, component: Component) -> tuple[str, ...]:
    """Return where the equations of a component join quantities of different dimensions.

    Parameters
    ----------
    name : str
        The component's name, for the message.
    component : Component

    Returns
    -------
    tuple of str
        One sentence for each place, with file and line; empty where all fits, or where the equations cannot be read,
        which `multibody.Model.build` refuses with the reason.

    Examples
    --------
    >>> from multibody.library import SpringDamper
    >>> component_dimension_faults("spring", SpringDamper(stiffness=1.0, damping=1.0))
    ()
    """
    known, tables = _declared(name, component)
    faults: dict[str, None] = {}
    for method in ("equations", "coupling", "coupling_inverse"):
        kernels: dict[str, Callable[..., Any]] = {}
        try:
            statements = method_statements(Scope(name, component, kernels), method)
        except EquationError:
            continue
        checker = _Checker(known=dict(known), tables=tables, kernels=kernels, faults=faults)
        for statement in _in_order(statements):
            checker.statements(statement.nodes, statement.origin)
    return tuple(faults)


def dimension_faults(model: ModelGraph) -> tuple[str, ...]:
    """Return where the equations of a model's components join quantities of different dimensions.

    Parameters
    ----------
    model : Model
        Its values do not matter; each class is looked at once with each choice of its options and units.

    Returns
    -------
    tuple of str
        As of `component_dimension_faults`.
    """
    faults: list[str] = []
    seen: set[object] = set()
    for name, component in model.components.items():
        options = tuple(sorted(component.options.items())), tuple(sorted(component.units.items()))
        if component.only_python or (key := (type(component), options)) in seen:
            continue
        seen.add(key)
        faults += component_dimension_faults(name, component)
    return tuple(faults)
