"""How much work an integration may be: so much that every sound one fits, so little that a hopeless one ends soon."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

__all__ = [
    "EVALUATIONS_PER_SAMPLE",
    "LEAST_EVALUATIONS",
    "RUNAWAY",
    "allowed_by_then",
    "cause_of_small_steps",
    "most_evaluations",
    "too_many",
]

LEAST_EVALUATIONS = 2_000_000
"""Evaluations of the equations that every integration may take: seconds, with a model of twenty states."""
EVALUATIONS_PER_SAMPLE = 2000
"""More of them for each sample and each time of an input: steps of a three-hundredth of a sample are followed."""
HOPELESS = 10.0
"""An integration is given up before its limit where it would need so many times the limit at its pace so far."""
RUNAWAY = 1e30
"""An integration ends where a state is beyond this, SI: nothing that a machine can be is as large."""
FAST = 1e-5
"""Time constant, as a share of the interval, below which a state is fast."""


def most_evaluations(times: np.ndarray, interval: tuple[float, float], samples: int) -> int:
    """Return how many evaluations an integration may take.

    Parameters
    ----------
    times : ndarray, s
        Of the input table, increasing; those within the interval count.
    interval : tuple of float, s
        In either order.
    samples : int
        Number of times at which states are asked for.

    Examples
    --------
    >>> most_evaluations(np.arange(1000.0), (10.0, 19.5), 5)
    2030000
    """
    first, last = np.searchsorted(times, sorted(interval))
    return LEAST_EVALUATIONS + EVALUATIONS_PER_SAMPLE * (int(last - first) + samples)


def allowed_by_then(most: int, done: float) -> int:
    """Return how many evaluations are allowed up to a point of an integration.

    Parameters
    ----------
    most : int
        In all.
    done : float
        Share of the interval that is behind.

    Examples
    --------
    >>> allowed_by_then(18_000_000, 0.5), allowed_by_then(18_000_000, 1e-6), allowed_by_then(1000, 0.0)
    (18000000, 2000000, 1000)
    """
    return min(most, max(LEAST_EVALUATIONS, int(HOPELESS * most * done)))


def too_many(used: int, allowed: int, t: float, cause: str = "") -> str:
    """Return the message of an integration that was given up at a time t, s; ``cause`` is a sentence of its own."""
    return (
        f"{used} evaluations of the equations, more than the {allowed} allowed by then, came only to t = {t:.9g} s: "
        f"the steps are very small there{cause}. Check what acts there for something a million times stiffer or faster "
        "than the rest: a stiffness, a damping, a small mass, a time constant, a force that jumps"
    )


def cause_of_small_steps(
    rates: Callable[[np.ndarray], np.ndarray], x: np.ndarray, span: float, name: Callable[[int], str]
) -> str:
    """Return in words which state has the shortest time constant, or that none is short, to be added to `too_many`.

    The time constant of state i is taken as 1/max_j sqrt(abs(J_ij J_ji)), with the Jacobian J by differences: that of a
    mass on a spring is 1/omega, that of a first-order lag its own.

    Parameters
    ----------
    rates : callable
        Of a state vector, shape (n,).
    x : ndarray, shape (n,)
    span : float, s
        The interval.
    name : callable
        Of the index of a state.
    """
    before = rates(x)
    jacobian = np.empty((x.size, x.size))
    with np.errstate(all="ignore"):
        for k in range(x.size):
            moved = x.copy()
            moved[k] += 1e-7 * max(1.0, abs(float(x[k])))
            jacobian[:, k] = (rates(moved) - before) / (moved[k] - x[k])
        speed = np.sqrt(np.abs(jacobian * jacobian.T)).max(axis=1, initial=0.0)
    if not x.size or not np.all(np.isfinite(speed)):
        return ""
    k = int(np.argmax(speed))
    if speed[k] * span * FAST < 1.0:
        return ", although no state is fast: a force that jumps does that, make it change over a small range"
    return f", and the fastest is {name(k)}, with a time constant of {1.0 / speed[k]:.2g} s"
