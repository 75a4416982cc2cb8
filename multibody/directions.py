"""Derivatives along many directions in one pass: what does not depend on the direction is computed once.

A generated tangent ``f(t, x, u, p, x_dot, u_dot, p_dot, out)`` carries one direction.  For a whole Jacobian its values
would be computed anew for every column.  Here its statements are parted into those that no direction touches and
those that one does; the latter go into a loop over the directions, which becomes vector instructions.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable
from functools import lru_cache

from multibody.native import TANGENT_ARRAYS, NativeFunction, compile_text, compiling

__all__ = ["along_directions", "lanes_for", "widened"]

LANES, MOST_LANES = 16, 48

_HEADER = "import math\n\nindependent = range  # turns do not depend on each other\n\n"
_SUFFIX, _LANE = "_tangent", "lane"


class _Outside(Exception):
    """The text has a construct that is not parted."""


def along_directions(tangent: NativeFunction, count: int) -> NativeFunction | None:
    """Return a tangent that carries several directions at once, or None where its text cannot be parted.

    Parameters
    ----------
    tangent : NativeFunction
        Of a system: ``rhs_tangent`` or ``outputs_tangent``.
    count : int
        Number of directions; a multiple of four makes whole vector instructions.

    Returns
    -------
    NativeFunction or None
        ``f(t, x, u, p, x_dot, u_dot, p_dot, out)`` with directions ``x_dot`` (n, count), ``u_dot`` (n_u, count),
        ``p_dot`` (n_p, count), and ``out`` (rows, count).  None for tables and implicit blocks, and where nothing is
        compiled.
    """
    text, stem = tangent.origin
    return _made(text, stem, tangent.name, count) if tangent.compiled and text else None


def lanes_for(count: int) -> int:
    """Return how many directions at once serve a number of them well.

    Few numbers of lanes keep the number of texts low that have to be compiled; many directions are worth one of
    their own.

    Examples
    --------
    >>> lanes_for(5), lanes_for(20), lanes_for(37), lanes_for(60)
    (16, 16, 40, 32)
    """
    if count <= 2 * LANES:
        return LANES
    groups = -(-count // MOST_LANES)
    return -(-count // (8 * groups)) * 8


@lru_cache(maxsize=64)
def _made(text: str, stem: str, name: str, count: int) -> NativeFunction | None:
    wide = widened(text, name, count)
    if wide is None:
        return None
    with compiling:
        return compile_text(wide, f"{stem}_{count}", name, TANGENT_ARRAYS)


def widened(text: str, name: str, count: int) -> str | None:
    """Return the text of a tangent along ``count`` directions, or None if it cannot be parted.

    Examples
    --------
    >>> head = "def f(t, x, u, p, x_dot, u_dot, p_dot, out):"
    >>> text = widened("\\n    ".join([head, "a = x[0]", "_d_a = x_dot[0]", "out[0] = 2.0 * a * _d_a"]), "f", 4)
    >>> print(text.partition("\\n\\n\\n")[2])
    def f(t, x, u, p, x_dot, u_dot, p_dot, out):
        a = x[0]
        for lane in independent(4):
            _d_a = x_dot[0 + lane]
            out[0 + lane] = 2.0 * a * _d_a
    """
    tree = ast.parse(text)
    function = next(n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == name)
    try:
        before, inside = _parted(function, count)
    except _Outside:
        return None
    lanes = ast.Call(ast.Name("independent", ast.Load()), [ast.Constant(count)], [])
    loop = ast.For(ast.Name(_LANE, ast.Store()), lanes, inside, [])
    function.body = [*before, loop]
    tree.body = [n for n in tree.body if isinstance(n, ast.FunctionDef)]
    return _HEADER + "\n" + ast.unparse(ast.fix_missing_locations(tree)) + "\n"


def _parted(function: ast.FunctionDef, count: int) -> tuple[list[ast.stmt], list[ast.stmt]]:
    """Return the statements that no direction touches, and the others."""
    directions, out = [a.arg for a in function.args.args][-4:-1], function.args.args[-1].arg
    lanes = _Lanes({*directions, out}, count)
    moving: set[str] = set(directions)
    assigned: set[str] = set()
    before: list[ast.stmt] = []
    inside: list[ast.stmt] = []
    for node in function.body:
        if isinstance(node, ast.Return | ast.Expr):
            continue
        if not isinstance(node, ast.Assign) or len(node.targets) != 1:
            raise _Outside
        (target,) = node.targets
        names = {n.id for n in ast.walk(target) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        if names & assigned:  # a later value of the same name would be taken for the earlier one
            raise _Outside
        assigned |= names
        kernel = _kernel(node)
        if kernel is not None and not _reads(kernel[0].value, moving):
            values, rest, touched = kernel
            before.append(values)
            inside.append(lanes.visit(rest))
            moving |= touched
        elif isinstance(target, ast.Subscript) or _reads(node.value, moving):
            inside.append(lanes.visit(node))
            moving |= names
        else:
            before.append(node)
    return before, inside


def _reads(node: ast.expr, names: Iterable[str]) -> bool:
    return any(isinstance(n, ast.Name) and n.id in names for n in ast.walk(node))


def _kernel(node: ast.Assign) -> tuple[ast.Assign, ast.Assign, set[str]] | None:
    """Return a kernel's tangent as the kernel for the values, the tangent for the rest, and the names of the rest."""
    target, call = node.targets[0], node.value
    if not (isinstance(target, ast.Tuple) and isinstance(call, ast.Call) and isinstance(call.func, ast.Name)):
        return None
    names = [n.id for n in target.elts if isinstance(n, ast.Name)]
    if not call.func.id.endswith(_SUFFIX) or len(names) != len(target.elts):
        return None
    half = len(names) // 2
    values: list[ast.expr] = [ast.Name(n, ast.Store()) for n in names[:half]]
    plain = ast.Name(call.func.id.removesuffix(_SUFFIX), ast.Load())
    first = ast.Assign(
        [values[0] if half == 1 else ast.Tuple(values, ast.Store())],
        ast.Call(plain, call.args[: len(call.args) // 2], []),
    )
    left: list[ast.expr] = [ast.Name(f"_again_{n}", ast.Store()) for n in names[:half]]
    left += [ast.Name(n, ast.Store()) for n in names[half:]]
    return first, ast.Assign([ast.Tuple(left, ast.Store())], call), set(names[half:])


class _Lanes(ast.NodeTransformer):
    """Elements of directions and results, each as the row of that element in an array of many directions."""

    def __init__(self, arrays: set[str], count: int) -> None:
        self.arrays, self.count = arrays, count

    def visit_Subscript(self, node: ast.Subscript) -> ast.Subscript:
        """Turn ``a[k]`` into ``a[k * count + lane]``."""
        if not (isinstance(node.value, ast.Name) and node.value.id in self.arrays):
            return node
        if not (isinstance(node.slice, ast.Constant) and isinstance(node.slice.value, int)):
            raise _Outside
        start = ast.Constant(self.count * node.slice.value)
        node.slice = ast.BinOp(start, ast.Add(), ast.Name(_LANE, ast.Load()))
        return node

    def visit_Name(self, node: ast.Name) -> ast.Name:
        """Refuse an array that is handed on as a whole."""
        if node.id in self.arrays:
            raise _Outside
        return node
