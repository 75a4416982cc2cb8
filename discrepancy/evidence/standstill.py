"""Samples at which dry friction holds a part of the machine: what it holds with then, its motion does not tell.

At rest the force of dry friction is whatever the other forces ask for, up to its limit, and where a part comes to rest
depends on its path over micrometres.  A regularised law creeps instead.  Neither says anything of effects that the
model may lack, and differences of this kind are large beside the noise of a sensor.  So samples at a standstill are
left out, for all models alike, and what happened there may have moved the machine: a random force at that connection.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from discrepancy.effects.catalogue import has_friction
from discrepancy.sensitivities.linearised_problem import LinearisedProblem

__all__ = ["STANDSTILL", "places_that_stick", "samples_at_standstill", "standstill_at"]

#: Share of a connection's largest speed below which it counts as standing still.  Friction laws bend within a few per
#: cent of the speeds that machines are run at.
STANDSTILL = 0.02
#: Least share of a record's samples that must be in motion for the others to be left out.  Of a machine that hardly
#: moves the standstill is the record.
LEAST_MOTION = 0.3


def places_that_stick(linearised: LinearisedProblem) -> list[int]:
    """Return the indices of the connections of the machine that have a dry friction."""
    system = linearised.system
    return [j for j, place in enumerate(system.places) if has_friction(place, system, "dry friction")]


def standstill_at(linearised: LinearisedProblem, place: int, times: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return how much a connection stands still along every record: one at rest, zero at twice the bound of motion.

    Parameters
    ----------
    linearised : LinearisedProblem
    place : int
    times : sequence of ndarray, shape (N,), s
        At which it is asked, one array for each record.
    """
    where = linearised.system.places[place]
    rate = f"place.{where.name}.{where.motion_names()[1][0]}"
    speeds = [np.abs(linearised.nominal_outputs(i)[rate]) for i in range(len(linearised.experiments))]
    slow = STANDSTILL * max(float(np.max(v, initial=0.0)) for v in speeds)
    if not slow > 0.0:
        return [np.zeros(t.size) for t in times]
    return [
        np.clip(2.0 - np.interp(t, np.asarray(e.record.time), v) / slow, 0.0, 1.0)
        for t, v, e in zip(times, speeds, linearised.experiments, strict=True)
    ]


def samples_at_standstill(linearised: LinearisedProblem) -> tuple[np.ndarray, ...]:
    """Return which prepared samples of every record are left out, (n,) of bool each.

    Those at which some connection with dry friction stands still; none of a record of which less than `LEAST_MOTION`
    would remain.
    """
    times = [np.asarray(e.time) for e in linearised.experiments]
    left_out = [np.zeros(t.size, dtype=bool) for t in times]
    for place in places_that_stick(linearised):
        for mask, weight in zip(left_out, standstill_at(linearised, place, times), strict=True):
            mask |= weight >= 1.0
    return tuple(mask if np.mean(~mask) >= LEAST_MOTION else np.zeros_like(mask) for mask in left_out)
