"""Derivatives along many directions in one pass: what does not depend on the direction is computed once.

A generated tangent ``f(t, x, u, p, x_dot, u_dot, p_dot, out)`` carries one direction.  For a whole Jacobian its values
would be computed anew for every column.  Here its statements are parted into those that no direction touches and
those that one does; the latter go into a loop over the directions, which becomes vector instructions.  The tangent of
a table reads those of its points by itself; it is written anew with the direction as a further argument.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable
from functools import lru_cache

from multibody.native import TANGENT_ARRAYS, NativeFunction, compile_text, compiling

__all__ = ["along_directions", "lanes_for", "widened"]

LANES, MOST_LANES = 16, 48

_HEADER = "import math\n\nindependent = range  # turns do not depend on each other\n\n"
_SUFFIX, _LANE, _TABLE = "_tangent", "lane", "k_tables_"


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
        ``p_dot`` (n_p, count), and ``out`` (rows, count).  None for implicit blocks, and where nothing is compiled.
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
        of_tables = [
            _in_lanes(n, count)
            for n in tree.body
            if isinstance(n, ast.FunctionDef) and n.name.startswith(_TABLE) and n.name.endswith(_SUFFIX)
        ]
    except _Outside:
        return None
    lanes = ast.Call(ast.Name("independent", ast.Load()), [ast.Constant(count)], [])
    loop = ast.For(ast.Name(_LANE, ast.Store()), lanes, inside, [])
    function.body = [*before, loop]
    functions = [n for n in tree.body if isinstance(n, ast.FunctionDef)]
    tree.body = [*functions[:-1], *of_tables, functions[-1]] if functions[-1] is function else [*functions, *of_tables]
    return _HEADER + "\n" + ast.unparse(ast.fix_missing_locations(tree)) + "\n"


def _parted(function: ast.FunctionDef, count: int) -> tuple[list[ast.stmt], list[ast.stmt]]:
    """Return the statements that no direction touches, and the others."""
    directions, out = [a.arg for a in function.args.args][-4:-1], function.args.args[-1].arg
    lanes = _Lanes({*directions, out}, count)
    moving: set[str] = set(directions)
    before: list[ast.stmt] = []
    inside: list[ast.stmt] = []
    values_of = _Values()
    for node in function.body:
        if isinstance(node, ast.Return | ast.Expr):
            continue
        if not isinstance(node, ast.Assign) or len(node.targets) != 1:
            raise _Outside
        values_of.visit(node)
        (target,) = node.targets
        names = {n.id for n in ast.walk(target) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
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


class _Values(ast.NodeTransformer):
    """Gives every value of a name that is assigned again a name of its own."""

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}

    def visit_Assign(self, node: ast.Assign) -> ast.Assign:
        """Rename what the value reads, then what is assigned."""
        node.value = self.visit(node.value)
        node.targets = [self.visit(t) for t in node.targets]
        return node

    def visit_Name(self, node: ast.Name) -> ast.Name:
        """Return the name of the latest value, or of the new one."""
        if isinstance(node.ctx, ast.Store):
            self.counts[node.id] = self.counts.get(node.id, 0) + 1
        count = self.counts.get(node.id, 0)
        return ast.Name(f"{node.id}___value{count}", node.ctx) if count > 1 else node


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
    given = call.args[: len(call.args) // 2]
    if call.func.id.startswith(_TABLE):  # p, p_dot, start, size, x, x_dot
        given = [call.args[k] for k in (0, 2, 3, 4)]
    values: list[ast.expr] = [ast.Name(n, ast.Store()) for n in names[:half]]
    plain = ast.Name(call.func.id.removesuffix(_SUFFIX), ast.Load())
    first = ast.Assign(
        [values[0] if half == 1 else ast.Tuple(values, ast.Store())],
        ast.Call(plain, given, []),
    )
    left: list[ast.expr] = [ast.Name(f"_again_{n}", ast.Store()) for n in names[:half]]
    left += [ast.Name(n, ast.Store()) for n in names[half:]]
    return first, ast.Assign([ast.Tuple(left, ast.Store())], call), set(names[half:])


def _in_lanes(table: ast.FunctionDef, count: int) -> ast.FunctionDef:
    """Return the tangent of a table that reads its points' tangents in the lane of one direction."""
    points = table.args.args[1].arg

    class Put(ast.NodeTransformer):
        def visit_Subscript(self, node: ast.Subscript) -> ast.Subscript:
            if isinstance(node.value, ast.Name) and node.value.id == points:
                at = ast.BinOp(node.slice, ast.Mult(), ast.Constant(count))
                node.slice = ast.BinOp(at, ast.Add(), ast.Name(_LANE, ast.Load()))
            return node

    body = [Put().visit(n) for n in ast.parse(ast.unparse(table)).body[0].body]  # type: ignore[attr-defined]
    if any(_reads_whole(n, points) for n in body):
        raise _Outside
    arguments = ast.arguments([], [*table.args.args, ast.arg(_LANE)], None, [], [], None, [])
    return ast.FunctionDef(f"{table.name}_{_LANE}", arguments, body, [], type_params=[])  # type: ignore[call-arg]


def _reads_whole(node: ast.AST, name: str) -> bool:
    """Tell whether an array is handed on as a whole."""
    indexed = {id(n.value) for n in ast.walk(node) if isinstance(n, ast.Subscript)}
    return any(isinstance(n, ast.Name) and n.id == name and id(n) not in indexed for n in ast.walk(node))


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

    def visit_Call(self, node: ast.Call) -> ast.Call:
        """Turn the tangent of a table into that of one direction."""
        table = isinstance(node.func, ast.Name) and node.func.id.startswith(_TABLE) and node.func.id.endswith(_SUFFIX)
        if not table:
            return self.generic_visit(node)  # type: ignore[return-value]
        points = node.args[1]
        node.args = [*(self.visit(a) for k, a in enumerate(node.args) if k != 1), ast.Name(_LANE, ast.Load())]
        node.args.insert(1, points)
        node.func = ast.Name(f"{node.func.id}_{_LANE}", ast.Load())  # type: ignore[attr-defined]
        return node

    def visit_Name(self, node: ast.Name) -> ast.Name:
        """Refuse an array that is handed on as a whole."""
        if node.id in self.arrays:
            raise _Outside
        return node
