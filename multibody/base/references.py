"""Modules that files name: ``module:Class`` in a model's file, ``module:function`` in a study's."""

from __future__ import annotations

import importlib
import sys
import warnings
from functools import lru_cache
from importlib import metadata
from types import ModuleType

__all__ = ["EFFECTS_GROUP", "MODELS_GROUP", "OWN", "is_in_offered", "is_offered", "module_named", "offered_modules"]

MODELS_GROUP = "vtsdt.models"
"""Entry points by which an installed package says that a module of it offers models and components to files."""
EFFECTS_GROUP = "vtsdt.effects"
"""Entry points by which an installed package says that importing a module of it adds effects to the catalogue."""
OWN = ("multibody", "estimation", "surrogate", "discrepancy", "operation", "vtsdt", "gearbox")
"""Packages of this distribution."""


@lru_cache(maxsize=8)
def offered_modules(group: str = MODELS_GROUP) -> tuple[str, ...]:
    """Return the modules that installed packages offer by an entry point of a group.

    Parameters
    ----------
    group : str
        `MODELS_GROUP` or `EFFECTS_GROUP`.
    """
    return tuple(sorted({entry.value.partition(":")[0] for entry in metadata.entry_points(group=group)}))


def is_offered(name: str) -> bool:
    """Tell whether a file may name a module: one of this distribution, one offered, or one already imported.

    Importing runs a module, so that a file from elsewhere must not choose freely among all that is installed.

    Parameters
    ----------
    name : str
        Dotted name of a module.

    Examples
    --------
    >>> is_offered("multibody.library"), is_offered("antigravity")
    (True, False)
    """
    return name.partition(".")[0] in OWN or name in sys.modules or is_in_offered(name)


def is_in_offered(name: str) -> bool:
    """Tell whether a module is one that an installed package offers, or lies in one.

    Parameters
    ----------
    name : str
        Dotted name of a module.
    """
    offered = (module for group in (MODELS_GROUP, EFFECTS_GROUP) for module in offered_modules(group))
    return any(name == module or name.startswith(f"{module}.") for module in offered)


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
