"""Functions that equations call: their text taken over into the generated source, with their tangents."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable
from typing import Any

from multibody import tables
from multibody.component import Component
from multibody.differentiate import Differentiator, active_names
from multibody.equations import Rewriter, Scope, names_written, parse_function
from multibody.errors import EquationError

__all__ = ["kernel_sources", "tangent_name"]


def tangent_name(kernel: str) -> str:
    """Return the name of a kernel's tangent function."""
    return f"{kernel}_tangent"


class _KernelRewriter(Rewriter):
    """As for equations, but names stay local and the function returns."""

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if node.id in self.locals:
            return ast.Name(node.id, node.ctx)
        return super().visit_Name(node)

    def visit_Return(self, node: ast.Return) -> ast.stmt:
        if node.value is None:
            raise self.refuse(node, "a function called by equations returns a number")
        return ast.Return(self.visit(node.value))


def _plain(name: str, function: Callable[..., Any], scope: Scope) -> ast.FunctionDef:
    node, file, first = parse_function(function)
    arguments = [a.arg for a in node.args.args]
    if node.args.vararg or node.args.kwonlyargs or node.args.kwarg or node.args.defaults:
        raise EquationError(f"{file}:{first}: '{node.name}' takes plain positional arguments only")
    rewriter = _KernelRewriter(scope, function, names_written(node) | set(arguments), file, first)
    body: list[ast.stmt] = []
    for item in node.body:
        out = rewriter.visit(item)
        body += out if isinstance(out, list) else [out] if out is not None else []
    args = ast.arguments([], [ast.arg(a) for a in arguments], None, [], [], None, [])
    return ast.FunctionDef(name, args, body, [], type_params=[])


def _tangent(node: ast.FunctionDef) -> ast.FunctionDef:
    arguments = [a.arg for a in node.args.args]
    active = active_names(node.body, set(arguments))
    body = Differentiator(active, tangent_name).statements(node.body)
    args = ast.arguments([], [ast.arg(a) for a in (*arguments, *(f"d_{a}" for a in arguments))], None, [], [], None, [])
    return ast.FunctionDef(tangent_name(node.name), args, body, [], type_params=[])


def _raw(name: str, function: Callable[..., Any]) -> str:
    text = textwrap.dedent(inspect.getsource(function))
    return text.replace(f"def {function.__name__}(", f"def {name}(", 1).replace("interval(", "k_tables_interval(")


def kernel_sources(kernels: dict[str, Callable[..., Any]]) -> tuple[list[str], list[str]]:
    """Return the texts of kernels and of their tangents, each before the ones that call it.

    Parameters
    ----------
    kernels : dict
        Functions by the names under which the equations call them.
    """
    plain: dict[str, ast.FunctionDef] = {}
    texts: list[str] = []
    tangents: list[str] = []
    table_kernels = {n: f for n, f in kernels.items() if f in tables.TANGENTS}
    if table_kernels:
        texts.append(_raw("k_tables_interval", tables.interval).replace("k_tables_k_tables_", "k_tables_"))
    for name, function in sorted(table_kernels.items()):
        texts.append(_raw(name, function))
        tangents.append(_raw(tangent_name(name), tables.TANGENTS[function]))
    pending = {n: f for n, f in kernels.items() if n not in table_kernels}
    calls: dict[str, set[str]] = {}
    while pending:
        name, function = pending.popitem()
        scope = Scope(name, Component())
        plain[name] = _plain(name, function, scope)
        calls[name] = set(scope.kernels)
        pending.update({n: f for n, f in scope.kernels.items() if n not in plain})
    done: set[str] = set()

    def emit(name: str, above: tuple[str, ...]) -> None:
        if name in above:
            raise EquationError(f"functions called by equations may not call each other in a circle: {name}")
        if name in done or name not in plain:
            return
        for inner in sorted(calls[name]):
            emit(inner, (*above, name))
        done.add(name)
        node = ast.fix_missing_locations(plain[name])
        texts.append(ast.unparse(node))
        tangents.append(ast.unparse(ast.fix_missing_locations(_tangent(node))))

    for name in sorted(plain):
        emit(name, ())
    return texts, tangents
