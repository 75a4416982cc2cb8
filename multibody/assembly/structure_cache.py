"""Equations kept within a process: models that differ in nothing but the values of parameters have the same ones.

A search builds a model twice for every fit, with all outputs and with the measured ones, and again for every strength
that a fit begins from.  Their texts are the same, and to write them costs more than many a simulation.
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

__all__ = ["Unknown", "forget", "keep", "recall", "said", "structure_of", "with_values_of"]

Kept = TypeVar("Kept")

KEPT = 16  # assemblies and plans of a process
READ = ("equations", "coupling", "coupling_inverse")

_kept: OrderedDict[Any, Any] = OrderedDict()
_lock = threading.Lock()


class Unknown(Exception):
    """Something that a key cannot tell apart from its like."""


def said(value: Any) -> str:
    """Return a text that is the same for equal values only.

    Raises
    ------
    Unknown
        If there is none for a value of this kind.

    Examples
    --------
    >>> said({"order": 2, "points": (0.0, 1.5)})
    "{'order':2,'points':(0.0,1.5)}"
    """
    if value is None or isinstance(value, str | bool | int | float):
        return repr(value)
    if isinstance(value, dict):
        return "{" + ",".join(f"{said(k)}:{said(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "(" + ",".join(map(said, value)) + ")"
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        return f"{value.shape}{digest_of(value.tobytes().hex())}"
    raise Unknown


def structure_of(model: ModelGraph) -> tuple[Any, ...] | None:
    """Return all that a model's equations follow from: everything but the values of its components' parameters.

    None where that cannot be told, or the model has a fault.  Start values and tables count, and the parameters of a
    component that writes its equations itself.
    """
    parts: list[Any] = [model.name]
    if model.declared_faults:
        return None
    try:
        for name, component in model.components.items():
            if component.faults:
                return None
            left_out = {"declarations", "values", "_given"}
            if hasattr(component, "assemble"):
                left_out.remove("values")
            own = {k: v for k, v in vars(component).items() if k not in left_out}
            kind = type(component)
            parts += [name, kind, _texts(kind), tuple(component.declarations), tuple(component.values), said(own)]
        parts += [said(each) for each in (model.connections, model.outputs, model.features)]
    except Unknown:
        return None
    return (*parts, *(repr(dataclasses.replace(given, unit="")) for given in model.inputs.values()))


def _texts(kind: type) -> tuple[Any, ...]:
    """Return the methods that are read as text, of a class and of what it is derived from."""
    return tuple(vars(base).get(method) for base in kind.__mro__[:-1] for method in READ)


def with_values_of(model: ModelGraph, parameters: tuple[Quantity, ...]) -> tuple[Quantity, ...]:
    """Return the parameters of a model's structure with the values that they have in the model."""
    values = {f"{owner}.{name}": v for owner, c in model.components.items() for name, v in c.values.items()}
    return tuple(dataclasses.replace(q, value=values[q.name]) if q.name in values else q for q in parameters)


def recall(key: Any) -> Any | None:
    """Return what was kept under a key, or None."""
    with _lock:
        if key in _kept:
            _kept.move_to_end(key)
        return _kept.get(key)


def keep(key: Any, value: Kept) -> Kept:
    """Keep something under a key, in the place of what has not been asked for longest, and return it."""
    with _lock:
        _kept[key] = value
        while len(_kept) > KEPT:
            _kept.popitem(last=False)
    return value


def forget() -> None:
    """Forget everything that was kept."""
    with _lock:
        _kept.clear()
