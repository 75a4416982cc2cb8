"""Free rotations: angles that can be turned together without changing anything else of the machine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from discrepancy.residual.initial_state import StateEstimate

__all__ = ["free_rotations"]

INSTANTS = 32  # of a record at which Jacobians are evaluated
NO_INFLUENCE = 1e-9  # influence of a rotation, relative to that of an angle alone, that counts as zero
PART = 0.1  # share in a rotation from which an angle takes part in it


def free_rotations(estimates: Sequence[StateEstimate]) -> tuple[np.ndarray, np.ndarray]:
    """Return which states and which outputs are angles that only count turns: nothing depends on how many.

    The rotor of a fan turns freely: its angle is the integral of its speed, and one turn more changes nothing else.
    Two rotors with a spring between them turn freely together.  A pendulum does not: its weight depends on the angle.

    Parameters
    ----------
    estimates : sequence of StateEstimate
        States along the records.

    Returns
    -------
    tuple of ndarray of bool, shapes (n,) and (n_channels,)
    """
    system, p = estimates[0].system, estimates[0].p
    angles = np.flatnonzero([s.unit == "rad" for s in system.states])
    order = [system.index("output", name) for name in estimates[0].experiment.outputs]
    states, outputs = np.zeros(len(system.states), dtype=bool), np.zeros(len(order), dtype=bool)
    if not angles.size:
        return states, outputs
    rates, shown = [], []
    for estimate in estimates:
        at = np.linspace(0, len(estimate.states) - 1, min(INSTANTS, len(estimate.states))).astype(int)
        times, inputs = np.array(estimate.experiment.record.time)[at], estimate.reading.inputs[at]
        given = (times, estimate.states[at], inputs, p)
        rates.append(system.jacobian_along("x", *given)[:, :, angles])
        shown.append(system.jacobian_along("x", *given, of="outputs")[:, order][:, :, angles])
    influence = np.concatenate(rates).reshape(-1, angles.size)
    if not np.all(np.isfinite(influence)):
        return states, outputs
    _, sizes, rotations = np.linalg.svd(influence, full_matrices=True)
    sizes = np.concatenate([sizes, np.zeros(angles.size - sizes.size)])
    free = rotations[sizes <= NO_INFLUENCE * max(sizes[0], np.finfo(float).tiny)]
    states[angles] = np.any(np.abs(free) > PART, axis=0)
    influence = np.abs(np.concatenate(shown) @ free.T).max(axis=0, initial=0.0)  # (n_channels, rotations)
    outputs[:] = np.any(influence > PART, axis=1) & np.array([system.outputs[i].unit == "rad" for i in order])
    return states, outputs
