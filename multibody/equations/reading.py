"""Equations as text: a component's methods read as a list of statements over global names.

A component writes ``self.a.force = self.stiffness * (...)``.  Here that text becomes an assignment between
global variable names (``spring__a__force``), with options folded to constants and dead branches removed.
Constructs outside the subset (see the docs page "Writing a component") are refused with file and line.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable
from typing import Any

from multibody.base.errors import EquationError
from multibody.base.parsing import parse
from multibody.declare.component import Component
from multibody.declare.source_text import function_lines
from multibody.equations.rewriter import Rewriter
from multibody.equations.scope import Scope
from multibody.equations.statements import Statement, merge_repeated, names_written, readable

__all__ = ["method_statements", "parse_function"]


def parse_function(function: Callable[..., Any]) -> tuple[ast.FunctionDef, str, int]:
    """Return a function's syntax tree, file name and first line."""
    try:
        lines, first = function_lines(function)
        tree = parse(textwrap.dedent("".join(lines)))
    except (OSError, TypeError, SyntaxError) as error:
        raise EquationError(
            f"the source of '{function.__qualname__}' cannot be read: define the class in a file"
        ) from error
    node = tree.body[0]
    if not isinstance(node, ast.FunctionDef):
        raise EquationError(f"'{function.__qualname__}' is not a plain function: write it with def")
    file = (inspect.getsourcefile(function) or "?").replace("\\", "/").rsplit("/", 1)[-1]
    return node, file, first


def _is_super_call(node: ast.stmt, method: str) -> bool:
    call = node.value if isinstance(node, ast.Expr) else None
    return (
        isinstance(call, ast.Call)
        and isinstance(call.func, ast.Attribute)
        and call.func.attr == method
        and isinstance(call.func.value, ast.Call)
        and isinstance(call.func.value.func, ast.Name)
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
        If lines step outside the subset; the message has component, file and line of each.
    """
    cls = type(scope.component)
    owners = [base for base in cls.__mro__ if method in vars(base) and base is not Component]
    faults: list[str] = []
    statements = _statements_of(scope, method, owners, faults) if owners else []
    if not faults:
        statements = merge_repeated(statements)
        faults += _unassigned(scope, statements)
    if faults:
        raise EquationError("\n".join(dict.fromkeys(faults)))
    return statements


def _statements_of(scope: Scope, method: str, owners: list[type], faults: list[str]) -> list[Statement]:
    function = vars(owners[0])[method]
    try:
        node, file, first = parse_function(function)
    except EquationError as error:
        faults.append(f"component '{scope.name}': {error}")
        return []
    if [a.arg for a in ast.walk(node.args) if isinstance(a, ast.arg)] != ["self"]:
        faults.append(
            f"{scope.name} ({owners[0].__name__}, {file}:{first}): '{method}' must take self and nothing else"
        )
        return []
    kind = "".join(word[0] for word in method.split("_")) if method != "equations" else ""
    rewriter = Rewriter(
        scope, function, names_written(node), file, first, f"{kind}{len(owners)}", method != "equations"
    )
    statements: list[Statement] = []
    given: dict[str, str] = {}  # names whose value nothing has read yet, and where they got it
    for item in node.body:
        if _is_super_call(item, method):
            statements += _statements_of(scope, method, owners[1:], faults) if len(owners) > 1 else []
            continue
        origin = rewriter.where(item)
        try:
            read = [Statement.of([out], origin) for out in rewriter.statement(item)]
        except EquationError as error:
            faults.append(str(error))
            continue
        faults += _given_twice(scope, read, given)
        statements += read
    return statements


def _given_twice(scope: Scope, statements: list[Statement], given: dict[str, str]) -> list[str]:
    """Return the faults of names that get another value before anything has read the first, which then had no use."""
    faults = []
    for statement in statements:
        for name in statement.reads:
            given.pop(name, None)
        for name in sorted(n for n in statement.writes - statement.unsure if "___local" not in n):
            if name in given:
                shown = "self" + readable(name).removeprefix(scope.name)
                faults.append(
                    f"{statement.origin}: '{shown}' gets a second value, and nothing uses the first "
                    f"({given[name]}): remove one of the two, or add to the first with +="
                )
            given[name] = statement.origin.rpartition(", ")[2].rstrip(")")
    return faults


def _unassigned(scope: Scope, statements: list[Statement]) -> list[str]:
    """Return the faults of names that some path leaves without a value."""
    faults = []
    for statement in statements:
        used = {n for other in statements if other is not statement for n in other.reads} | statement.reads
        for name in sorted(statement.unsure):
            if "___local" in name and name not in used:
                continue
            shown = readable(name) if "___local" in name else "self" + readable(name).removeprefix(scope.name)
            faults.append(
                f"{statement.origin}: '{shown}' is assigned in one branch only: give it a value in every branch, "
                "or one before the branches"
            )
        for name in sorted(n for n in statement.reads & statement.writes - statement.unsure if "___local" in n):
            faults.append(
                f"{statement.origin}: '{readable(name)}' is used before it has a value: give it one in a line above"
            )
    return faults
