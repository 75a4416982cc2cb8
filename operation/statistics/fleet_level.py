"""What a fleet says: the prior of the next machine, the level that a share does not exceed, and who lies outside.

`fleet_prior` is empirical Bayes in the normal-normal model with unequal variances (R. DerSimonian, N. Laird,
Controlled Clinical Trials 7 (1986) 177; intervals of J. Hartung, G. Knapp, Statistics in Medicine 20 (2001) 1771);
`share_level` is the rule of Fig. 10 of González et al. 2020.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["FleetPrior", "fleet_prior", "outliers", "share_level"]


@dataclass(frozen=True, kw_only=True)
class FleetPrior:
    """What a fleet says about a parameter.

    Parameters
    ----------
    mean, mean_std : float
        Mean over the machines and its standard error.
    spread : float
        Standard deviation between machines.
    spread_interval : (float, float)
        95 %, by the generalised Q statistic.
    count : int
        Machines.
    """

    mean: float
    mean_std: float
    spread: float
    spread_interval: tuple[float, float]
    count: int

    @property
    def std(self) -> float:
        """Standard deviation of the prior of the next machine: spread and error of the mean together."""
        return float(np.hypot(self.spread, self.mean_std))


def fleet_prior(values: np.ndarray, stds: np.ndarray) -> FleetPrior:
    """Return mean and spread of a parameter over machines, of each of which an estimate is known.

    Parameters
    ----------
    values, stds : ndarray, shape (n,)
        Estimates and their standard deviations; machines with an infinite one are left out.

    Raises
    ------
    ValueError
        With fewer than three machines.
    """
    known = np.isfinite(values) & np.isfinite(stds)
    v, own = np.asarray(values, dtype=float)[known], np.asarray(stds, dtype=float)[known] ** 2
    if v.size < 3:
        raise ValueError(f"{v.size} machines are too few for a prior of the fleet: give three or more")
    spread = _spread(v, own, float(v.size - 1))
    from scipy.stats import chi2

    high = _spread(v, own, float(chi2.ppf(0.025, v.size - 1)))
    low = _spread(v, own, float(chi2.ppf(0.975, v.size - 1)))
    weights = 1.0 / np.maximum(own + spread**2, 1e-300)
    mean = float(np.sum(weights * v) / np.sum(weights))
    error = np.sum(weights * (v - mean) ** 2) / ((v.size - 1) * np.sum(weights))
    return FleetPrior(
        mean=mean, mean_std=float(np.sqrt(error)), spread=spread, spread_interval=(low, high), count=int(v.size)
    )


def _spread(values: np.ndarray, own: np.ndarray, target: float) -> float:
    """Return the spread at which the weighted sum of squares about the mean is the target (Paule and Mandel 1982)."""

    def excess(square: float) -> float:
        weights = 1.0 / np.maximum(own + square, 1e-300)
        mean = np.sum(weights * values) / np.sum(weights)
        return float(np.sum(weights * (values - mean) ** 2)) - target

    if excess(0.0) <= 0.0:
        return 0.0
    low, high = 0.0, float(np.var(values)) + 1e-300
    while excess(high) > 0.0:
        high *= 4.0
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0.0 else (low, middle)
        if high - low <= 1e-12 * high:
            break
    return float(np.sqrt(0.5 * (low + high)))


def share_level(
    values: np.ndarray, share: float = 0.7, *, draws: int = 2000, seed: int = 0
) -> tuple[float, tuple[float, float]]:
    """Return the smallest value that at least a share of all does not exceed, and its 95 % interval by bootstrap.

    Parameters
    ----------
    values : ndarray, shape (n,)
    share : float
    draws : int
    seed : int

    Raises
    ------
    ValueError
        If there are fewer than three values, or the share is not between 0 and 1.

    Examples
    --------
    >>> share_level(np.arange(1.0, 15.0))[0]  # the tenth of fourteen
    10.0
    """
    values = np.asarray(values, dtype=float)
    if values.size < 3:
        raise ValueError(f"{values.size} values are too few for a threshold: give three or more")
    if not 0.0 < share < 1.0:
        raise ValueError(f"the fraction is {share:g}: give a share between 0 and 1, such as 0.7")
    drawn = values[np.random.default_rng(seed).integers(values.size, size=(draws, values.size))]
    levels = np.quantile(drawn, share, axis=1, method="inverted_cdf")
    level = float(np.quantile(values, share, method="inverted_cdf"))
    return level, (float(np.quantile(levels, 0.025)), float(np.quantile(levels, 0.975)))


def outliers(values: np.ndarray, stds: np.ndarray, level: float = 0.05) -> Sequence[tuple[int, float]]:
    """Return the machines that lie outside of the rest of the fleet, and by how many standard deviations.

    Each is compared with the prior of all others (so that it does not hide itself); the level is family-wise
    (Bonferroni).

    Parameters
    ----------
    values, stds : ndarray, shape (n,)
    level : float
    """
    from scipy.stats import t

    known = np.flatnonzero(np.isfinite(values) & np.isfinite(stds))
    outlying: list[tuple[int, float]] = []
    if known.size < 5:
        return outlying
    limit = float(t.isf(0.5 * level / known.size, known.size - 2))
    for k in known:
        rest = known[known != k]
        prior = fleet_prior(np.asarray(values)[rest], np.asarray(stds)[rest])
        away = (float(values[k]) - prior.mean) / max(float(np.hypot(prior.std, stds[k])), 1e-300)
        if abs(away) > limit:
            outlying.append((int(k), away))
    return sorted(outlying, key=lambda one: -abs(one[1]))
