"""Equations as text: a component's methods read as a list of statements over global names.

A component writes ``self.a.force = self.stiffness * (...)``.  Here that text becomes an assignment between global
variable names (``spring__a__force``), with options folded to constants and dead branches removed.  What lies
outside the subset (see the docs page "Writing a component") is refused with file and line.
"""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from multibody.component import Component, nearest
from multibody.declare import Input, Option, Output, Parameter, Port, State, Table, Unknown
from multibody.errors import EquationError

__all__ = ["Rewriter", "Scope", "Statement", "method_statements", "names_read", "names_written", "parse_function", "variable"]

MATH_FUNCTIONS = frozenset(
    "sin cos tan asin acos atan atan2 sinh cosh tanh exp log sqrt hypot copysign fabs floor pow".split()
)
BUILTIN_FUNCTIONS = frozenset({"abs", "min", "max"})


def variable(*parts: str) -> str:
    """Return the global variable name of a dotted name, as used in the generated source.

    Examples
    --------
    >>> variable("carriage.guide", "a", "force")
    'carriage__guide__a__force'
    """
    return "__".join(part.replace(".", "__") for part in parts)


@dataclass
class Statement:
    """One assignment, or a compound that has to stay together (if/else, loop, accumulation).

    ``reads`` and ``writes`` are global variable names; ``origin`` names component and source line.
    """

    nodes: list[ast.stmt]
    reads: set[str]
    writes: set[str]
    origin: str

    @property
    def text(self) -> str:
        """The statement as Python text."""
        return "\n".join(ast.unparse(node) for node in self.nodes)


def names_written(node: ast.AST) -> set[str]:
    """Return the names that a node assigns."""
    return {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}


def names_read(node: ast.AST) -> set[str]:
    """Return the names that a node reads, the names of called functions left out."""
    called = {n.func.id for n in ast.walk(node) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
    called |= {"math"}
    return {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)} - called


@dataclass
class Scope:
    """What the names in one component's equations stand for, and what was met while reading them.

    Parameters
    ----------
    name : str
        The component's name in the model.
    component : Component
        The component.
    kernels : dict
        Functions called by equations, by name; filled while reading, shared by all components of a model.
    """

    name: str
    component: Component
    kernels: dict[str, Callable[..., Any]] = field(default_factory=dict)

    def attribute(self, path: list[str], where: str) -> ast.expr:
        """Return the expression for ``self.<path>``."""
        known = self.component.declarations
        head = path[0]
        if path == ["time"] and head not in known:
            return ast.Name("t", ast.Load())
        if head == "der" and len(path) == 2:
            if not isinstance(known.get(path[1]), State):
                raise EquationError(f"{where}: 'self.der.{path[1]}' is not the rate of a declared state")
            return ast.Name(variable(self.name, "der", path[1]), ast.Load())
        if head == "zero" and len(path) == 2:
            if not isinstance(known.get(path[1]), Unknown):
                raise EquationError(f"{where}: 'self.zero.{path[1]}' is not the equation of a declared unknown")
            return ast.Name(variable(self.name, "zero", path[1]), ast.Load())
        item = known.get(head)
        if isinstance(item, Option) and len(path) == 1:
            return ast.Constant(self.component.options.get(head, item.default))
        if isinstance(item, Parameter | State | Input | Output | Unknown) and len(path) == 1:
            return ast.Name(variable(self.name, head), ast.Load())
        if isinstance(item, Port) and len(path) == 2:
            if path[1] not in item.units:
                hint = nearest(path[1], item.units)
                raise EquationError(f"{where}: a {item.domain} port has no '{path[1]}'{hint}")
            return ast.Name(variable(self.name, head, path[1]), ast.Load())
        raise EquationError(f"{where}: 'self.{'.'.join(path)}' is not declared{nearest(head, known)}")


class Rewriter(ast.NodeTransformer):
    """Turn a method's body into statements over global names, refusing what the subset does not have."""

    def __init__(
        self, scope: Scope, function: Callable[..., Any], local_names: set[str], file: str, first_line: int
    ):
        self.scope = scope
        self.globals = function.__globals__  # type: ignore[attr-defined]
        self.closure = inspect.getclosurevars(function).nonlocals
        self.locals = local_names
        self.file = file
        self.first_line = first_line

    def where(self, node: ast.AST) -> str:
        line = self.first_line + getattr(node, "lineno", 1) - 1
        return f"{self.scope.name} ({type(self.scope.component).__name__}, {self.file}:{line})"

    def refuse(self, node: ast.AST, why: str) -> EquationError:
        return EquationError(f"{self.where(node)}: {why}: '{ast.unparse(node).splitlines()[0]}'")

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        path: list[str] = []
        inner: ast.expr = node
        while isinstance(inner, ast.Attribute):
            path.insert(0, inner.attr)
            inner = inner.value
        if isinstance(inner, ast.Name) and inner.id == "self":
            found = self.scope.attribute(path, self.where(node))
            if isinstance(found, ast.Name):
                return ast.Name(found.id, node.ctx)
            if isinstance(node.ctx, ast.Store):
                raise self.refuse(node, "an option cannot be assigned")
            return found
        if isinstance(inner, ast.Name) and inner.id == "math" and len(path) == 1 and hasattr(math, path[0]):
            constant = getattr(math, path[0])
            if isinstance(constant, float):
                return ast.Constant(constant)
        raise self.refuse(node, "only attributes of self and of math can be used in equations")

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if node.id in self.locals:
            return ast.Name(variable(self.scope.name, node.id), node.ctx)
        if node.id not in self.globals and node.id not in self.closure:
            raise self.refuse(node, f"'{node.id}' is not defined")
        value = self.closure.get(node.id, self.globals.get(node.id))
        if isinstance(value, bool | int | float):
            return ast.Constant(value)
        raise self.refuse(node, f"'{node.id}' is a {type(value).__name__}; equations can use numbers only")

    def visit_Call(self, node: ast.Call) -> ast.expr:
        if node.keywords or any(isinstance(a, ast.Starred) for a in node.args):
            raise self.refuse(node, "calls in equations take plain positional arguments")
        args = [self.visit(a) for a in node.args]
        func = node.func
        if isinstance(func, ast.Attribute) and isinstance(func.value, ast.Name) and func.value.id == "math":
            if func.attr not in MATH_FUNCTIONS:
                raise self.refuse(node, f"math.{func.attr} is not available in equations")
            return ast.Call(func, args, [])
        if isinstance(func, ast.Attribute) and isinstance(func.value, ast.Name) and func.value.id == "self":
            table = self.scope.component.declarations.get(func.attr)
            if not isinstance(table, Table) or len(args) != 1:
                raise self.refuse(node, "only a declared table can be called on self, with one argument")
            return self.table_call(func.attr, table, args[0])
        if isinstance(func, ast.Name):
            if func.id in BUILTIN_FUNCTIONS:
                return ast.Call(ast.Name(func.id, ast.Load()), args, [])
            kernel = self.closure.get(func.id, self.globals.get(func.id))
            if inspect.isfunction(kernel):
                return ast.Call(ast.Name(self.kernel_name(func.id, kernel, node), ast.Load()), args, [])
        raise self.refuse(node, "only math.*, abs, min, max, tables and plain functions can be called")

    def kernel_name(self, name: str, kernel: Callable[..., Any], node: ast.AST) -> str:
        name = f"k_{kernel.__module__.replace('.', '_')}_{name}"
        self.scope.kernels[name] = kernel
        return name

    def table_call(self, name: str, table: Table, argument: ast.expr) -> ast.expr:
        from multibody import tables

        kernel = tables.linear if table.interpolation == "linear" else tables.cubic
        kernel_name = f"k_tables_{kernel.__name__}"
        self.scope.kernels[kernel_name] = kernel
        start, size = (ast.Name(variable(self.scope.name, name, what), ast.Load()) for what in ("start", "size"))
        return ast.Call(ast.Name(kernel_name, ast.Load()), [ast.Name("p", ast.Load()), start, size, argument], [])

    def visit_If(self, node: ast.If) -> Any:
        test = self.visit(node.test)
        verdict = fold(test)
        if verdict is not None:
            kept = node.body if verdict else node.orelse
            return [out for item in kept for out in as_list(self.visit(item))] or ast.Pass()
        body = [out for item in node.body for out in as_list(self.visit(item))]
        orelse = [out for item in node.orelse for out in as_list(self.visit(item))]
        return ast.If(test, body, orelse)

    def visit_IfExp(self, node: ast.IfExp) -> ast.expr:
        test = self.visit(node.test)
        verdict = fold(test)
        if verdict is not None:
            return self.visit(node.body if verdict else node.orelse)
        return ast.IfExp(test, self.visit(node.body), self.visit(node.orelse))

    def visit_For(self, node: ast.For) -> ast.stmt:
        call = node.iter
        fixed = isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "range"
        if not fixed or node.orelse:
            raise self.refuse(node, "only 'for i in range(...)' with a fixed count is available")
        bounds = [self.visit(a) for a in call.args]  # type: ignore[union-attr]
        if not all(isinstance(b, ast.Constant) and isinstance(b.value, int) for b in bounds):
            raise self.refuse(node, "the count of a loop must be a whole number or an option")
        body = [out for item in node.body for out in as_list(self.visit(item))]
        return ast.For(self.visit(node.target), ast.Call(ast.Name("range", ast.Load()), bounds, []), body, [])

    def visit_Assign(self, node: ast.Assign) -> ast.stmt:
        if len(node.targets) != 1:
            raise self.refuse(node, "assign to one name at a time")
        return ast.Assign([self.visit(node.targets[0])], self.visit(node.value))

    def visit_Expr(self, node: ast.Expr) -> Any:
        if isinstance(node.value, ast.Constant):
            return None  # a docstring
        raise self.refuse(node, "a line must assign something")

    def generic_visit(self, node: ast.AST) -> Any:
        allowed = (
            ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.Constant, ast.Tuple, ast.operator, ast.unaryop,
            ast.boolop, ast.cmpop, ast.expr_context, ast.Pass,
        )
        if not isinstance(node, allowed):
            raise self.refuse(node, f"{type(node).__name__} is outside the subset for equations")
        if isinstance(node, ast.BinOp) and not isinstance(
            node.op, ast.Add | ast.Sub | ast.Mult | ast.Div | ast.Pow | ast.Mod
        ):
            raise self.refuse(node, "this operator is outside the subset for equations")
        return super().generic_visit(node)


def as_list(item: Any) -> list[Any]:
    """Return a visitor's answer as a list of statements."""
    if item is None or isinstance(item, ast.Pass):
        return []
    return item if isinstance(item, list) else [item]


def fold(test: ast.expr) -> bool | None:
    """Return the truth of a test made of constants only, or None."""
    if any(isinstance(n, ast.Name | ast.Call) for n in ast.walk(test)):
        return None

    def value(node: ast.expr) -> Any:
        if isinstance(node, ast.Constant):
            return node.value
        if isinstance(node, ast.UnaryOp):
            inner = value(node.operand)
            return (not inner) if isinstance(node.op, ast.Not) else -inner
        if isinstance(node, ast.BoolOp):
            parts = [bool(value(v)) for v in node.values]
            return all(parts) if isinstance(node.op, ast.And) else any(parts)
        if isinstance(node, ast.Compare) and len(node.ops) == 1:
            left, right = value(node.left), value(node.comparators[0])
            table: dict[type, Callable[[Any, Any], bool]] = {
                ast.Eq: lambda a, b: a == b, ast.NotEq: lambda a, b: a != b,
                ast.Lt: lambda a, b: a < b, ast.LtE: lambda a, b: a <= b,
                ast.Gt: lambda a, b: a > b, ast.GtE: lambda a, b: a >= b,
            }
            if type(node.ops[0]) in table:
                return table[type(node.ops[0])](left, right)
        raise EquationError(f"cannot decide '{ast.unparse(node)}' before the simulation")

    return bool(value(test))


def parse_function(function: Callable[..., Any]) -> tuple[ast.FunctionDef, str, int]:
    """Return a function's syntax tree, file name and first line."""
    try:
        lines, first = inspect.getsourcelines(function)
    except (OSError, TypeError) as error:
        raise EquationError(
            f"the source of '{function.__qualname__}' cannot be read: define the class in a file"
        ) from error
    tree = ast.parse(textwrap.dedent("".join(lines)))
    node = tree.body[0]
    if not isinstance(node, ast.FunctionDef):
        raise EquationError(f"'{function.__qualname__}' is not a plain function")
    file = (inspect.getsourcefile(function) or "?").replace("\\", "/").rsplit("/", 1)[-1]
    return node, file, first


def _is_super_call(node: ast.stmt, method: str) -> bool:
    call = node.value if isinstance(node, ast.Expr) else None
    return (
        isinstance(call, ast.Call) and isinstance(call.func, ast.Attribute) and call.func.attr == method
        and isinstance(call.func.value, ast.Call) and isinstance(call.func.value.func, ast.Name)
        and call.func.value.func.id == "super"
    )


def method_statements(scope: Scope, method: str) -> list[Statement]:
    """Read one of a component's methods as statements over global names.

    Parameters
    ----------
    scope : Scope
        Names of the component; called functions are added to ``scope.kernels``.
    method : str
        ``"equations"``, ``"coupling"`` or ``"coupling_inverse"``.

    Raises
    ------
    EquationError
        If the text steps outside the subset; the message has component, file and line.
    """
    cls = type(scope.component)
    owners = [base for base in cls.__mro__ if method in vars(base) and base is not Component]
    return _statements_of(scope, method, owners) if owners else []


def _statements_of(scope: Scope, method: str, owners: list[type]) -> list[Statement]:
    function = vars(owners[0])[method]
    node, file, first = parse_function(function)
    rewriter = Rewriter(scope, function, names_written(node), file, first)
    found: list[Statement] = []
    for item in node.body:
        if _is_super_call(item, method):
            found += _statements_of(scope, method, owners[1:]) if len(owners) > 1 else []
            continue
        origin = rewriter.where(item)
        for out in as_list(rewriter.visit(item)):
            ast.fix_missing_locations(out)
            found.append(Statement([out], names_read(out), names_written(out), origin))
    return _merge_repeated(found)


def _merge_repeated(statements: list[Statement]) -> list[Statement]:
    """Keep statements together that assign the same name more than once (an accumulation)."""
    merged: list[Statement] = []
    for statement in statements:
        for k, earlier in enumerate(merged):
            if earlier.writes & statement.writes:
                group = [*merged[k:], statement]
                writes = set().union(*(s.writes for s in group))
                first_read: set[str] = set()
                done: set[str] = set()
                for s in group:
                    first_read |= s.reads - done
                    done |= s.writes
                nodes = [n for s in group for n in s.nodes]
                merged[k:] = [Statement(nodes, first_read, writes, earlier.origin)]
                break
        else:
            merged.append(statement)
    for statement in merged:  # names that a compound makes for itself are not read from outside
        if len(statement.nodes) == 1 and isinstance(statement.nodes[0], ast.If | ast.For):
            statement.reads -= statement.writes & _written_before_read(statement.nodes[0])
    return merged


def _written_before_read(node: ast.stmt) -> set[str]:
    """Return the names that a compound statement assigns before it reads them, on every path."""
    if isinstance(node, ast.For):
        inner = names_written(node.target)
        return inner | _sequence_written_before_read(node.body)
    if isinstance(node, ast.If):
        branches = [_sequence_written_before_read(b) for b in (node.body, node.orelse)]
        read = [set().union(*(names_read(s) for s in b)) if b else set() for b in (node.body, node.orelse)]
        return {
            n for n in branches[0] | branches[1]
            if all(n in w or n not in r for w, r in zip(branches, read, strict=True))
        } - names_read(node.test)
    return set()


def _sequence_written_before_read(body: list[ast.stmt]) -> set[str]:
    read: set[str] = set()
    written: set[str] = set()
    for item in body:
        inner = _written_before_read(item) if isinstance(item, ast.If | ast.For) else set()
        read |= names_read(item) - written - inner
        written |= names_written(item) - read
    return written
