"""Modules that files name: ``module:Class`` in a model's file, ``module:function`` in a study's."""

from __future__ import annotations

import importlib
import warnings
from types import ModuleType

__all__ = ["module_named"]


def current_name(name: str) -> str:
    """Return the present name of a module, given one that it may have had in an earlier version.

    A package lists the modules that have moved in a dict ``MOVED``, old name to new name, in its ``__init__``.

    Parameters
    ----------
    name : str
        Dotted name of a module.

    Raises
    ------
    ImportError
        If the package of that name cannot be imported.
    """
    package = importlib.import_module(name.partition(".")[0])
    moved: dict[str, str] = getattr(package, "MOVED", {})
    return moved.get(name, name)


def module_named(name: str) -> ModuleType:
    """Import a module by the name in a file, and warn where that name is an old one.

    Parameters
    ----------
    name : str
        Dotted name of a module.

    Raises
    ------
    ImportError
        If there is no such module, or it cannot be imported.
    """
    current = current_name(name)
    if current != name:
        text = f"module '{name}' is now '{current}': write the new name in the file"
        warnings.warn(text, FutureWarning, stacklevel=2)
    return importlib.import_module(current)
