"""Speed references of a trip, jerk-limited or trapezoidal, made inside the model or sampled for its input."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from multibody.library.profiles import jerk_limited, trapezoidal
from multibody.library.sources import SCurveProfile, TrapezoidalProfile

if TYPE_CHECKING:
    from vtsdt.lift.lift import Lift

__all__ = ["reference_component", "sampled_reference", "trip_sign"]


def trip_sign(direction: str) -> float:
    """Return +1 for ``"up"`` and -1 for ``"down"``.

    Raises
    ------
    ValueError
        For anything else.
    """
    if direction not in ("up", "down"):
        raise ValueError(f"a trip goes 'up' or 'down', not {direction!r}")
    return 1.0 if direction == "up" else -1.0


def reference_component(lift: Lift) -> SCurveProfile | TrapezoidalProfile:
    """Return the part that makes the speed reference of a trip from the lift's start to the other end."""
    p, r = lift.parameters, lift.parameters.pulley.R_p
    way = p.hoistway.travel if lift.start < 0.5 * p.hoistway.travel else -p.hoistway.travel
    trip = p.trip
    limits = {"distance": -way / r, "v_max": trip.speed / r, "a_max": trip.acceleration / r, "start": trip.start}
    return SCurveProfile(**limits, j_max=trip.jerk / r) if trip.jerk > 0.0 else TrapezoidalProfile(**limits)


def sampled_reference(lift: Lift, direction: str = "up", step: float = 1e-3) -> tuple[np.ndarray, np.ndarray]:
    """Return times (s) and speed reference of the pulley (rad/s) of a whole trip.

    A positive speed lets the cabin down, so the reference of a trip up is negative.
    """
    p, trip = lift.parameters, lift.parameters.trip
    way = -trip_sign(direction) * p.hoistway.travel
    jerk = trip.jerk if trip.jerk > 0.0 else 0.0
    times, speed = _sampled(trip.duration, step, trip.start, way, trip.speed, trip.acceleration, jerk)
    return times.copy(), speed / p.pulley.R_p


@lru_cache(maxsize=32)
def _sampled(
    duration: float, step: float, start: float, way: float, speed: float, acceleration: float, jerk: float
) -> tuple[np.ndarray, np.ndarray]:
    """Times and rope speed; kept, because many trips of one lift have the same."""
    times = np.arange(round(duration / step) + 1) * step
    if jerk > 0.0:
        values = [jerk_limited(t - start, way, speed, acceleration, jerk)[1] for t in times.tolist()]
    else:
        values = [trapezoidal(t - start, way, speed, acceleration)[1] for t in times.tolist()]
    return times, np.array(values)
