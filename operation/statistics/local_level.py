"""A parameter from record to record: the posterior of the last one, widened by a stated drift, is the next prior.

The local level model: $z_k = θ_k + e_k$ with $e_k ∼ N(0, R_k + τ²)$, and $θ_k = θ_{k-1} + w_k$ with
$w_k ∼ N(0, q (t_k − t_{k−1}))$ (A. C. Harvey, Forecasting, Structural Time Series Models and the Kalman Filter, 1989,
section 2.3).  τ is what estimates of one and the same machine differ by beyond their own intervals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Level", "between_records", "local_level", "without_prior"]

#: Share of a prior's information below which a record counts as saying nothing on a parameter.
NOTHING = 0.02


@dataclass(frozen=True, eq=False)
class Level:
    """A parameter over the records.

    Parameters
    ----------
    mean, std : ndarray, shape (n,)
        After each record.
    """

    mean: np.ndarray
    std: np.ndarray


def without_prior(value: float, std: float, prior: float, prior_std: float) -> tuple[float, float]:
    """Return what a record alone says of a parameter that was fitted with a prior.

    Priors are taken off parameter by parameter, as if their posterior were uncorrelated.

    Returns
    -------
    value, std : float
        With an infinite deviation where the record adds less than a fiftieth of the prior's information.

    Examples
    --------
    >>> value, std = without_prior(1.5, 0.5**0.5, 1.0, 1.0)  # a prior and a record of equal weight
    >>> round(value, 9), round(std, 9)
    (2.0, 1.0)
    """
    if not np.isfinite(prior_std) or prior_std <= 0.0:
        return float(value), float(std)
    if not (np.isfinite(std) and std > 0.0):
        return float(value), np.inf
    information = std**-2 - prior_std**-2
    if information < NOTHING * prior_std**-2:
        return float(value), np.inf
    return float((value * std**-2 - prior * prior_std**-2) / information), float(information**-0.5)


def between_records(values: np.ndarray, stds: np.ndarray) -> float:
    """Return the standard deviation τ between records beyond their own intervals.

    From the differences of successive records, which neither a level nor a slow drift enters: the median of their
    squares, so that single jumps do not count.

    Parameters
    ----------
    values, stds : ndarray, shape (n,)
    """
    known = np.isfinite(values) & np.isfinite(stds)
    v, s = np.asarray(values)[known], np.asarray(stds)[known]
    if v.size < 3:
        return 0.0
    # the median of a chi-squared variable with one degree of freedom
    total = float(np.median(np.diff(v) ** 2)) / 0.4549364231195728
    own = float(np.median(s[1:] ** 2 + s[:-1] ** 2))
    return float(np.sqrt(max(0.5 * (total - own), 0.0)))


def local_level(
    times: np.ndarray, values: np.ndarray, stds: np.ndarray, prior: tuple[float, float], drift: float, between: float
) -> Level:
    """Return the posterior of a parameter after each record.

    Parameters
    ----------
    times : ndarray, shape (n,), s
        Increasing.
    values, stds : ndarray, shape (n,)
        What each record alone says; an infinite deviation says nothing.
    prior : (float, float)
        Mean and standard deviation before the first record; an infinite deviation for none.
    drift : float, unit/√s
        Standard deviation of the change over a second.
    between : float
        τ.
    """
    mean, variance = float(prior[0]), float(prior[1]) ** 2
    means, deviations = np.empty(len(times)), np.empty(len(times))
    for k, (t, z, s) in enumerate(zip(times, values, stds, strict=True)):
        if k > 0:
            variance += drift**2 * max(float(t - times[k - 1]), 0.0)
        if np.isfinite(z) and np.isfinite(s):
            noise = float(s) ** 2 + between**2
            if not np.isfinite(variance):
                mean, variance = float(z), noise
            elif variance + noise > 0.0:
                gain = variance / (variance + noise)
                mean, variance = mean + gain * (float(z) - mean), (1.0 - gain) * variance
        means[k], deviations[k] = mean, np.sqrt(variance)
    return Level(means, deviations)
