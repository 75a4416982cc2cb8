"""Speed reference of a trip, jerk-limited or trapezoidal: as a component of the model, or sampled for its input."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from multibody.library.profiles import jerk_limited, trapezoidal
from multibody.library.sources import SCurveProfile, TrapezoidalProfile
from vtsdt.files.parameters import LiftParameters

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


def reference_component(parameters: LiftParameters, start: float) -> SCurveProfile | TrapezoidalProfile:
    """Return the component that makes the speed reference of a trip from the height ``start`` to the farther end."""
    r, trip, travel = parameters.pulley.R_p, parameters.trip, parameters.hoistway.travel
    distance = travel if start < 0.5 * travel else -travel
    limits = {"distance": -distance / r, "v_max": trip.speed / r, "a_max": trip.acceleration / r, "start": trip.start}
    return SCurveProfile(**limits, j_max=trip.jerk / r) if trip.jerk > 0.0 else TrapezoidalProfile(**limits)


def sampled_reference(
    parameters: LiftParameters, direction: str = "up", step: float = 1e-3
) -> tuple[np.ndarray, np.ndarray]:
    """Return times (s) and speed reference of the pulley (rad/s) of a whole trip.

    A positive speed lets the cabin down, so the reference of a trip up is negative.
    """
    trip = parameters.trip
    distance = -trip_sign(direction) * parameters.hoistway.travel
    jerk = trip.jerk if trip.jerk > 0.0 else 0.0
    times, speed = _rope_speed(trip.duration, step, trip.start, distance, trip.speed, trip.acceleration, jerk)
    return times.copy(), speed / parameters.pulley.R_p


@lru_cache(maxsize=32)
def _rope_speed(
    duration: float, step: float, start: float, distance: float, speed: float, acceleration: float, jerk: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return times and rope speed; cached, because many trips of one lift share them."""
    times = np.arange(round(duration / step) + 1) * step
    if jerk > 0.0:
        values = [jerk_limited(t - start, distance, speed, acceleration, jerk)[1] for t in times.tolist()]
    else:
        values = [trapezoidal(t - start, distance, speed, acceleration)[1] for t in times.tolist()]
    return times, np.array(values)
