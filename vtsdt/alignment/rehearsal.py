"""A run of ``vtsdt align`` without recordings, which compiles everything that the command needs."""

from __future__ import annotations

import numpy as np

from multibody.base.gravity import STANDARD_GRAVITY
from multibody.library.profiles import jerk_limited
from vtsdt.alignment.estimate import align
from vtsdt.alignment.trips import Trip
from vtsdt.files.parameters import LiftParameters

__all__ = ["plain_trip", "rehearse"]

_STEP = 2e-3  # s
_FRICTION = 9.0  # N


def plain_trip(parameters: LiftParameters, direction: int, payload: float = 0.0) -> Trip:
    """Return a trip from end to end without vibration: weight, inertia, and a constant friction force.

    Parameters
    ----------
    parameters : LiftParameters
    direction : {1, -1}
        Up or down.
    payload : float, kg
    """
    trip, travel = parameters.trip, parameters.hoistway.travel
    count = int(np.ceil(parameters.trip.duration / _STEP))
    time = np.arange(count) * _STEP
    moves = np.array(
        [
            jerk_limited(t - trip.start, direction * travel, trip.speed, trip.acceleration, trip.jerk or 1e3)[:3]
            for t in time
        ]
    )
    height = moves[:, 0] + (0.0 if direction > 0 else travel)
    tension = (parameters.cabin.mass + payload) * (STANDARD_GRAVITY + moves[:, 2]) + _FRICTION * np.tanh(
        moves[:, 1] / 0.01
    )
    return Trip(
        name="up" if direction > 0 else "down",
        time=time,
        tension=tension,
        height=height,
        acceleration=moves[:, 2],
        payload=payload,
    )


def rehearse() -> None:
    """Estimate the alignment from two plain trips of the shipped bench, empty and loaded."""
    lift = LiftParameters.bench()
    for payload in (0.0, 2.0):
        align([plain_trip(lift, direction, payload) for direction in (1, -1)], lift)
