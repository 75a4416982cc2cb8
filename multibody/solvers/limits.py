"""How much work an integration may be: so much that every sound one fits, so little that a hopeless one ends soon."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

__all__ = ["EVALUATIONS_PER_SAMPLE", "LEAST_EVALUATIONS", "RUNAWAY", "fastest_state", "too_many"]

LEAST_EVALUATIONS = 2_000_000
"""Evaluations of the equations that every integration may take: seconds, with a model of twenty states."""
EVALUATIONS_PER_SAMPLE = 2000
"""More of them for each sample and each time of an input: steps of a three-hundredth of a sample are followed."""
RUNAWAY = 1e100
"""A state beyond this has left everything that a machine can be."""


def too_many(used: int, allowed: int, t: float, fastest: str = "") -> str:
    """Return the message of an integration that was given up at a time t, s; ``fastest`` says which state is."""
    return (
        f"{used} evaluations of the equations, more than the {allowed} allowed, came only to t = {t:.9g} s: the steps "
        f"are very small there{fastest}. Check what acts there: is something a million times stiffer or faster than "
        "the rest, a stiffness, a damping, a small mass, a time constant, a force that jumps?"
    )


def fastest_state(rates: Callable[[np.ndarray], np.ndarray], x: np.ndarray, name: Callable[[int], str]) -> str:
    """Return in words which state has the shortest time constant; empty where none can be told.

    The time constant of state i is taken as 1/max_j sqrt(abs(J_ij J_ji)), with the Jacobian J by differences: that of a
    mass on a spring is 1/omega, that of a first-order lag its own.

    Parameters
    ----------
    rates : callable
        Of a state vector, shape (n,).
    x : ndarray, shape (n,)
    name : callable
        Of the index of a state.
    """
    before = rates(x)
    jacobian = np.empty((x.size, x.size))
    with np.errstate(all="ignore"):
        for k in range(x.size):
            step = 1e-7 * max(1.0, abs(float(x[k])))
            moved = x.copy()
            moved[k] += step
            jacobian[:, k] = (rates(moved) - before) / step
        speed = np.sqrt(np.abs(jacobian * jacobian.T)).max(axis=1, initial=0.0)
    k = int(np.argmax(speed))
    if not np.isfinite(speed[k]) or not speed[k] > 0.0:
        return ""
    return f", and the fastest is {name(k)}, with a time constant of {1.0 / speed[k]:.2g} s"
