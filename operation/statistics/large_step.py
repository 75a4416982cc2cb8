"""A large step after few records: three successive records that all lie far from those before them.

The cumulative sum compares each record with all before it, those after the step among them: where these are a large
part of all, the step widens the spread by which it is measured, and is never found.  Here the three are compared with
those before all three, by Student's test on recursive residuals, which is exact where nothing changes.
"""

from __future__ import annotations

import numpy as np

__all__ = ["large_step"]

#: Records that are compared with those before: one may be an outlier, and two may be by chance.
TOGETHER = 3
#: Share of their mean that each of them must have at least, on its side: an outlier beside two usual records has not.
EACH = 1.0 / 3.0


def large_step(
    residuals: np.ndarray, squares: np.ndarray, degrees: np.ndarray, correlation: np.ndarray, probability: float
) -> tuple[int, int, bool, float] | None:
    """Return index, first record, side and size of the first step whose probability by chance is below a limit.

    Parameters
    ----------
    residuals, squares, degrees : ndarray, shape (n,)
        As `operation.statistics.recursive_residuals.recursive_residuals` gives them.
    correlation : ndarray, shape (n,)
        From record to record, as those before each tell it.
    probability : float
        Of a step by chance, for each record, both sides together.
    """
    from scipy.stats import norm, t

    if residuals.size < TOGETHER:
        return None
    windows = np.lib.stride_tricks.sliding_window_view(residuals, TOGETHER)
    first = np.arange(windows.shape[0])
    known = (np.lib.stride_tricks.sliding_window_view(degrees, TOGETHER) > 0).all(axis=1) & (squares[first] > 0.0)
    mean, phi = windows.mean(axis=1), correlation[first]
    all_far = (windows * np.sign(mean)[:, None]).min(axis=1) >= EACH * np.abs(mean)
    # variance of the mean of three values of an autoregressive series of first order, in that of one
    of_mean = (3.0 + 4.0 * phi + 2.0 * phi**2) / 9.0
    freedom = np.where(known, degrees[first], 1.0)
    ratio = np.abs(mean) / np.sqrt(np.where(known, squares[first], 1.0) / freedom * of_mean)
    chance = 2.0 * np.asarray(t.sf(ratio, freedom))
    at = np.flatnonzero(known & all_far & (chance < probability))
    if at.size == 0:
        return None
    k = int(at[0])
    return k + TOGETHER - 1, k, bool(mean[k] > 0.0), float(norm.isf(max(0.5 * float(chance[k]), 1e-300)))
