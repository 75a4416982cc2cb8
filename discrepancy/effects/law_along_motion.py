"""The forces of a law along a motion that is given, without a machine."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.effects.effect import law_class
from discrepancy.effects.kinds import Kind
from multibody.base.parallel import parallel_map
from multibody.inputs.table import InputTable
from multibody.solvers import integrate
from multibody.system.simulate import native_problem

if TYPE_CHECKING:
    from multibody.machine.model import System

__all__ = ["MOTION", "has_memory", "law_forces"]

MOTION = ("position", "velocity", "acceleration")


@lru_cache(maxsize=128)
def _law_system(kind: Kind) -> System:
    """Return a flange moved from outside against the ground with the kind's law between them."""
    from multibody.library import PositionSource
    from multibody.machine.model import Model

    model = Model("law")
    moved = model.add("moved", PositionSource())
    part = model.add("effect", law_class(kind, "translation")())
    model.connect(part.a, moved.flange)
    model.connect(part.b, model.ground)
    for signal in MOTION:
        model.input(signal, f"moved.{signal}", default=0.0)
    if kind.law_input:
        model.input("load", getattr(part, kind.law_input), default=0.0)
    return model.build(outputs=("effect.force",))


def has_memory(kind: Kind) -> bool:
    """Tell whether a kind's law has a state of its own: its force is no function of the motion at the same time."""
    return kind.law != "AddedInertia" and bool(_law_system(kind).states)


def law_forces(
    kind: Kind,
    time: np.ndarray,
    motion: dict[str, np.ndarray],
    shapes: Sequence[dict[str, float]],
    strengths: Sequence[dict[str, float]],
) -> np.ndarray:
    """Return the forces of a law on side a along a motion, shape (number of shapes, nt).

    Parameters
    ----------
    kind : Kind
    time : ndarray, shape (nt,), s
    motion : dict
        ``position``, ``velocity``, ``acceleration`` and, where the law asks for it, ``load``, a temperature for laws
        that take one; each (nt,).
    shapes, strengths : sequence of dict
        The law's parameters, as many of the one as of the other.
    """
    if kind.law == "AddedInertia":
        return np.array([-s["inertia"] * motion["acceleration"] for s in strengths])
    system = _law_system(kind)
    every = [
        system.parameter_vector({f"effect.{k}": v for k, v in {**shape, **strength}.items()})
        for shape, strength in zip(shapes, strengths, strict=True)
    ]
    zeros = np.zeros_like(time)
    columns = {name: motion.get(name, zeros) for name in MOTION}
    if "load" in system.input_names:
        columns["load"] = motion["load"]
    inputs = np.column_stack([columns[n] for n in system.input_names])
    if not system.states:
        return system.outputs_along(time, np.zeros((time.size, 0)), inputs, np.array(every))[:, :, 0]
    table = InputTable(times=time, values=inputs, names=system.input_names)

    def force(p: np.ndarray) -> np.ndarray:
        solution = integrate(
            native_problem(system, p, table),
            (float(time[0]), float(time[-1])),
            system.start,
            t_eval=time,
            rtol=1e-5,
            atol=1e-9,
        )
        return system.outputs_along(time, np.ascontiguousarray(solution.y.T), inputs, p)[:, 0]

    return np.array(parallel_map(force, every))
