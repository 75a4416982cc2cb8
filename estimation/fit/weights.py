"""How much each output counts in a fit: by the size of what is left of it, and by how long that remembers.

What a fit has not yet taken out of an output is no noise.  Were it taken for noise, an output that is far off would
count little, stay far off, and so go on counting little: a lift whose cabin hangs 0.3 mm too low for 6 s would keep a
support that is 10 % too stiff.  So size and memory are those of what a linear fit leaves that knows of no memory, and
that moves parameters only as far as they may lie from what is stated.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from estimation.fit.least_squares import step_within
from estimation.signals.correlation import correlation_time

if TYPE_CHECKING:
    from estimation.fit.fit_problem import FitProblem
    from estimation.response.experiment import Response

__all__ = ["weights_of"]

#: Linear fits, each with the sizes that the one before has left: the sizes change by a few per cent after two; chosen.
PASSES = 3
DAMPING = 1e-9  # of columns that cancel, as a share
#: Deviations that a parameter is moved from its prior's mean: what takes more is no error of a parameter; chosen.
REACH = 2.0


def weights_of(
    problem: FitProblem, responses: Sequence[Response], floor: np.ndarray, theta: np.ndarray, moving: np.ndarray
) -> np.ndarray:
    """Return what each output's error is divided by, shape (n_channels,), SI.

    Parameters
    ----------
    problem : FitProblem
    responses : sequence of Response
        Of every experiment at ``theta``.  Without derivatives the errors are taken as they are.
    floor : ndarray, shape (n_channels,)
        Noise, SI: no output counts more than that allows.
    theta : ndarray, shape (k,)
        All unknowns.
    moving : ndarray of int
        Those that a fit moves.
    """
    errors = [e.measured - r.outputs for e, r in zip(problem.experiments, responses, strict=True)]
    spread = np.std(np.concatenate([e.measured for e in problem.experiments]), axis=0)
    least = np.maximum(floor, 1e-9 * np.maximum(spread, 1e-300))
    as_it_is = _remembered(errors, least)
    if not moving.size or not responses[0].derivatives.shape[2]:
        return as_it_is
    fit = _LinearFit(problem, responses, errors, theta, moving)
    left: Sequence[np.ndarray] = errors
    for _ in range(PASSES):
        left = fit.left(np.maximum(_size(left), least))
    # where a step is too long for a straight line, it promises an output more error than there is
    return np.minimum(_remembered(left, least), as_it_is)


def _size(errors: Sequence[np.ndarray]) -> np.ndarray:
    size: np.ndarray = np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0))
    return size


def _remembered(errors: Sequence[np.ndarray], least: np.ndarray) -> np.ndarray:
    """Return size times root of memory: so that a thousand correlated samples count as the few that they are."""
    memory = np.array([np.mean([correlation_time(e[:, c]) for e in errors]) for c in range(least.size)])
    weights: np.ndarray = np.maximum(_size(errors), least) * np.sqrt(memory)
    return weights


class _LinearFit:
    """Errors, and what is left of them after one step of the fit, within bounds and priors."""

    def __init__(
        self,
        problem: FitProblem,
        responses: Sequence[Response],
        errors: Sequence[np.ndarray],
        theta: np.ndarray,
        moving: np.ndarray,
    ) -> None:
        low, high = problem.bounds()
        self._errors, self._x = errors, theta[moving]
        self._low, self._high = low[moving], high[moving]
        self._columns, self._slopes = [], []
        n, c = moving.size, errors[0].shape[1]
        self._normal, self._gradient = np.zeros((c, n, n)), np.zeros((c, n))
        for i, (e, r) in enumerate(zip(errors, responses, strict=True)):
            columns, picked = problem.felt(i, moving)
            slopes = np.ascontiguousarray(r.derivatives[:, :, picked].swapaxes(0, 1))  # channel, time, unknown
            self._normal[np.ix_(np.arange(c), columns, columns)] += slopes.swapaxes(1, 2) @ slopes
            self._gradient[:, columns] -= np.einsum("cti,tc->ci", slopes, e)
            self._columns.append(columns)
            self._slopes.append(slopes)
        known = [k for k, j in enumerate(moving) if j < problem.k and np.isfinite(problem.parameters[j].std)]
        std = np.array([problem.parameters[moving[k]].std for k in known])
        mean = np.array([problem.parameters[moving[k]].value for k in known])
        at = self._x[known]  # one that the fit has moved farther need not go back
        self._low[known] = np.maximum(self._low[known], np.minimum(mean - REACH * std, at))
        self._high[known] = np.minimum(self._high[known], np.maximum(mean + REACH * std, at))
        self._prior, self._pull = np.zeros((n, n)), np.zeros(n)
        self._prior[known, known] = 1.0 / std**2
        self._pull[known] = (self._x[known] - mean) / std**2

    def left(self, weights: np.ndarray) -> list[np.ndarray]:
        """Return the errors that a step with these weights leaves, shape (n, n_channels) each."""
        share = 1.0 / weights**2
        normal = np.tensordot(share, self._normal, 1) + self._prior
        gradient = share @ self._gradient + self._pull
        free = np.diag(normal) > 0.0
        reached, _ = step_within(self._x, normal, gradient, free, DAMPING, self._low, self._high)
        change = reached - self._x
        return [
            e - (slopes @ change[columns]).T
            for e, slopes, columns in zip(self._errors, self._slopes, self._columns, strict=True)
        ]
