"""The functions of a unit as C, for those who need a source file and not an address."""

from __future__ import annotations

import ast
import math
from typing import Any

from multibody.compile.emitter.inference import Kinds
from multibody.compile.emitter.instructions import METHODS
from multibody.compile.emitter.kinds import FLOAT, FLOATS, INT, INTS, NOTHING, TRUTH, Kind, Outside
from multibody.compile.emitter.units import Unit

__all__ = ["C_ARITHMETIC", "c_functions", "c_source"]

_C = {FLOAT: "double", INT: "long long", TRUTH: "int", FLOATS: "double *", INTS: "long long *", NOTHING: "void"}
_OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*"}
_COMPARE = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
#: Functions that the texts of `c_functions` call; it stands once in a file, before them.
C_ARITHMETIC = """#include <math.h>

static inline double least(double a, double b) { return b < a ? b : a; }
static inline double most(double a, double b) { return b > a ? b : a; }
static inline double whole_power(double x, int n)
{
    double r = 1.0;
    for (int k = n < 0 ? -n : n; k; k >>= 1, x *= x)
        if (k & 1) r *= x;
    return n < 0 ? 1.0 / r : r;
}
static inline double rest(double a, double b)
{
    double r = fmod(a, b);
    return r != 0.0 ? ((r < 0.0) != (b < 0.0) ? r + b : r) : copysign(0.0, b);
}
static inline long long quotient(long long a, long long b)
{
    long long q = a / b;
    return a % b != 0 && ((a < 0) != (b < 0)) ? q - 1 : q;
}
"""


def c_source(unit: Unit, name: str, arguments: tuple[Kind, ...], symbol: str) -> str:
    """Return a function of a unit, and the functions that it calls, as the text of a C file.

    Parameters
    ----------
    unit : Unit
        Generated text (`multibody.compile.emitter.units.unit_of_text`).
    name : str
        The function.
    arguments : tuple of kinds
    symbol : str
        Its name in C; all others are static.

    Raises
    ------
    Outside
        If something is outside the subset.

    Examples
    --------
    >>> from multibody.compile.emitter.units import unit_of_text
    >>> text = "def f(t, x, out):\\n    out[0] = min(x[0], t) ** 2\\n"
    >>> source = c_source(unit_of_text(text, "f"), "f", ("float", "floats", "floats"), "f")
    >>> "v_out[0] = whole_power(least(v_x[0], v_t), 2);" in source
    True
    """
    return "\n".join([C_ARITHMETIC, c_functions(unit, name, arguments, symbol)])


def c_functions(unit: Unit, name: str, arguments: tuple[Kind, ...], symbol: str, storage: str = "") -> str:
    """Return a function of a unit, and the functions that it calls, as C that follows `C_ARITHMETIC` in a file.

    Functions of several units can stand in one file: the names of those that are called begin with ``symbol``.

    Parameters
    ----------
    unit, name, arguments, symbol
        As of `c_source`.
    storage : str
        ``"static"`` keeps the function to its file.

    Raises
    ------
    Outside
        If something is outside the subset.
    """
    program = _Program(unit, symbol)
    body = program.function(name, arguments, symbol, f"{storage} " if storage else "")
    return "\n".join([*program.types.values(), *program.texts, body])


class _Program:
    def __init__(self, unit: Unit, prefix: str) -> None:
        self.unit, self.prefix = unit, prefix
        self.texts: list[str] = []
        self.types: dict[Kind, str] = {}
        self._known: dict[Any, tuple[str, Kind]] = {}

    def kinds(self, name: str, arguments: tuple[Kind, ...]) -> Kinds:
        return Kinds(self.unit, self.unit.functions[name], arguments, lambda u, n, a: self.kinds(n, a).returns)

    def called(self, name: str, arguments: tuple[Kind, ...]) -> tuple[str, Kind]:
        key = (name, arguments)
        if key not in self._known:
            symbol = f"{self.prefix}_{name}_{len(self._known)}"
            self._known[key] = symbol, self.kinds(name, arguments).returns
            self.texts.append(self.function(name, arguments, symbol, "static "))
        return self._known[key]

    def type_of(self, kind: Kind) -> str:
        if not isinstance(kind, tuple):
            return _C[kind]
        if kind not in self.types:
            fields = " ".join(f"{self.type_of(k)} r{i};" for i, k in enumerate(kind))
            self.types[kind] = f"typedef struct {{ {fields} }} {self.prefix}_several_{len(self.types)};"
        return f"{self.prefix}_several_{list(self.types).index(kind)}"

    def function(self, name: str, arguments: tuple[Kind, ...], symbol: str, storage: str = "") -> str:
        return _Function(self, self.kinds(name, arguments)).text(symbol, storage)


def _unread(target: ast.expr, read: set[str]) -> bool:
    return isinstance(target, ast.Name) and target.id not in read


def _read(function: ast.FunctionDef) -> set[str]:
    """Return the names that count: those read by what is written or returned, in the end."""
    read: set[str] = set()
    while True:
        dead: set[int] = set()
        for node in ast.walk(function):
            if isinstance(node, ast.Assign) and read and all(_unread(t, read) for t in node.targets):
                dead |= {id(n) for n in ast.walk(node.value)}
        names = (n for n in ast.walk(function) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load))
        names_read = {n.id for n in names if id(n) not in dead}
        if names_read == read:
            return read
        read = names_read


class _Function:
    def __init__(self, program: _Program, kinds: Kinds) -> None:
        self.program, self.kinds = program, kinds
        self.lines: list[str] = []
        self.count = 0

    def text(self, symbol: str, storage: str) -> str:
        node, kind_of = self.kinds.node, self.kinds.of
        given = [a.arg for a in node.args.args]
        stores = [n for n in ast.walk(node) if isinstance(n, ast.Subscript) and isinstance(n.ctx, ast.Store)]
        written = {n.value.id for n in stores if isinstance(n.value, ast.Name)}
        self.read = _read(node)
        head = ", ".join(
            f"{'const ' if isinstance(kind_of[a], str) and kind_of[a] in (FLOATS, INTS) and a not in written else ''}"
            f"{self.program.type_of(kind_of[a])} v_{a}"
            for a in given
        )
        for name, kind in kind_of.items():
            if name in self.read and name not in given:
                self.lines.append(f"    {self.program.type_of(kind)} v_{name};")
        self.lines += [f"    (void)v_{a};" for a in given if a not in self.read and a not in written]
        self._block(node.body, 1)
        returns = self.program.type_of(self.kinds.returns)
        return "\n".join([f"{storage}{returns} {symbol}({head})", "{", *self.lines, "}", ""])

    def _line(self, depth: int, text: str) -> None:
        self.lines.append("    " * depth + text)

    def _block(self, nodes: list[ast.stmt], depth: int) -> None:
        for node in nodes:
            self._statement(node, depth)

    def _statement(self, node: ast.stmt, depth: int) -> None:
        match node:
            case ast.Assign(targets=[ast.Tuple(elts=targets)], value=value):
                kind = self.kinds.kind(value)
                self.count += 1
                held = f"several{self.count}"
                self._line(depth, f"{self.program.type_of(kind)} {held} = {self.value(value)};")
                for k, target in enumerate(targets):
                    if not _unread(target, self.read):
                        self._line(depth, f"{self.value(target)} = {held}.r{k};")
            case ast.Assign(targets=targets, value=value):
                targets = [t for t in targets if not _unread(t, self.read)]
                if not targets:
                    return
                result = self.value(value)
                for target in targets:
                    self._line(depth, f"{self.value(target)} = {result};")
            case ast.AugAssign(target=target, op=op, value=value):
                whole = ast.BinOp(target, op, value)
                self._line(depth, f"{self.value(target)} = {self.value(ast.fix_missing_locations(whole))};")
            case ast.If(test=test, body=body, orelse=orelse):
                self._line(depth, f"if ({self.value(test)}) {{")
                self._block(body, depth + 1)
                if orelse:
                    self._line(depth, "} else {")
                    self._block(orelse, depth + 1)
                self._line(depth, "}")
            case ast.For(target=ast.Name(id=name), iter=ast.Call(args=bounds)):
                ends = [self.value(b) for b in bounds]
                start, stop = ("0", ends[0]) if len(ends) == 1 else (ends[0], ends[1])
                step = ends[2] if len(ends) == 3 else "1"
                order = ">" if step.startswith(("-", "(-")) else "<"
                self.count += 1
                i = f"i{self.count}"
                self._line(depth, f"for (long long {i} = {start}; {i} {order} {stop}; {i} += {step}) {{")
                if name in self.read:
                    self._line(depth + 1, f"v_{name} = {i};")
                self._block(node.body, depth + 1)
                self._line(depth, "}")
            case ast.While(test=test, body=body):
                self._line(depth, f"while ({self.value(test)}) {{")
                self._block(body, depth + 1)
                self._line(depth, "}")
            case ast.Return(value=value):
                self._line(depth, "return;" if value is None else f"return {self.value(value)};")
            case ast.Break():
                self._line(depth, "break;")
            case ast.Continue():
                self._line(depth, "continue;")
            case ast.Expr(value=ast.Constant()) | ast.Pass():
                pass
            case _:
                raise Outside(f"{self.kinds.unit.name}, line {node.lineno}: {type(node).__name__} in C")

    def value(self, node: ast.expr) -> str:
        match node:
            case ast.Name(id=name):
                return f"v_{name}"
            case ast.Constant(value=bool(value)):
                return "1" if value else "0"
            case ast.Constant(value=int(value)):
                return str(value)
            case ast.Constant(value=float(value)):
                return repr(value) if math.isfinite(value) else "INFINITY" if value > 0 else "NAN"
            case ast.Attribute(value=ast.Name(id="math"), attr=attr):
                return {"inf": "INFINITY", "nan": "NAN"}.get(attr) or repr(getattr(math, attr))
            case ast.Subscript(value=array, slice=index):
                return f"{self.value(array)}[{self.value(index)}]"
            case ast.UnaryOp(op=op, operand=operand):
                sign = "!" if isinstance(op, ast.Not) else "-" if isinstance(op, ast.USub) else "+"
                return f"({sign}{self.value(operand)})"
            case ast.BinOp(left=left, op=op, right=right):
                return self._binary(left, op, right, node)
            case ast.Compare(left=left, ops=ops, comparators=others):
                sides = [self.value(left), *map(self.value, others)]
                pairs = zip(sides, ops, sides[1:], strict=False)
                return "(" + " && ".join(f"{a} {_COMPARE[type(op)]} {b}" for a, op, b in pairs) + ")"
            case ast.BoolOp(op=op, values=values):
                return "(" + (" && " if isinstance(op, ast.And) else " || ").join(map(self.value, values)) + ")"
            case ast.IfExp(test=test, body=body, orelse=orelse):
                return f"({self.value(test)} ? {self.value(body)} : {self.value(orelse)})"
            case ast.Tuple(elts=elts):
                kind = self.program.type_of(self.kinds.kind(node))
                return f"({kind}){{{', '.join(map(self.value, elts))}}}"
            case ast.Call():
                return self._call(node)
        raise Outside(f"{self.kinds.unit.name}: {ast.unparse(node)} in C")

    def _binary(self, left: ast.expr, op: ast.operator, right: ast.expr, node: ast.expr) -> str:
        a, b = self.value(left), self.value(right)
        if type(op) in _OPERATORS:
            return f"({a} {_OPERATORS[type(op)]} {b})"
        if isinstance(op, ast.Div):
            return f"((double){a} / (double){b})"
        whole = self.kinds.kind(node) == INT
        if isinstance(op, ast.Pow):
            return f"whole_power({a}, {b})" if self.kinds.kind(right) == INT else f"pow({a}, {b})"
        if isinstance(op, ast.FloorDiv) and whole:
            return f"quotient({a}, {b})"
        if isinstance(op, ast.Mod):
            return f"({a} - {b} * quotient({a}, {b}))" if whole else f"rest({a}, {b})"
        raise Outside(f"{self.kinds.unit.name}: {ast.unparse(node)} in C")

    def _call(self, node: ast.Call) -> str:
        given = [self.value(a) for a in node.args]
        match node.func:
            case ast.Attribute(value=ast.Name(id="math"), attr=attr) if attr in METHODS:
                return f"{attr}({', '.join(given)})"
            case ast.Name(id="min" | "max" as name):
                result = given[0]
                for other in given[1:]:
                    result = f"{'least' if name == 'min' else 'most'}({result}, {other})"
                return result
            case ast.Name(id="abs"):
                return f"fabs({given[0]})"
            case ast.Name(id="int" | "float" as name):
                return f"(({'long long' if name == 'int' else 'double'}){given[0]})"
            case ast.Name(id=name) if name in self.program.unit.functions:
                symbol, _ = self.program.called(name, tuple(self.kinds.kind(a) for a in node.args))
                return f"{symbol}({', '.join(given)})"
        raise Outside(f"{self.kinds.unit.name}: {ast.unparse(node.func)} in C")
