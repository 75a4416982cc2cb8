"""Functions that equations call: their text in the generated source, with their tangents."""

from __future__ import annotations

import ast
import textwrap
from collections.abc import Callable, Iterable
from functools import cache
from typing import Any

from multibody.base.errors import EquationError
from multibody.declare.component import Component
from multibody.declare.source_text import function_lines
from multibody.equations import tables
from multibody.equations.differentiate import Differentiator, active_names, d
from multibody.equations.reading import parse_function
from multibody.equations.rewriter import Rewriter
from multibody.equations.scope import Scope
from multibody.equations.statements import Statement, flow, names_written

__all__ = ["kernel_sources", "plain_function", "tangent_name"]

Kernels = dict[str, Callable[..., Any]]


def tangent_name(kernel: str) -> str:
    """Return the name of a kernel's tangent function."""
    return f"{kernel}_tangent"


class _KernelRewriter(Rewriter):
    """As for equations, but names stay local and the function returns."""

    def where(self, node: ast.AST) -> str:
        line = self.first_line + getattr(node, "lineno", 1) - 1
        return f"function {self.scope.name} ({self.file}:{line})"

    def local_name(self, node: ast.Name) -> str:
        super().local_name(node)
        if node.id.startswith("_") and node.id != "_":
            raise self.refuse(node, f"'{node.id}' begins with an underscore: give the variable another name")
        return node.id

    def visit_Return(self, node: ast.Return) -> ast.stmt:
        if node.value is None:
            raise self.refuse(node, "a function called by equations returns a number")
        return ast.Return(self.visit(node.value))


def plain_function(name: str, function: Callable[..., Any], kernels: Kernels) -> ast.FunctionDef:
    """Return a function that equations call, rewritten; those that it calls are added to ``kernels``.

    Raises
    ------
    EquationError
        If it steps outside the subset.
    """
    node, file, first = parse_function(function)
    scope = Scope(node.name, Component(), kernels)
    arguments = [a.arg for a in node.args.args]
    if node.args.vararg or node.args.kwonlyargs or node.args.kwarg or node.args.defaults or node.args.posonlyargs:
        raise EquationError(f"function {node.name} ({file}:{first}) takes plain positional arguments only")
    rewriter = _KernelRewriter(scope, function, names_written(node) | set(arguments), file, first)
    for argument in node.args.args:
        rewriter.local_name(ast.copy_location(ast.Name(argument.arg, ast.Load()), argument))
    body = [out for item in node.body for out in rewriter.statement(item)]
    where = f"function {node.name} ({file}:{first})"
    paths = flow(body)
    if not paths.returns:
        raise EquationError(f"{where} must return on every path")
    if unset := sorted(paths.reads - set(arguments)):
        raise EquationError(f"{where}: '{unset[0]}' may be used before it has a value: assign it in every branch")
    args = ast.arguments([], [ast.arg(a) for a in arguments], None, [], [], None, [])
    out = ast.FunctionDef(name, args, body, [], type_params=[])  # type: ignore[call-arg]
    if len(set(_returned(out))) > 1:
        raise EquationError(f"{where} must return the same number of values everywhere")
    return out


def _returned(node: ast.FunctionDef) -> list[int]:
    """Return how many values each return statement gives."""
    values = [n.value for n in ast.walk(node) if isinstance(n, ast.Return)]
    return [len(v.elts) if isinstance(v, ast.Tuple) else 1 for v in values]


def _check_calls(nodes: Iterable[ast.stmt], counts: dict[str, int], where: str) -> None:
    """Refuse calls whose number of results is not the number of names that take them."""
    waiting: list[ast.AST] = list(nodes)
    unpacked: dict[int, int] = {}
    while waiting:  # the names of an assignment come before its value
        node = waiting.pop()
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Tuple):
            unpacked[id(node.value)] = len(node.targets[0].elts)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            returned, taken = counts.get(node.func.id, 1), unpacked.get(id(node), 1)
            if returned != taken:
                raise EquationError(f"{where}: '{node.func.id}' returns {returned} values, taken by {taken} names")
        for name in node._fields:
            value = getattr(node, name, None)
            if value.__class__ is list:
                waiting += [item for item in value if isinstance(item, ast.AST)]
            elif isinstance(value, ast.AST) and value._fields and value.__class__ is not ast.Name:
                waiting.append(value)


def _tangent(node: ast.FunctionDef) -> ast.FunctionDef:
    arguments = [a.arg for a in node.args.args]
    active = active_names(node.body, set(arguments))
    body = Differentiator(active, tangent_name).statements(node.body)
    both = [ast.arg(a) for a in (*arguments, *map(d, arguments))]
    args = ast.arguments([], both, None, [], [], None, [])
    return ast.FunctionDef(tangent_name(node.name), args, body, [], type_params=[])  # type: ignore[call-arg]


def _raw(name: str, function: Callable[..., Any]) -> str:
    text = textwrap.dedent("".join(function_lines(function)[0])).replace("interval(", "k_tables_interval(")
    return text.replace(f"def {function.__name__}(", f"def {name}(", 1)


def kernel_sources(kernels: Kernels, statements: Iterable[Statement] = ()) -> tuple[list[str], Callable[[], list[str]]]:
    """Return the texts of kernels, each before those that call it, and a function that returns their tangents.

    Parameters
    ----------
    kernels : dict
        Functions by the names under which the equations call them.
    statements : iterable of Statement
        Statements whose calls are checked.

    Raises
    ------
    EquationError
        If a function steps outside the subset, calls itself, or is used with a wrong number of values.
    """
    texts: list[str] = []
    of_tables: list[str] = []
    nodes: list[ast.FunctionDef] = []
    table_kernels = {n: f for n, f in kernels.items() if f in tables.TANGENTS}
    if table_kernels:
        texts.append(_raw("k_tables_interval", tables.interval).replace("k_tables_k_tables_", "k_tables_"))
    for name, function in sorted(table_kernels.items()):
        texts += [_raw(name, function), _raw(f"{name}_slope", tables.SLOPES[function])]
        of_tables.append(_raw(tangent_name(name), tables.TANGENTS[function]))
    with_text: dict[str, Any] = {
        n: f for n, f in kernels.items() if hasattr(f, "tangent_text")
    }  # written by the component itself
    for name, function in sorted(with_text.items()):
        texts.append(function.text(name))
        of_tables.append(function.tangent_text(tangent_name(name)))
    known = dict(kernels)
    plain: dict[str, ast.FunctionDef] = {}
    while pending := [n for n in known if n not in plain and n not in table_kernels and n not in with_text]:
        for name in pending:
            plain[name] = plain_function(name, known[name], known)
    counts = {name: _returned(node)[0] for name, node in plain.items()}
    counts |= {name: function.returned for name, function in with_text.items()}
    for name, node in plain.items():
        _check_calls(node.body, counts, f"function {name}")
    for statement in statements:
        _check_calls(statement.nodes, counts, statement.origin)
    done: set[str] = set()

    def emit(name: str, above: tuple[str, ...]) -> None:
        if name in above:
            circle = " → ".join([*above[above.index(name) :], name])
            raise EquationError(f"functions called by equations may not call each other in a circle: {circle}")
        if name in done:
            return
        node = plain[name]
        called = {n.func.id for n in ast.walk(node) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
        for inner in sorted(called & plain.keys()):
            emit(inner, (*above, name))
        done.add(name)
        texts.append(ast.unparse(ast.fix_missing_locations(node)))
        nodes.append(node)

    for name in sorted(plain):
        emit(name, ())

    @cache
    def tangents() -> list[str]:
        return of_tables + [ast.unparse(ast.fix_missing_locations(_tangent(node))) for node in nodes]

    return texts, tangents
