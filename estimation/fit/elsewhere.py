"""Where a fit begins again that may have ended in a local minimum.

Where dry friction stops a machine now here and now there, the error of a simulation is a rugged valley: it falls by
a factor of twenty towards the right parameters, over many small hills, and least squares stays between two of them.
A few simulations farther away, one parameter moved at a time, look over the hills.  They are judged by the sizes of the
errors and not by the weighted cost: an error that is correlated over a whole record has hardly any weight in that.
"""

from __future__ import annotations

import numpy as np

from estimation.fit.fit_problem import FitProblem

__all__ = ["better_place", "log_size"]

#: Prior deviations by which each parameter is moved from its mean, either way: where most of the probability lies,
#: and far enough from a fit that ended near the mean; chosen.
MOVED = 1.5
#: Decrease of the logarithm of the errors, summed over the outputs, that must be seen elsewhere: a fifth of one error.
#: Hills on the ground of a valley are no reason to begin again; chosen.
LOWER = 0.2
#: Size of an error, in standard deviations of the noise, above which it is worth looking: a fit that is right leaves
#: one of them; chosen.
POOR = 2.0


def log_size(problem: FitProblem, theta: np.ndarray, floor: np.ndarray) -> float:
    """Return the logarithm of the root mean square errors, at least the noise, summed over the outputs.

    Infinite where a simulation fails.
    """
    return float(np.sum(np.log(np.maximum(_sizes(problem, theta), np.maximum(floor, 1e-300)))))


def better_place(problem: FitProblem, theta: np.ndarray, moving: np.ndarray, floor: np.ndarray) -> np.ndarray | None:
    """Return a place with clearly smaller errors than where a fit has ended; None if none is seen, or none is needed.

    Parameters
    ----------
    problem : FitProblem
    theta : ndarray, shape (k,)
        Where it has ended.
    moving : ndarray of int
        The unknowns that are fitted.
    floor : ndarray, shape (n_channels,)
        Noise of the outputs, SI; zero where it is not stated.
    """
    if np.all(_sizes(problem, theta) <= POOR * floor):
        return None
    low, high = problem.bounds()
    # what is unknown of each record was fitted beside the wrong parameters: also from where its own fit begins
    afresh = np.concatenate([theta[: problem.k], problem.start(None, None)[problem.k :]])
    begun = [theta] if np.array_equal(afresh, theta) else [theta, afresh]
    best, place = log_size(problem, theta, floor) - LOWER, None
    for j in moving[moving < problem.k]:
        parameter = problem.parameters[j]
        if not np.isfinite(parameter.std):
            continue
        for moved in (parameter.value - MOVED * parameter.std, parameter.value + MOVED * parameter.std):
            for begin in begun:
                there = begin.copy()
                there[j] = np.clip(moved, low[j], high[j])
                if (size := log_size(problem, there, floor)) < best:
                    best, place = size, there
    return place


def _sizes(problem: FitProblem, theta: np.ndarray) -> np.ndarray:
    """Return the root mean square error of each output, SI; infinite where a simulation fails."""
    residuals = problem.residuals(theta)
    if residuals is None:
        return np.full(problem.scale.size, np.inf)
    errors = np.concatenate(residuals[:-1]).reshape(-1, problem.scale.size) * problem.scale
    sizes: np.ndarray = np.sqrt(np.mean(errors**2, axis=0))
    return sizes
