"""What a `System` knows of its model's assembled equations, kept for the next process that builds the same model.

To put the equations of a lift together takes a fifth of a second, as much as all else that a new process needs beside
its imports.  Only the first builds of a process look into the cache and are kept there: later ones are mostly variants
that no other process builds.  Those are kept in memory: see `multibody.assembly.structure_cache`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from multibody.assembly.equation_set import Assembly, Quantity
from multibody.assembly.places import Place
from multibody.assembly.structure_cache import NoKey, lookup, store, structure_key, value_key, with_values_of
from multibody.base.cache import cache_dir, digest_of, kept_text, read_object, write_object
from multibody.model.features import speed_signals
from multibody.model.graph import ModelGraph

__all__ = ["Plan", "plan_of"]

FORMAT = "2"
BUILDS = 3  # of a process that look into the cache
KEPT = 200  # files in it
_GROUPS = ("states", "inputs", "parameters", "outputs")
_BASES = ("rhs", "outputs", "speeds")
_built = 0


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Names, values and texts of an assembled model.

    Parameters
    ----------
    states, inputs, parameters, outputs : tuple of Quantity
    speed_names : tuple of str
        See `multibody.system.narrow_features`.
    input_delays : dict
        Name of the parameter that delays an input, by the input's name.
    rate_states : dict
        Index of the state that is the rate of another state.
    texts : mapping of str
        See `multibody.compile.generate.Source`.
    sparsity : ndarray of bool, shape (n, n)
    places : tuple of Place, optional
        None where they are to be found anew.
    """

    states: tuple[Quantity, ...]
    inputs: tuple[Quantity, ...]
    parameters: tuple[Quantity, ...]
    outputs: tuple[Quantity, ...]
    speed_names: tuple[str, ...]
    input_delays: dict[str, str]
    rate_states: dict[int, int]
    texts: Mapping[str, str] = field(repr=False)
    sparsity: np.ndarray = field(repr=False)
    places: tuple[Place, ...] | None = field(repr=False, default=None)


def plan_of(model: ModelGraph, probes: bool, energy: bool, outputs: Iterable[str] | None) -> Plan:
    """Return the plan of a model, from the cache or assembled; for the arguments see `System`.

    Raises
    ------
    ModelError
        With every fault of the model.
    """
    global _built
    _built += 1
    outputs = None if outputs is None else tuple(outputs)
    path = None
    if _built <= BUILDS and not probes:
        with contextlib.suppress(NoKey, OSError):  # a model can be put together without a cache
            path = cache_dir() / f"plan_{_key(model, energy, outputs)}.json"
    if path is not None and (kept := read_object(path)) is not None:
        return _read(json.loads(kept[0]), lambda: _assembled(model, probes, energy, outputs))
    if path is None:
        return _remembered(model, probes, energy, outputs)
    made = _assembled(model, probes, energy, outputs)
    with contextlib.suppress(OSError):  # another process may clear the same folder
        _prune(path.parent)
        write_object(path, json.dumps(_written(made)).encode())
    return made


def _remembered(model: ModelGraph, probes: bool, energy: bool, outputs: tuple[str, ...] | None) -> Plan:
    """Return a plan whose equations, or all that they are chosen from, are those of an earlier build where possible."""
    from multibody.assembly.assemble import assemble, with_outputs

    structure = structure_key(model)
    if structure is None:
        return _assembled(model, probes, energy, outputs)
    key = (structure, probes, energy)
    plan = lookup((*key, outputs))
    if plan is None:
        whole = lookup(key)
        if whole is None:
            whole = assemble(model, probes=probes, energy=energy)
            if not whole.unknowns:  # whether implicit equations can be solved depends on the values
                store(key, whole)
        plan = _generated(model, whole if outputs is None else with_outputs(whole, model, outputs))
        if not whole.unknowns:
            store((*key, outputs), plan)
    return dataclasses.replace(plan, parameters=with_values_of(model, plan.parameters))


def _assembled(model: ModelGraph, probes: bool, energy: bool, outputs: tuple[str, ...] | None) -> Plan:
    from multibody.assembly.assemble import assemble

    return _generated(model, assemble(model, probes=probes, energy=energy, outputs=outputs))


def _generated(model: ModelGraph, work: Assembly) -> Plan:
    from multibody.compile.generate import generate

    speeds = speed_signals(model, {q.name for q in (*work.outputs, *work.states)})
    source = generate(work, speeds)
    by_variable = {q.variable: k for k, q in enumerate(work.states)}
    rates = {
        k: by_variable[work.derivatives[q.variable]]
        for k, q in enumerate(work.states)
        if work.derivatives[q.variable] in by_variable
    }
    return Plan(
        states=tuple(work.states),
        inputs=tuple(work.inputs),
        parameters=tuple(work.parameters),
        outputs=tuple(work.outputs),
        speed_names=speeds,
        input_delays=work.input_delays,
        rate_states=rates,
        texts=source.texts,
        sparsity=source.sparsity,
        places=tuple(work.places),
    )


# ---------------------------------------------------------------- as a file


def _written(plan: Plan) -> dict[str, Any]:
    return {
        **{name: [dataclasses.asdict(q) for q in getattr(plan, name)] for name in _GROUPS},
        "speed_names": plan.speed_names,
        "input_delays": plan.input_delays,
        "rate_states": list(plan.rate_states.items()),
        "texts": {name: plan.texts[name] for name in _BASES},
        "sparsity": plan.sparsity.astype(int).tolist(),
    }


def _read(content: dict[str, Any], assembled: Any) -> Plan:
    from multibody.compile.generate import Texts

    kept, fresh = content["texts"], cache(assembled)

    def text(name: str) -> str:
        if name in kept:
            return kept[name]
        return kept_text(name, (kept[name.partition("_")[0]],), lambda: fresh().texts[name])

    n = len(content["states"])
    groups: dict[str, Any] = {name: tuple(Quantity(**q) for q in content[name]) for name in _GROUPS}
    return Plan(
        **groups,
        speed_names=tuple(content["speed_names"]),
        input_delays=content["input_delays"],
        rate_states={int(k): int(rate) for k, rate in content["rate_states"]},
        texts=Texts((*_BASES, "rhs_tangent", "outputs_tangent", "rhs_columns"), text),
        sparsity=np.array(content["sparsity"], dtype=bool).reshape(n, n),
    )


def _prune(folder: Path) -> None:
    """Make room for another plan: the oldest go."""
    files = list(folder.glob("plan_*.json"))
    if len(files) >= KEPT:
        for path in sorted(files, key=lambda p: p.stat().st_mtime)[: len(files) - KEPT + 1]:
            path.unlink(missing_ok=True)


# ---------------------------------------------------------------- what a plan follows from


def _key(model: ModelGraph, energy: bool, outputs: tuple[str, ...] | None) -> str:
    parts = [FORMAT, sys.version, np.__version__, model.name, repr((energy, outputs)), _class(type(model))]
    for name, component in model.components.items():
        own = {k: v for k, v in vars(component).items() if k != "declarations"}
        parts += [name, _class(type(component)), value_key(own), repr(tuple(component.declarations))]
    parts += [value_key(part) for part in (model.connections, model.outputs, model.features)]
    parts += [repr(entry) for entry in model.inputs.values()]
    return digest_of(*parts, *(f"{given}" for given in model.declared_faults))


def _class(cls: type) -> str:
    """Return the name of a class of an installed package, with all that it is made of."""
    texts = []
    for base in cls.__mro__[:-1]:
        module = sys.modules.get(base.__module__)
        if getattr(module, base.__name__, None) is not base:  # made inside a function, or replaced
            raise NoKey
        file = getattr(module, "__file__", None)
        if any(f.__code__.co_filename != file for f in vars(base).values() if hasattr(f, "__code__") and _equations(f)):
            raise NoKey
        texts.append(f"{base.__module__}.{base.__name__} {_package(base.__module__.partition('.')[0])}")
    return "\n".join(texts)


def _equations(function: Any) -> bool:
    return function.__name__ in ("equations", "coupling", "coupling_inverse")


@lru_cache(maxsize=32)
def _package(name: str) -> str:
    """Return what changes with every file of a package, as Python's own cache of byte code sees it."""
    folders = [str(folder) for folder in getattr(sys.modules.get(name), "__path__", ())]
    if not folders:
        raise NoKey
    files = []
    for folder in folders:
        for place, _, names in os.walk(folder):
            for item in names:
                if item.endswith(".py"):
                    stat = os.stat(os.path.join(place, item))
                    files.append(f"{place}/{item} {stat.st_mtime_ns} {stat.st_size}")
    return digest_of(*sorted(files))
