"""Which angles of a machine may be turned together without anything else of it changing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from discrepancy.residual.initial_state import Followed
    from estimation.response.experiment import Experiment
    from multibody.machine.model import System

__all__ = ["free_rotations"]

INSTANTS = 32  # of a record at which the machine is asked
NOTHING = 1e-9  # influence of a turn, relative to that of an angle alone, which is rounding
PART = 0.1  # share in a turn from which an angle takes part in it


def free_rotations(
    system: System, p: np.ndarray, experiments: Sequence[Experiment], followed: Sequence[Followed]
) -> tuple[np.ndarray, np.ndarray]:
    """Return which states and which outputs are angles that count turns, and nothing depends on how many.

    The rotor of a fan turns freely: its angle adds up what the speed was, and a turn more or less moves nothing else.
    Two rotors with a spring between them turn freely together.  A pendulum does not: its weight knows the angle.

    Parameters
    ----------
    system : System
        With the measured outputs.
    p : ndarray, shape (n_p,)
    experiments : sequence of Experiment
    followed : sequence of Followed
        States along the records.

    Returns
    -------
    tuple of ndarray of bool, shapes (n,) and (n_channels,)
    """
    angles = np.flatnonzero([s.unit == "rad" for s in system.states])
    order = [system.index("output", name) for name in experiments[0].outputs]
    states, outputs = np.zeros(len(system.states), dtype=bool), np.zeros(len(order), dtype=bool)
    if not angles.size:
        return states, outputs
    rates, seen = [], []
    for experiment, path in zip(experiments, followed, strict=True):
        at = np.linspace(0, len(path.states) - 1, min(INSTANTS, len(path.states))).astype(int)
        times, inputs = np.array(experiment.record.time)[at], path.reading.inputs[at]
        given = (times, path.states[at], inputs, p)
        rates.append(system.jacobian_along("x", *given)[:, :, angles])
        seen.append(system.jacobian_along("x", *given, of="outputs")[:, order][:, :, angles])
    influence = np.concatenate(rates).reshape(-1, angles.size)
    if not np.all(np.isfinite(influence)):
        return states, outputs
    _, sizes, turns = np.linalg.svd(influence, full_matrices=True)
    sizes = np.concatenate([sizes, np.zeros(angles.size - sizes.size)])
    free = turns[sizes <= NOTHING * max(sizes[0], np.finfo(float).tiny)]
    states[angles] = np.any(np.abs(free) > PART, axis=0)
    shown = np.abs(np.concatenate(seen) @ free.T).max(axis=0, initial=0.0)  # (n_channels, turns)
    outputs[:] = np.any(shown > PART, axis=1) & np.array([system.outputs[i].unit == "rad" for i in order])
    return states, outputs
