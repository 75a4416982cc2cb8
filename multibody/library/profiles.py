"""Motion profiles as plain functions of time: trapezoidal speed, and speed with limited jerk (S-curve)."""

from __future__ import annotations

import math

__all__ = ["jerk_limited", "trapezoidal"]


def trapezoid_phases(distance, v, a):
    """Return the speed reached and the time of speeding up, with |speed| ≤ v and |acceleration| ≤ a."""
    reached = min(v, math.sqrt(a * abs(distance)))
    return reached, reached / a


def trapezoidal(t, distance, v, a):
    """Return position, velocity, acceleration and duration of a move that begins at t = 0."""
    reached, t_a = trapezoid_phases(distance, v, a)
    whole = abs(distance)
    end = t_a + whole / max(reached, 1e-300)
    if t <= 0.0 or whole == 0.0:
        s, speed, rate = 0.0, 0.0, 0.0
    elif t < t_a:
        s, speed, rate = 0.5 * a * t * t, a * t, a
    elif t < end - t_a:
        s, speed, rate = 0.5 * reached * t_a + reached * (t - t_a), reached, 0.0
    elif t < end:
        s, speed, rate = whole - 0.5 * a * (end - t) * (end - t), a * (end - t), -a
    else:
        s, speed, rate = whole, 0.0, 0.0
    way = math.copysign(1.0, distance)
    return way * s, way * speed, way * rate, end


def jerk_limited_phases(distance, v, a, j):
    """Return the speed reached, the time of one jerk phase and the time of speeding up, all limits kept.

    L. Biagiotti, C. Melchiorri: Trajectory Planning for Automatic Machines and Robots, Springer 2008, section
    3.4 (double S velocity profile, at rest at both ends).
    """
    whole = abs(distance)
    if v * j >= a * a:  # the acceleration is reached
        t_j = a / j
        t_a = t_j + v / a
    else:
        t_j = math.sqrt(v / j)
        t_a = 2.0 * t_j
    reached = v
    if whole < v * t_a:  # the speed is not reached
        reached = 0.5 * (math.sqrt(a**4 / j**2 + 4.0 * a * whole) - a * a / j)
        t_j = a / j
        t_a = t_j + reached / a
        if t_a < 2.0 * t_j:  # nor is the acceleration
            t_j = (0.5 * whole / j) ** (1.0 / 3.0)
            t_a = 2.0 * t_j
            reached = j * t_j * t_j
    return reached, t_j, t_a


def ramp_up(t, reached, t_j, t_a, j):
    """Return distance, speed and acceleration at time t of speeding up from rest with limited jerk."""
    a_top = j * t_j
    if t < t_j:
        s, speed, rate = j * t * t * t / 6.0, 0.5 * j * t * t, j * t
    elif t < t_a - t_j:
        s = a_top * (3.0 * t * t - 3.0 * t_j * t + t_j * t_j) / 6.0
        speed, rate = a_top * (t - 0.5 * t_j), a_top
    elif t < t_a:
        left = t_a - t
        s = 0.5 * reached * t_a - reached * left + j * left * left * left / 6.0
        speed, rate = reached - 0.5 * j * left * left, j * left
    else:
        s, speed, rate = 0.5 * reached * t_a + reached * (t - t_a), reached, 0.0
    return s, speed, rate


def jerk_limited(t, distance, v, a, j):
    """Return position, velocity, acceleration and duration of a move that begins at t = 0."""
    whole = abs(distance)
    reached, t_j, t_a = jerk_limited_phases(distance, v, a, j)
    end = t_a + whole / max(reached, 1e-300)
    s, speed, rate = 0.0, 0.0, 0.0
    if t > 0.0 and whole > 0.0:
        if t < 0.5 * end:
            s, speed, rate = ramp_up(t, reached, t_j, t_a, j)
        elif t < end:  # slowing down mirrors speeding up
            s, speed, rate = ramp_up(end - t, reached, t_j, t_a, j)
            s = whole - s
            rate = -rate
        else:
            s = whole
    way = math.copysign(1.0, distance)
    return way * s, way * speed, way * rate, end
