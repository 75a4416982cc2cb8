"""Derivative rules of the functions that equations can call, and operations on expressions for them."""

from __future__ import annotations

import ast

from multibody.base.parsing import expression

__all__ = ["RULES", "Expr", "add", "const", "loaded", "math_call", "mul", "number", "sub", "substitute"]

Expr = ast.expr

_APART = "if a != 0.0 or b != 0.0 else 0.0"

#: slope with respect to each argument; ``a`` and ``b`` are the arguments and ``v`` the value
RULES: dict[str, tuple[str, ...]] = {
    "sin": ("math.cos(a)",),
    "cos": ("-math.sin(a)",),
    "tan": ("1.0 + v * v",),
    "exp": ("v",),
    "log": ("1.0 / a",),
    "sqrt": ("0.5 / v if v != 0.0 else 0.0",),
    "tanh": ("1.0 - v * v",),
    "sinh": ("math.cosh(a)",),
    "cosh": ("math.sinh(a)",),
    "asin": ("1.0 / math.sqrt(1.0 - a * a)",),
    "acos": ("-1.0 / math.sqrt(1.0 - a * a)",),
    "atan": ("1.0 / (1.0 + a * a)",),
    "fabs": ("math.copysign(1.0, a)",),
    "floor": (),
    "copysign": ("math.copysign(1.0, a) * math.copysign(1.0, b)",),
    "atan2": (f"b / (a * a + b * b) {_APART}", f"-a / (a * a + b * b) {_APART}"),
    "hypot": ("a / v if v != 0.0 else 0.0", "b / v if v != 0.0 else 0.0"),
}


def loaded(text: str) -> ast.Name:
    """Return a name that is read."""
    return ast.Name(text, ast.Load())


def const(value: float) -> ast.Constant:
    """Return a number."""
    return ast.Constant(value)


def _is(node: Expr | None, value: float) -> bool:
    return isinstance(node, ast.Constant) and not isinstance(node.value, bool) and node.value == value


def mul(a: Expr, b: Expr) -> Expr:
    """Return a·b, with ones left out."""
    if _is(a, 1.0):
        return b
    if _is(b, 1.0):
        return a
    return ast.BinOp(a, ast.Mult(), b)


def add(a: Expr | None, b: Expr | None) -> Expr | None:
    """Return a + b where None stands for zero."""
    if a is None:
        return b
    return a if b is None else ast.BinOp(a, ast.Add(), b)


def sub(a: Expr | None, b: Expr | None) -> Expr | None:
    """Return a − b where None stands for zero."""
    if b is None:
        return a
    return ast.UnaryOp(ast.USub(), b) if a is None else ast.BinOp(a, ast.Sub(), b)


def math_call(function: str, *args: Expr) -> Expr:
    """Return the call of a function of ``math``."""
    return ast.Call(ast.Attribute(loaded("math"), function, ast.Load()), list(args), [])


def number(node: Expr) -> float | None:
    """Return the value of a number written out, or None."""
    inner = node.operand if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) else node
    if not isinstance(inner, ast.Constant) or not isinstance(inner.value, int | float):
        return None
    return inner.value if inner is node else -inner.value


def substitute(text: str, names: dict[str, Expr]) -> Expr:
    """Return an expression given as text with expressions in the place of its names."""

    class Put(ast.NodeTransformer):
        def visit_Name(self, node: ast.Name) -> Expr:
            return names.get(node.id, node)

    return Put().visit(expression(text))
