"""Derivatives of a system's outputs, and the longest allowed steps, at every row of a known trajectory."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from multibody.solvers.kernels import along
from multibody.system.compiled import CompiledSystem
from multibody.system.rows import derivative_rows

if TYPE_CHECKING:
    from multibody.solvers.problem import Directions, NativeProblem

__all__ = ["longest_steps", "observe_along"]


def observe_along(
    system: CompiledSystem,
    times: np.ndarray,
    states: np.ndarray,
    inputs: np.ndarray,
    p: np.ndarray,
    directions: Directions,
    rates: np.ndarray,
    delays: np.ndarray,
    shape: np.ndarray,
) -> np.ndarray:
    """Return the derivatives of the outputs along the directions of a trajectory, shape (nt, n_y, m).

    Parameters
    ----------
    times : ndarray, shape (nt,), s
    states : ndarray, shape (nt, n (m + 1))
        The states, then their derivatives along each direction.
    inputs, rates : ndarray, shape (nt, n_u)
        The inputs and their rates.
    p : ndarray, shape (n_p,)
    directions : Directions
    delays : ndarray, shape (m, n_u), s
        How much earlier each input is looked up along each direction.
    shape : ndarray, shape (nt, m)
        What each direction adds to its input.
    """
    function = system.outputs_tangent
    at = _contiguous(times, states, inputs, rates, p)
    given = directions.p_dot, *_contiguous(shape), directions.channel, *_contiguous(delays)
    return function.run(derivative_rows, function, len(system.outputs), *at, *given)


def longest_steps(problem: NativeProblem, times: np.ndarray, states: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Return at every row the time, s, in which a quarter of the narrowest feature passes by, shape (nt,)."""
    longest = np.full(times.size, problem.largest_step)
    if problem.speeds is not None and problem.widths is not None:
        speeds = np.empty((times.size, problem.widths.size))
        at = _contiguous(times, states, inputs, problem.p)
        along.rhs_along(problem.speeds.address, *at, speeds)
        problem.speeds.check()
        per_second = np.max(np.abs(speeds) / problem.widths, axis=1)
        longest = np.minimum(longest, 0.25 / np.maximum(per_second, 1e-300))
    return longest


def _contiguous(*arrays: Any) -> tuple[np.ndarray, ...]:
    return tuple(np.require(a, float, ["C", "W"]) for a in arrays)
