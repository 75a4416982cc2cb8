"""What the names in a component's equations stand for: ``self.a.force`` becomes the variable ``spring__a__force``."""

from __future__ import annotations

import ast
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from multibody.base.errors import EquationError
from multibody.base.spelling import nearest
from multibody.declare.component import Component
from multibody.declare.declarations import Input, Option, Output, Parameter, Port, State, Table, Unknown
from multibody.equations.statements import constant, variable

__all__ = ["Scope"]


@dataclass
class Scope:
    """The variables behind the names in one component's equations, and the functions that they call.

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
                    f"{where}: 'self.der.{path[1]}' is not the rate of a declared state: declare one{hint}"
                )
            return ast.Name(variable(self.name, "_der", path[1]), ast.Load())
        if head == "zero" and len(path) == 2:
            if not isinstance(known.get(path[1]), Unknown):
                hint = nearest(path[1], self.component.of_kind(Unknown))
                raise EquationError(
                    f"{where}: 'self.zero.{path[1]}' is not the equation of a declared unknown: declare one{hint}"
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
            hint = nearest(path[-1], item.units) or f"; name one of {', '.join(item.units)}"
            what = f"has no '{path[1]}'" if len(path) == 2 else f"is used by its quantities (self.{head}.…)"
            raise EquationError(f"{where}: 'self.{'.'.join(path)}': a {item.domain} port {what}{hint}")
        if isinstance(item, Table):
            raise EquationError(f"{where}: table 'self.{head}' is used by calling it, self.{head}(…)")
        raise EquationError(f"{where}: 'self.{'.'.join(path)}' is not declared: declare it{nearest(head, known)}")

    def _own_names(self, path: list[str]) -> list[str]:
        """Return a path with the name of a port's quantity in its own domain, for laws of both domains."""
        item = self.component.declarations.get(path[0])
        return [path[0], item.generic.get(path[1], path[1])] if isinstance(item, Port) and len(path) == 2 else path

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
            return "time cannot be assigned: use another name"
        kind = type(item).__name__.lower()
        article = "an" if kind[0] in "aeiou" else "a"
        return f"{article} {kind} cannot be assigned: use another name for the result"
