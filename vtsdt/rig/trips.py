"""Trips of the virtual lift: the reference of the pulley's speed over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from multibody.library.profiles import jerk_limited
from vtsdt.files.parameters import LiftParameters

__all__ = ["CYCLE", "ReferenceTrip", "draw_trip", "express"]

#: Time between two values of the reference, s.
CYCLE = 1e-3


@dataclass(frozen=True, eq=False, kw_only=True)
class ReferenceTrip:
    """The speed reference of one trip.

    Parameters
    ----------
    time, omega : ndarray, s and rad/s
        Speed reference of the pulley; positive lets the cabin down.
    angle : ndarray, rad
        Its integral.
    height : float, m
        Where the cabin starts.
    load : float, kg
        Payload.
    """

    time: np.ndarray
    omega: np.ndarray
    angle: np.ndarray
    height: float
    load: float = 0.0


def express(parameters: LiftParameters, up: bool, duration: float, load: float = 0.0) -> ReferenceTrip:
    """Return a trip from end to end as the parameters' ``[trip]`` says."""
    p = parameters.trip
    distance = parameters.hoistway.travel * (1.0 if up else -1.0)
    moves = [(p.start, distance, p.speed, p.acceleration, p.jerk or 1e6)]
    return _trip(parameters, moves, 0.0 if up else parameters.hoistway.travel, duration, load)


def draw_trip(
    parameters: LiftParameters,
    number: int,
    rng: np.random.Generator,
    duration: float,
    loads: tuple[float, ...],
) -> ReferenceTrip:
    """Return a drawn trip: every second one down, every third from end to end, the others with stops.

    Stops are 0.15 to 0.9 m apart; speeds are between a quarter of the lift's speed and the full speed.

    Parameters
    ----------
    parameters : LiftParameters
    number : int
        Of the trip, from 0; it determines direction and load, and whether the trip has stops.
    rng : Generator
    duration : float, s
    loads : tuple of float, kg
        Payloads, used in turn.
    """
    p, travel = parameters.trip, parameters.hoistway.travel
    up, load = number % 2 == 0, loads[(number // 2) % len(loads)]
    if number % 3 == 0:
        return express(parameters, up, duration, load)
    at = start = 0.0 if up else travel
    now = p.start + float(rng.uniform(0.0, 0.3))
    moves: list[tuple[float, float, float, float, float]] = []
    while True:
        speed = p.speed * float(rng.uniform(0.25, 1.0))
        left = travel - at if up else at
        distance = min(float(rng.uniform(0.15, 0.9)), left)
        limit, jerk = p.acceleration * float(rng.uniform(0.7, 1.3)), (p.jerk or 1e3) * float(rng.uniform(0.7, 1.3))
        takes = jerk_limited(0.0, distance, speed, limit, jerk)[3]
        if distance < 0.1 or now + takes > duration - 0.1:
            if moves or distance < 0.1:
                break
            continue  # the first move has to fit
        moves.append((now, distance if up else -distance, speed, limit, jerk))
        at += distance if up else -distance
        now += takes + float(rng.uniform(0.2, 0.6))
    return _trip(parameters, moves, start, duration, load)


def _trip(
    parameters: LiftParameters,
    moves: list[tuple[float, float, float, float, float]],
    height: float,
    duration: float,
    load: float,
) -> ReferenceTrip:
    r = parameters.pulley.R_p
    time = np.arange(round((duration + 0.5) / CYCLE) + 1) * CYCLE
    omega, angle = np.zeros_like(time), np.zeros_like(time)
    for begin, distance, speed, limit, jerk in moves:
        move = np.array([jerk_limited(t - begin, -distance, speed, limit, jerk)[:2] for t in time[time > begin]])
        angle[time > begin] += move[:, 0] / r
        omega[time > begin] += move[:, 1] / r
    return ReferenceTrip(time=time, omega=omega, angle=angle, height=height, load=load)
