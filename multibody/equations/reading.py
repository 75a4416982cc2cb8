"""Equations as text: a component's methods read as a list of statements over global names.

A component writes ``self.a.force = self.stiffness * (...)``.  Here that text becomes an assignment between
global variable names (``spring__a__force``), with options folded to constants and dead branches removed.
What lies outside the subset (see the docs page "Writing a component") is refused with file and line.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from multibody.base.errors import EquationError
from multibody.base.parsing import parse
from multibody.base.spelling import nearest
from multibody.declare.component import Component
from multibody.declare.declarations import Input, Option, Output, Parameter, Port, State, Table, Unknown
from multibody.declare.source_text import function_lines
from multibody.equations.rewriter import Rewriter, constant
from multibody.equations.statements import Statement, merge_repeated, names_written, readable, variable

__all__ = ["Scope", "method_statements", "parse_function"]


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
        path = self._own_names(path)
        head = path[0]
        if path == ["time"]:
            return ast.Name("t", ast.Load())
        if head == "der" and len(path) == 2:
            if not isinstance(known.get(path[1]), State):
                hint = nearest(path[1], self.component.of_kind(State))
                raise EquationError(
                    f"{where}: 'self.der.{path[1]}' is not the rate of a declared state{hint}"
                )
            return ast.Name(variable(self.name, "_der", path[1]), ast.Load())
        if head == "zero" and len(path) == 2:
            if not isinstance(known.get(path[1]), Unknown):
                hint = nearest(path[1], self.component.of_kind(Unknown))
                raise EquationError(
                    f"{where}: 'self.zero.{path[1]}' is not the equation of a declared unknown{hint}"
                )
            return ast.Name(variable(self.name, "_zero", path[1]), ast.Load())
        item = known.get(head)
        if isinstance(item, Option) and len(path) == 1:
            return constant(self.component.options.get(head, item.default))
        if isinstance(item, Parameter | State | Input | Output | Unknown) and len(path) == 1:
            return ast.Name(variable(self.name, head), ast.Load())
        if isinstance(item, Port):
            if len(path) == 2 and path[1] in item.units:
                return ast.Name(variable(self.name, head, path[1]), ast.Load())
            hint = nearest(path[-1], item.units) or f"; it has {', '.join(item.units)}"
            what = f"has no '{path[1]}'" if len(path) == 2 else f"is used by its quantities (self.{head}.…)"
            raise EquationError(f"{where}: 'self.{'.'.join(path)}': a {item.domain} port {what}{hint}")
        if isinstance(item, Table):
            raise EquationError(f"{where}: table 'self.{head}' is used by calling it, self.{head}(…)")
        raise EquationError(f"{where}: 'self.{'.'.join(path)}' is not declared{nearest(head, known)}")

    def _own_names(self, path: list[str]) -> list[str]:
        """Return a path in which a port's quantity has the name of the port's domain, for laws of both
        domains.
        """
        item = self.component.declarations.get(path[0])
        return (
            [path[0], item.generic.get(path[1], path[1])]
            if isinstance(item, Port) and len(path) == 2
            else path
        )

    def why_not_assigned(self, path: list[str], coupling: bool) -> str | None:
        """Return why ``self.<path>`` cannot stand on the left of an equation, or None if it can."""
        path = self._own_names(path)
        item = self.component.declarations.get(path[0])
        if path[0] in ("der", "zero") or isinstance(item, Output):
            return None
        if isinstance(item, State | Unknown):
            key = "der" if isinstance(item, State) else "zero"
            kind = "its rate" if isinstance(item, State) else "what has to vanish"
            return f"'{item.name}' is not assigned, {kind} is: self.{key}.{item.name} = …"
        if isinstance(item, Port):
            given = {item.potential, item.rate, "acceleration"}
            if coupling and path[1] == item.potential:
                return None
            if path[1] in (item.flow, *getattr(item, "flows", ())) or (
                getattr(item, "prescribed", False) and path[1] in given
            ):
                return None
            if path[1] in given:
                return f"the {path[1]} of a port is shared: declare the port with prescribed=True to give it"
            return f"'{path[1]}' of a port follows from the others and cannot be assigned"
        if path == ["time"]:
            return "time cannot be assigned"
        kind = type(item).__name__.lower()
        article = "an" if kind[0] in "aeiou" else "a"
        return f"{article} {kind} cannot be assigned: use another name for the result"


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
    kind = "".join(word[0] for word in method.split("_")) if method != "equations" else ""
    rewriter = Rewriter(
        scope, function, names_written(node), file, first, f"{kind}{len(owners)}", method != "equations"
    )
    found: list[Statement] = []
    for item in node.body:
        if _is_super_call(item, method):
            found += _statements_of(scope, method, owners[1:], faults) if len(owners) > 1 else []
            continue
        origin = rewriter.where(item)
        try:
            found += [Statement.of([out], origin) for out in rewriter.statement(item)]
        except EquationError as error:
            faults.append(str(error))
    return found


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
                f"{statement.origin}: '{shown}' is assigned in one branch only: give it a value in every "
                "branch, "
                "or one before the branches"
            )
        for name in sorted(
            n for n in statement.reads & statement.writes - statement.unsure if "___local" in n
        ):
            faults.append(f"{statement.origin}: '{readable(name)}' is used before it has a value")
    return faults
