"""Source units: the functions of one text or module, and what their names mean."""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from multibody.base.parsing import parse
from multibody.compile.emitter.kinds import Outside

__all__ = ["Unit", "unit_of_function", "unit_of_text"]


@dataclass(frozen=True, eq=False)
class Unit:
    """Functions by name, and the other names that they may use.

    Parameters
    ----------
    name : str
        For messages and symbols.
    functions : dict of ast.FunctionDef
    values : mapping
        Constants, constant arrays, functions of other modules, and what stands for an instruction.
    flat : bool
        True writes functions out where they are called, so that loops around them can become vectors.
    """

    name: str
    functions: dict[str, ast.FunctionDef]
    values: dict[str, Any] = field(default_factory=dict)
    flat: bool = False

    def fused(self, name: str) -> bool:
        """Tell whether products and sums of a function may be rounded once."""
        return bool(getattr(self.values.get(name), "fused", False))

    def meaning(self, name: str) -> Any:
        """Return what a name means that no statement assigns.

        Raises
        ------
        Outside
            If nothing is known of it.
        """
        if name in self.functions:
            return (self, name)
        if name not in self.values:
            raise Outside(f"'{name}' is not defined in {self.name}")
        value = self.values[name]
        function = getattr(value, "py_func", value)
        if inspect.isfunction(function) and not hasattr(value, "instruction"):
            return unit_of_function(function)
        return value


def _functions(tree: ast.Module) -> dict[str, ast.FunctionDef]:
    return {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}


def unit_of_text(text: str, name: str) -> Unit:
    """Return the functions of a generated text, which uses `math` and itself alone."""
    tree = parse(text)
    loops = (n.iter.func for n in ast.walk(tree) if isinstance(n, ast.For) and isinstance(n.iter, ast.Call))
    flat = any(isinstance(f, ast.Name) and f.id == "independent" for f in loops)
    return Unit(name, _functions(tree), flat=flat)


@lru_cache(maxsize=64)
def _module_unit(name: str) -> Unit:
    module = sys.modules[name]
    return Unit(name, _functions(parse(inspect.getsource(module))), vars(module))


def unit_of_function(function: Callable[..., Any]) -> tuple[Unit, str]:
    """Return the unit of a function of an imported module, and the function's name in it."""
    unit = _module_unit(function.__module__)
    if function.__name__ not in unit.functions:
        raise Outside(f"{function.__module__}.{function.__qualname__} is not at the top of a module")
    return unit, function.__name__
