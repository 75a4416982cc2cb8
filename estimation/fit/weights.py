"""The weights of the outputs in a fit, from the size and the correlation time of their residuals.

A residual that the fit has not yet removed is not noise.  If it were taken for noise, an output with a large error
would have a small weight, keep its error, and so keep its small weight: a lift whose cabin hangs 0.3 mm too low for
6 s would keep a support that is 10 % too stiff.  Size and correlation time are therefore those of the residual of a
linear fit that ignores correlation and moves parameters only within their priors.
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

#: Linear fits, each with the residual sizes of the one before: the sizes change by a few per cent after two; chosen.
PASSES = 3
DAMPING = 1e-9  # of columns that cancel, as a share
#: Standard deviations by which a parameter may move from its prior's mean; chosen.
LARGEST_MOVE = 2.0


def weights_of(
    problem: FitProblem, responses: Sequence[Response], floor: np.ndarray, theta: np.ndarray, moving: np.ndarray
) -> np.ndarray:
    """Return the divisor of each output's error, shape (n_channels,), SI.

    Parameters
    ----------
    problem : FitProblem
    responses : sequence of Response
        Of every experiment at ``theta``.  Without derivatives there is no linear fit.
    floor : ndarray, shape (n_channels,)
        Noise, SI: the least divisor.
    theta : ndarray, shape (k,)
        All unknowns.
    moving : ndarray of int
        Those that are fitted.
    """
    errors = [e.measured - r.outputs for e, r in zip(problem.experiments, responses, strict=True)]
    spread = np.std(np.concatenate([e.measured for e in problem.experiments]), axis=0)
    least = np.maximum(floor, 1e-9 * np.maximum(spread, 1e-300))
    unfitted = _divisors(errors, least)
    if not moving.size or not responses[0].derivatives.shape[2]:
        return unfitted
    fit = _LinearStep(problem, responses, errors, theta, moving)
    residuals: Sequence[np.ndarray] = errors
    for _ in range(PASSES):
        residuals = fit.residuals(np.maximum(_size(residuals), least))
    # where a step is too long for the linearisation, it predicts a larger error than there is
    return np.minimum(_divisors(residuals, least), unfitted)


def _size(errors: Sequence[np.ndarray]) -> np.ndarray:
    size: np.ndarray = np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0))
    return size


def _divisors(errors: Sequence[np.ndarray], least: np.ndarray) -> np.ndarray:
    """Return size times root of correlation time: correlated samples count as their effective number."""
    correlation = np.array([np.mean([correlation_time(e[:, c]) for e in errors]) for c in range(least.size)])
    weights: np.ndarray = np.maximum(_size(errors), least) * np.sqrt(correlation)
    return weights


class _LinearStep:
    """The errors after one linear step of the fit, within bounds and priors."""

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
            columns, picked = problem.columns_of(i, moving)
            slopes = np.ascontiguousarray(r.derivatives[:, :, picked].swapaxes(0, 1))  # channel, time, unknown
            self._normal[np.ix_(np.arange(c), columns, columns)] += slopes.swapaxes(1, 2) @ slopes
            self._gradient[:, columns] -= np.einsum("cti,tc->ci", slopes, e)
            self._columns.append(columns)
            self._slopes.append(slopes)
        known = [k for k, j in enumerate(moving) if j < problem.k and np.isfinite(problem.parameters[j].std)]
        std = np.array([problem.parameters[moving[k]].std for k in known])
        mean = np.array([problem.parameters[moving[k]].value for k in known])
        at = self._x[known]  # a parameter that is farther away already need not go back
        self._low[known] = np.maximum(self._low[known], np.minimum(mean - LARGEST_MOVE * std, at))
        self._high[known] = np.minimum(self._high[known], np.maximum(mean + LARGEST_MOVE * std, at))
        self._prior, self._pull = np.zeros((n, n)), np.zeros(n)
        self._prior[known, known] = 1.0 / std**2
        self._pull[known] = (self._x[known] - mean) / std**2

    def residuals(self, weights: np.ndarray) -> list[np.ndarray]:
        """Return the errors after a step with these divisors, shape (n, n_channels) each."""
        share = 1.0 / weights**2
        normal = np.tensordot(share, self._normal, 1) + self._prior
        gradient = share @ self._gradient + self._pull
        free = np.diag(normal) > 0.0
        damping = DAMPING * np.diag(normal)
        reached, _ = step_within(self._x, normal, gradient, free, damping, self._low, self._high)
        change = reached - self._x
        return [
            e - (slopes @ change[columns]).T
            for e, slopes, columns in zip(self._errors, self._slopes, self._columns, strict=True)
        ]
