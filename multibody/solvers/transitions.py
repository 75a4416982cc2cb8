"""Exact discrete transitions of the variational equation between the samples of a trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from multibody.native import load_driver
from multibody.side_by_side import cores, side_by_side
from multibody.solvers.kernels.stepping import DIRECTION
from multibody.solvers.problem import Directions, NativeProblem, ProblemError

__all__ = ["Transitions", "transitions"]


@dataclass(frozen=True, eq=False)
class Transitions:
    """x_{k+1} as a linear function of x_k and of additional inputs, around a trajectory.

    A deviation δ of the state and additions φ to m inputs, linear between the samples, go on as
    δ_{k+1} = phi[k] δ_k + gamma0[k] φ_k + gamma1[k] φ_{k+1}.

    Parameters
    ----------
    phi : ndarray, shape (N - 1, n, n)
    gamma0, gamma1 : ndarray, shape (N - 1, n, m)
    ends : ndarray, shape (N - 1, n)
        State at t_{k+1} when started from the given state at t_k.
    """

    phi: np.ndarray
    gamma0: np.ndarray
    gamma1: np.ndarray
    ends: np.ndarray

    def __iter__(self):  # type: ignore[no-untyped-def]
        return iter((self.phi, self.gamma0, self.gamma1))


def transitions(
    problem: NativeProblem,
    times: np.ndarray,
    states: np.ndarray,
    directions_in: Sequence[int] = (),
    substep: float | np.ndarray = np.inf,
) -> Transitions:
    """Return the discrete transitions along a stored trajectory.

    In every interval the state is integrated again from its stored value, with its variational equation
    started from the identity, by Dormand and Prince's method of order 5 in steps of at most ``substep``.  The
    global interpreter lock is released meanwhile: several trajectories can be worked on by threads.

    Parameters
    ----------
    problem : NativeProblem
        With a tangent; its directions are not used.
    times : ndarray, shape (N,), s
        Increasing.
    states : ndarray, shape (N, n)
    directions_in : sequence of int
        The m inputs whose additions count.
    substep : float or ndarray, shape (N - 1,), s
        Largest step, of all intervals or of each.  It must be stable: below about 3 over the largest
        eigenvalue's magnitude.  An interval with zero is left out, and has zeros in the result.

    Returns
    -------
    Transitions
        Unpacks into phi, gamma0, gamma1.

    Raises
    ------
    ProblemError
        If shapes do not fit, or a result is not finite (the message says from which sample on).
    """
    times = np.ascontiguousarray(times, dtype=np.float64)
    states = np.ascontiguousarray(states, dtype=np.float64)
    channels = np.asarray(directions_in, dtype=np.int64)
    n, m = problem.n, channels.size
    if times.ndim != 1 or times.size < 2 or np.any(np.diff(times) <= 0.0):
        raise ProblemError("transitions need at least two increasing times")
    if states.shape != (times.size, n):
        raise ProblemError(f"states has the shape {states.shape}, not ({times.size}, {n})")
    largest = np.asarray(substep, dtype=np.float64)
    if largest.shape not in ((), (times.size - 1,)) or not np.all(largest >= 0.0):
        raise ProblemError(f"substep must not be negative, a number or one for each of {times.size - 1} intervals")
    if m and (channels.min() < 0 or channels.max() >= problem.table.n_inputs):
        raise ProblemError(f"directions_in names input {channels.max()}, there are {problem.table.n_inputs}")

    count = n + 2 * m
    shape = np.zeros((2, count))
    shape[0, n : n + m] = 1.0
    shape[1, n + m :] = 1.0
    start = np.zeros((count, n))
    start[:n] = np.eye(n)
    largest = np.minimum(largest, problem.largest_step)
    steps = np.array(np.broadcast_to(np.minimum(largest, 1e300), (times.size - 1,)))
    out, ends = np.zeros((times.size - 1, count * n)), np.zeros((times.size - 1, n))
    driver = load_driver("multibody.solvers.kernels.intervals")

    def work(part: slice) -> None:
        """Fill the intervals of a part, with a field of its own: the driver writes their ends into it."""
        directions = Directions(
            start,
            np.zeros((count, problem.p.size)),
            np.concatenate([np.full(n, -1), channels, channels]),
            times[:2].copy(),
            shape,
        )
        whole = replace(problem, directions=directions)
        field = whole.field()
        clock = np.zeros(8)
        clock[DIRECTION] = 1.0
        ticks = slice(part.start, part.stop + 1)
        room = np.empty(whole.size), np.empty(7 * whole.size), np.empty(whole.size)
        driver.transition_blocks(
            field.numbers, clock, times[ticks], states[ticks], steps[part], *room, start.ravel(), out[part], ends[part]
        )
        whole.check()

    edges = np.linspace(0, times.size - 1, min(cores(), times.size - 1) + 1).astype(int)
    side_by_side(work, [slice(int(a), int(b)) for a, b in pairwise(edges)])
    bad = np.flatnonzero(~(np.isfinite(out).all(axis=1) & np.isfinite(ends).all(axis=1)))
    if bad.size:
        raise ProblemError(
            f"the transition from t = {times[bad[0]]:.9g} s on is not finite: the state there is out of the "
            f"model's range, or a substep of {np.max(largest):g} s is too large for its fastest motion"
        )
    blocks = out.reshape(times.size - 1, count, n).transpose(0, 2, 1)
    return Transitions(
        np.ascontiguousarray(blocks[:, :, :n]),
        np.ascontiguousarray(blocks[:, :, n : n + m]),
        np.ascontiguousarray(blocks[:, :, n + m :]),
        ends,
    )
