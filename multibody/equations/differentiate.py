"""Exact directional derivatives of equations, from their text (forward mode).

For every active name ``a`` the derived text carries ``d_a``.  Each operation contributes its own rule, so
that the result is exact to rounding; branches are differentiated along the path of the values.  Where a slope
is infinite (a root at zero) or has no direction (``hypot`` at the origin), it is set to zero, so that the
derivatives with respect to everything else stay finite.
"""

from __future__ import annotations

import ast
import itertools
from collections.abc import Callable, Iterable

from multibody.base.errors import EquationError
from multibody.equations.derivative_rules import (
    RULES,
    Expr,
    add,
    const,
    loaded,
    math_call,
    mul,
    number,
    sub,
    substitute,
)
from multibody.equations.statements import constant

__all__ = ["Differentiator", "active_names", "d"]

Kernel = Callable[[str], str]


def d(name: str, mark: str = "") -> str:
    """Return the name of the tangent of a name; tangents of another direction have another mark."""
    return f"_d{mark}_{name}"


def active_names(nodes: Iterable[ast.stmt], seeds: set[str]) -> set[str]:
    """Return every name whose value can depend on the seeds, the seeds included."""
    active = set(seeds)
    assigned = [
        (
            {n.id for n in ast.walk(inner.value) if isinstance(n, ast.Name)},
            {n.id for t in inner.targets for n in ast.walk(t) if isinstance(n, ast.Name)},
        )
        for node in nodes
        for inner in ast.walk(node)
        if isinstance(inner, ast.Assign)
    ]
    while True:
        before = len(active)
        for reads, writes in assigned:
            if reads & active:
                active |= writes
        if len(active) == before:
            return active


class Differentiator:
    """Writes the tangent statements of a list of statements.

    Parameters
    ----------
    active : set of str
        Names that carry a tangent (see `active_names`).
    kernel_tangent : callable
        Maps a kernel's name to the name of its tangent function, which takes all arguments and then all their
        tangents and returns the value(s) followed by the tangent(s).
    mark : str
        Of the tangents' names, where several directions are carried in one text.
    """

    def __init__(self, active: set[str], kernel_tangent: Kernel, mark: str = ""):
        self.active = active
        self.kernel_tangent = kernel_tangent
        self.mark = mark
        self._count = itertools.count()

    def d(self, name: str) -> str:
        """Return the name of the tangent of a name."""
        return d(name, self.mark)

    def statements(self, nodes: Iterable[ast.stmt]) -> list[ast.stmt]:
        """Return the statements, each with its tangent."""
        out: list[ast.stmt] = []
        for node in nodes:
            out += self._statement(node)
        for node in out:
            ast.fix_missing_locations(node)
        return out

    def _statement(self, node: ast.stmt) -> list[ast.stmt]:
        if isinstance(node, ast.Assign):
            return self._assign(node)
        if isinstance(node, ast.If):
            pre, test, _ = self.expression(node.test)
            return [
                *pre,
                ast.If(test, self.statements(node.body) or [ast.Pass()], self.statements(node.orelse)),
            ]
        if isinstance(node, ast.For | ast.While):
            copy = (
                ast.For(node.target, node.iter, self.statements(node.body), [])
                if isinstance(node, ast.For)
                else (ast.While(node.test, self.statements(node.body), []))
            )
            return [copy]
        if isinstance(node, ast.Return):
            return self._return(node)
        if isinstance(node, ast.Pass | ast.Break):
            return [node]
        raise EquationError(f"cannot differentiate '{ast.unparse(node)}'")

    def _return(self, node: ast.Return) -> list[ast.stmt]:
        values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
        pre: list[ast.stmt] = []
        primal: list[Expr] = []
        tangent: list[Expr] = []
        for value in values:
            assert value is not None
            before, v, dv = self.expression(value)
            pre += before
            primal.append(v)
            tangent.append(dv if dv is not None else const(0.0))
        return [*pre, ast.Return(ast.Tuple(primal + tangent, ast.Load()))]

    def _assign(self, node: ast.Assign) -> list[ast.stmt]:
        target = node.targets[0]
        if isinstance(target, ast.Tuple):
            return self._assign_tuple(target, node.value)
        assert isinstance(target, ast.Name)
        if target.id not in self.active:
            return [node]
        pre, value, tangent = self.expression(node.value)
        tangent = tangent if tangent is not None else const(0.0)
        # the tangent first: the value may overwrite a name that the tangent still needs
        return [*pre, ast.Assign([ast.Name(self.d(target.id), ast.Store())], tangent), ast.Assign([target], value)]

    def _assign_tuple(self, target: ast.Tuple, value: Expr) -> list[ast.stmt]:
        names = [n.id for n in target.elts if isinstance(n, ast.Name)]
        if not set(names) & self.active:
            return [ast.Assign([target], value)]
        if isinstance(value, ast.Tuple):
            pre: list[ast.stmt] = []
            post: list[ast.stmt] = []
            for name, part in zip(names, value.elts, strict=True):
                before, v, dv = self.expression(part)
                pre += before
                a, b = self._temporary(), self._temporary()
                pre += [
                    ast.Assign([ast.Name(a, ast.Store())], v),
                    ast.Assign([ast.Name(b, ast.Store())], dv if dv is not None else const(0.0)),
                ]
                post += [
                    ast.Assign([ast.Name(name, ast.Store())], loaded(a)),
                    ast.Assign([ast.Name(self.d(name), ast.Store())], loaded(b)),
                ]
            return pre + post
        if not isinstance(value, ast.Call) or not isinstance(value.func, ast.Name):
            raise EquationError(f"cannot differentiate '{ast.unparse(value)}'")
        pre, call = self._kernel_call(value)
        elements: list[Expr] = [ast.Name(n, ast.Store()) for n in (*names, *map(self.d, names))]
        return [*pre, ast.Assign([ast.Tuple(elements, ast.Store())], call)]

    def _temporary(self) -> str:
        return f"_w{self.mark}{next(self._count)}"

    def _hold(self, pre: list[ast.stmt], value: Expr) -> Expr:
        """Assign a value to a variable, unless it is one already."""
        if isinstance(value, ast.Name | ast.Constant):
            return value
        name = self._temporary()
        pre.append(ast.Assign([ast.Name(name, ast.Store())], value))
        return loaded(name)

    def expression(self, node: Expr) -> tuple[list[ast.stmt], Expr, Expr | None]:
        """Return preparatory statements, the value, and the tangent (None when it is zero)."""
        if not self._touches(node):
            return [], node, None
        if isinstance(node, ast.Name):
            return [], node, loaded(self.d(node.id))
        if isinstance(node, ast.BinOp):
            return self._binary(node)
        if isinstance(node, ast.UnaryOp):
            pre, v, dv = self.expression(node.operand)
            negative = isinstance(node.op, ast.USub) and dv is not None
            return (
                pre,
                ast.UnaryOp(node.op, v),
                ast.UnaryOp(ast.USub(), dv) if negative and dv else (dv if isinstance(node.op, ast.UAdd) else None),
            )
        if isinstance(node, ast.Compare | ast.BoolOp):
            return [], node, None
        if isinstance(node, ast.IfExp):
            return self._choice(node.test, node.body, node.orelse)
        if isinstance(node, ast.Call):
            return self._function(node)
        if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name):
            return [], node, ast.Subscript(loaded(self.d(node.value.id)), node.slice, ast.Load())
        raise EquationError(f"cannot differentiate '{ast.unparse(node)}'")

    def _touches(self, node: ast.AST) -> bool:
        return any(isinstance(n, ast.Name) and n.id in self.active for n in ast.walk(node))

    def _choice(self, test: Expr, body: Expr, orelse: Expr) -> tuple[list[ast.stmt], Expr, Expr | None]:
        value, tangent = self._temporary(), self._temporary()
        branches: list[list[ast.stmt]] = []
        for part in (body, orelse):
            pre, v, dv = self.expression(part)
            branches.append(
                [
                    *pre,
                    ast.Assign([ast.Name(value, ast.Store())], v),
                    ast.Assign([ast.Name(tangent, ast.Store())], dv if dv is not None else const(0.0)),
                ]
            )
        return [ast.If(test, branches[0], branches[1])], loaded(value), loaded(tangent)

    def _binary(self, node: ast.BinOp) -> tuple[list[ast.stmt], Expr, Expr | None]:
        pre_a, a, da = self.expression(node.left)
        pre_b, b, db = self.expression(node.right)
        pre = pre_a + pre_b
        if isinstance(node.op, ast.Add):
            return pre, ast.BinOp(a, node.op, b), add(da, db)
        if isinstance(node.op, ast.Sub):
            return pre, ast.BinOp(a, node.op, b), sub(da, db)
        if isinstance(node.op, ast.Mult):
            a, b = self._hold(pre, a), self._hold(pre, b)
            return (
                pre,
                ast.BinOp(a, node.op, b),
                add(mul(da, b) if da is not None else None, mul(a, db) if db is not None else None),
            )
        if isinstance(node.op, ast.Div):
            b = self._hold(pre, b)
            q = self._hold(pre, ast.BinOp(a, ast.Div(), b))
            top = sub(da, mul(q, db) if db is not None else None)
            return pre, q, ast.BinOp(top, ast.Div(), b) if top is not None else None
        if isinstance(node.op, ast.Pow):
            return self._power(pre, a, da, b, db)
        if isinstance(node.op, ast.Mod) and db is None:
            return pre, ast.BinOp(a, node.op, b), da
        raise EquationError(f"cannot differentiate '{ast.unparse(node)}'")

    def _power(
        self, pre: list[ast.stmt], a: Expr, da: Expr | None, b: Expr, db: Expr | None
    ) -> tuple[list[ast.stmt], Expr, Expr | None]:
        exponent = number(b)
        a = self._hold(pre, a)
        b = b if exponent is not None else self._hold(pre, b)
        value = self._hold(pre, ast.BinOp(a, ast.Pow(), b))
        tangent: Expr | None = None
        if da is not None and exponent is not None:
            tangent = self._power_slope(a, da, value, exponent)
        elif da is not None:
            rule = "b * v / a if a != 0.0 else (1.0 if b == 1.0 else 0.0)"
            tangent = mul(substitute(rule, {"a": a, "b": b, "v": value}), da)
        if db is not None:
            log = substitute("math.log(a) if a > 0.0 else 0.0", {"a": a})
            tangent = add(tangent, mul(mul(value, log), db))
        return pre, value, tangent

    def _power_slope(self, a: Expr, da: Expr, value: Expr, exponent: float) -> Expr | None:
        if exponent in (0, 1):
            return da if exponent == 1 else None
        if exponent == 2:
            return mul(mul(const(2.0), a), da)
        lower = constant(exponent - 1)
        slope: Expr = ast.BinOp(a, ast.Pow(), lower)
        if 0 < exponent < 1:
            slope = substitute("v / a if a != 0.0 else 0.0", {"a": a, "v": value})
        return mul(mul(constant(exponent), slope), da)

    def _function(self, node: ast.Call) -> tuple[list[ast.stmt], Expr, Expr | None]:
        func = node.func
        if isinstance(func, ast.Name):
            if func.id == "abs":
                return self._choice(
                    ast.Compare(node.args[0], [ast.GtE()], [const(0.0)]),
                    node.args[0],
                    ast.UnaryOp(ast.USub(), node.args[0]),
                )
            if func.id in ("min", "max"):
                order = ast.LtE() if func.id == "min" else ast.GtE()
                first = node.args[0]
                rest = node.args[1] if len(node.args) == 2 else ast.Call(func, node.args[1:], [])
                return self._choice(ast.Compare(first, [order], [rest]), first, rest)
            if func.id.startswith("k_tables_") and "p" not in self.active:
                return self._table_slope(node, func.id)
            before, call = self._kernel_call(node)
            value, slope = self._temporary(), self._temporary()
            target = ast.Tuple([ast.Name(value, ast.Store()), ast.Name(slope, ast.Store())], ast.Store())
            return [*before, ast.Assign([target], call)], loaded(value), loaded(slope)
        assert isinstance(func, ast.Attribute)
        pre: list[ast.stmt] = []
        values: list[Expr] = []
        tangents: list[Expr | None] = []
        for argument in node.args:
            before, v, dv = self.expression(argument)
            pre += before
            values.append(self._hold(pre, v))
            tangents.append(dv)
        return self._math(func.attr, pre, values, tangents)

    def _math(
        self, name: str, pre: list[ast.stmt], x: list[Expr], dx: list[Expr | None]
    ) -> tuple[list[ast.stmt], Expr, Expr | None]:
        if name == "pow":
            return self._power(pre, x[0], dx[0], x[1], dx[1])
        value = self._hold(pre, math_call(name, *x))
        a = x[0]
        if name not in RULES:
            raise EquationError(f"math.{name} has no derivative rule")
        known = {"a": a, "b": x[-1], "v": value}
        total: Expr | None = None
        for rule, tangent in zip(RULES[name], dx, strict=False):
            if tangent is not None:
                total = add(total, mul(substitute(rule, known), tangent))
        return pre, value, total

    def _table_slope(self, node: ast.Call, name: str) -> tuple[list[ast.stmt], Expr, Expr | None]:
        """Differentiate a table whose points are held: in implicit blocks and couplings."""
        *points, argument = node.args
        pre, v, dv = self.expression(argument)
        value, slope = self._temporary(), self._temporary()
        target = ast.Tuple([ast.Name(value, ast.Store()), ast.Name(slope, ast.Store())], ast.Store())
        pre.append(ast.Assign([target], ast.Call(loaded(f"{name}_slope"), [*points, v], [])))
        return pre, loaded(value), mul(loaded(slope), dv) if dv is not None else None

    def _kernel_call(self, node: ast.Call) -> tuple[list[ast.stmt], Expr]:
        assert isinstance(node.func, ast.Name)
        pre: list[ast.stmt] = []
        if node.func.id.startswith("k_tables_"):  # p and its tangent, start, size, argument and its tangent
            p, start, size, argument = node.args
            if node.func.id.endswith("_slope"):
                raise EquationError("the slope of a table has no derivative: write the coupling without a table")
            before, v, dv = self.expression(argument)
            tangent_args = [p, loaded("p_dot"), start, size, v, dv if dv is not None else const(0.0)]
            return before, ast.Call(loaded(self.kernel_tangent(node.func.id)), tangent_args, [])
        values: list[Expr] = []
        tangents: list[Expr] = []
        for argument in node.args:
            before, v, dv = self.expression(argument)
            pre += before
            values.append(v)
            tangents.append(dv if dv is not None else const(0.0))
        return pre, ast.Call(loaded(self.kernel_tangent(node.func.id)), values + tangents, [])
