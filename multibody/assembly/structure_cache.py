"""Equations cached within a process: models that differ only in the values of parameters share them.

A search builds a model twice for every fit, with all outputs and with the measured ones, and again for every strength
that a fit starts from.  Their texts are the same, and to write them takes longer than many a simulation.
"""

from __future__ import annotations

import dataclasses
import threading
from collections import OrderedDict
from typing import Any, TypeVar

import numpy as np

from multibody.assembly.equation_set import Quantity
from multibody.base.cache import digest_of
from multibody.model.graph import ModelGraph

__all__ = ["NoKey", "clear", "lookup", "store", "structure_key", "value_key", "with_values_of"]

Value = TypeVar("Value")

CAPACITY = 16  # assemblies and plans in a process
READ = ("equations", "coupling", "coupling_inverse")

_stored: OrderedDict[Any, Any] = OrderedDict()
_lock = threading.Lock()


class NoKey(Exception):
    """A value of a kind that cannot be part of a key."""


def value_key(value: Any) -> str:
    """Return a text that only equal values share.

    Raises
    ------
    NoKey
        For a value of a kind that has none.

    Examples
    --------
    >>> value_key({"order": 2, "points": (0.0, 1.5)})
    "{'order':2,'points':(0.0,1.5)}"
    """
    if value is None or isinstance(value, str | bool | int | float):
        return repr(value)
    if isinstance(value, dict):
        return "{" + ",".join(f"{value_key(k)}:{value_key(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "(" + ",".join(map(value_key, value)) + ")"
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        return f"{value.shape}{digest_of(value.tobytes().hex())}"
    raise NoKey


def structure_key(model: ModelGraph) -> tuple[Any, ...] | None:
    """Return a key of a model's equations: everything but the values of its components' parameters.

    None where there is no such key, or the model has a fault.  Start values and tables are part of it, and so are the
    parameters of a component that writes its equations itself.
    """
    parts: list[Any] = [model.name]
    if model.declared_faults:
        return None
    try:
        for name, component in model.components.items():
            if component.faults:
                return None
            excluded = {"declarations", "values", "_given"}
            if hasattr(component, "assemble"):
                excluded.remove("values")
            own = {k: v for k, v in vars(component).items() if k not in excluded}
            kind = type(component)
            parts += [name, kind, _texts(kind), tuple(component.declarations), tuple(component.values), value_key(own)]
        parts += [value_key(item) for item in (model.connections, model.outputs, model.features)]
    except NoKey:
        return None
    return (*parts, *(repr(entry) for entry in model.inputs.values()))


def _texts(kind: type) -> tuple[Any, ...]:
    """Return the methods that are read as text, of a class and of what it is derived from."""
    return tuple(vars(base).get(method) for base in kind.__mro__[:-1] for method in READ)


def with_values_of(model: ModelGraph, parameters: tuple[Quantity, ...]) -> tuple[Quantity, ...]:
    """Return the parameters of a model's structure with the values that they have in the model."""
    values = {f"{owner}.{name}": v for owner, c in model.components.items() for name, v in c.values.items()}
    return tuple(dataclasses.replace(q, value=values[q.name]) if q.name in values else q for q in parameters)


def lookup(key: Any) -> Any | None:
    """Return the value stored under a key, or None."""
    with _lock:
        if key in _stored:
            _stored.move_to_end(key)
        return _stored.get(key)


def store(key: Any, value: Value) -> Value:
    """Store a value under a key, in the place of the least recently used one, and return it."""
    with _lock:
        _stored[key] = value
        while len(_stored) > CAPACITY:
            _stored.popitem(last=False)
    return value


def clear() -> None:
    """Remove everything that was stored."""
    with _lock:
        _stored.clear()
