"""Trips of the virtual axis: what its position reference does over time."""

from __future__ import annotations

import numpy as np

from multibody.library.profiles import jerk_limited

__all__ = ["CYCLE", "trip"]

#: Longest way from home, m, and time between two values of the reference, s.
TRAVEL, CYCLE = 0.8, 1e-3


def trip(rng: np.random.Generator, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times and positions of the reference of a trip, from home at 0 and back and forth with holds.

    Speeds from 0.06 to 0.6 m/s, accelerations from 1.5 to 5 m/s², limited jerk, sampled every `CYCLE`.
    """
    time = np.arange(round((duration + 1.0) / CYCLE) + 1) * CYCLE
    place = np.zeros_like(time)
    at, now = 0.0, float(rng.uniform(0.4, 0.8))
    first = True
    for _ in range(40):  # a move that does not fit into what is left is drawn again
        speed = 0.6 * 10.0 ** (-0.35 * rng.random() if first else -rng.random())
        limit, jerk = float(rng.uniform(1.5, 5.0)), float(rng.uniform(40.0, 150.0))
        target = float(rng.uniform(0.5, 1.0) if first else rng.random()) * TRAVEL
        longest = speed * float(rng.uniform(0.8, 1.8))  # slow moves are short, so that a trip has several
        way = float(np.clip(target - at, -longest, longest))
        if abs(way) < 0.01:
            way = 0.05 if at < 0.5 * TRAVEL else -0.05
        takes = jerk_limited(0.0, way, speed, limit, jerk)[3]
        if now + takes > duration - 0.3:
            continue
        moving = (time > now) & (time < now + takes)
        gone = [jerk_limited(t - now, way, speed, limit, jerk)[0] for t in time[moving]]
        place[moving] = at + np.array(gone)
        place[time >= now + takes] = at + way
        at, now, first = at + way, now + takes + float(rng.uniform(0.1, 0.5)), False
    return time, place
