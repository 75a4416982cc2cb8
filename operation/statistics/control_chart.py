"""Changes in a series of records at a stated rate of false alarms: the cumulative sum of prediction errors.

Beside it stands `operation.statistics.large_step`, for steps after few records.

E. S. Page, Biometrika 41 (1954) 100 (the chart); D. Brook, D. A. Evans, Biometrika 59 (1972) 539 (its run length by a
Markov chain); the errors are those of `operation.statistics.prediction_errors`, of standardised residuals.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from operation.statistics.large_step import large_step
from operation.statistics.prediction_errors import correlation_before, prediction_errors
from operation.statistics.recursive_residuals import recursive_residuals, standardised_residuals

__all__ = ["Change", "control_chart", "decision_limit", "mean_run_length"]

#: Half the shift, in standard deviations of a record, that the chart finds quickest: one standard deviation.
REFERENCE = 0.5
#: States of the Markov chain: with 100 and 200 the run length differs by less than 0.1 %.
STATES = 120
#: Records without an alarm that a limit may ask for, on the average.
LONGEST_RUN = 1e7
#: False alarms of the test for a large step, as a share of those that are stated: so few that the rate stays.
STEP_SHARE = 0.05


@dataclass(frozen=True, kw_only=True)
class Change:
    """A change that the chart has found.

    Parameters
    ----------
    found : int
        Index of the record at which the sum passed its limit, or a large step was seen.
    since : int
        Index of the first record after the sum was last zero, or of the large step: the estimate of the change point.
    up : bool
        Whether the values have grown.
    statistic : float
        The sum, or the step, in standard deviations.
    """

    found: int
    since: int
    up: bool
    statistic: float


@lru_cache(maxsize=256)
def mean_run_length(limit: float, reference: float = REFERENCE, shift: float = 0.0) -> float:
    """Return the mean number of records until the one-sided sum passes a limit, by a Markov chain.

    Parameters
    ----------
    limit : float
        In standard deviations of a record.
    reference : float
        Subtracted from every record.
    shift : float
        Mean of the records, in their standard deviations; 0 gives the mean time between false alarms.

    Examples
    --------
    >>> round(mean_run_length(4.0), 0)  # one side; two sides have half of it, 168 (D. C. Montgomery, table 9.3)
    335.0
    """
    from scipy.special import ndtr

    width = 2.0 * limit / (2 * STATES - 1)
    centres = np.arange(STATES) * width
    ahead = ndtr(centres[None, :] - centres[:, None] + 0.5 * width + reference - shift)
    back = ndtr(centres[None, :] - centres[:, None] - 0.5 * width + reference - shift)
    chain = ahead - back
    chain[:, 0] = ahead[:, 0]
    return float(np.linalg.solve(np.eye(STATES) - chain, np.ones(STATES))[0])


@lru_cache(maxsize=256)
def decision_limit(records: float, reference: float = REFERENCE) -> float:
    """Return the limit of the two-sided chart with so many records between false alarms on the average.

    Parameters
    ----------
    records : float
        Mean number of records; the two sides have half the rate each.

    Raises
    ------
    ValueError
        If it is not from 2 to ten million.
    """
    from scipy.optimize import brentq

    if not 2.0 <= records <= LONGEST_RUN:
        raise ValueError(f"{records:g} records between false alarms: give 2 to {LONGEST_RUN:g}")
    return float(brentq(lambda h: np.log(mean_run_length(h, reference) / (2.0 * records)), 1e-3, 40.0, xtol=1e-6))


def control_chart(
    values: np.ndarray, records_per_alarm: float, covariates: np.ndarray | None = None
) -> tuple[Change, ...]:
    """Return the changes of a series; after each the chart starts again with the records that follow.

    Parameters
    ----------
    values : ndarray, shape (n,)
        In the order of their time; NaN is left out.
    records_per_alarm : float
        Mean number of records between false alarms.
    covariates : ndarray, shape (n, q), optional
        Conditions that the values may depend on.

    Notes
    -----
    The rate holds where the values are normal about a constant and the covariates and hardly correlated from record to
    record; where they are strongly correlated it is above the stated one, as the page *False alarms* shows.
    """
    limit = decision_limit(records_per_alarm)
    values = np.asarray(values, dtype=float)
    kept = np.flatnonzero(np.isfinite(values))
    changes: list[Change] = []
    earlier: list[np.ndarray] = []
    start = 0  # into kept
    while start < kept.size:
        rows = kept[start:]
        given = values[rows], None if covariates is None else np.asarray(covariates)[rows]
        u = standardised_residuals(*given)
        passage = _first_passage(prediction_errors(u, earlier), limit)
        correlation = correlation_before(u, earlier)
        step = large_step(*recursive_residuals(*given), correlation, STEP_SHARE / records_per_alarm)
        if passage is None and step is None:
            break
        at, since, up, size = min((found for found in (step, passage) if found is not None), key=lambda f: f[0])
        changes.append(Change(found=int(rows[at]), since=int(rows[since]), up=bool(up), statistic=float(size)))
        earlier.append(u[: at + 1])
        start += at + 1  # not from the change point on: those records were chosen because they lie on one side
    return tuple(changes)


def _first_passage(u: np.ndarray, limit: float) -> tuple[int, int, bool, float] | None:
    """Return index, change point, side and sum of the first passage of a limit."""
    high = low = 0.0
    high_since = low_since = 0
    for k, value in enumerate(u):
        if not np.isfinite(value):
            high_since = low_since = k + 1
            continue
        high, low = high + value - REFERENCE, low - value - REFERENCE
        if high <= 0.0:
            high, high_since = 0.0, k + 1
        if low <= 0.0:
            low, low_since = 0.0, k + 1
        if max(high, low) > limit:
            up = high >= low
            return k, high_since if up else low_since, up, max(high, low)
    return None
