"""What a series of standardised residuals says beyond its correlation from record to record.

L. C. Alwan, H. V. Roberts, J. Business & Economic Statistics 6 (1988) 87 (a chart of the prediction errors of an
autocorrelated series); here the series is autoregressive of first order.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

__all__ = ["correlation_before", "prediction_errors"]

#: Correlation that is expected before anything is seen, and the records that this expectation counts for; chosen.
#: Twenty independent records leave their correlation uncertain by 0.33, and without an expectation the chart alarms at
#: that: 1.0 a year where 0.2 is stated (150 machine years, 95 % interval 0.85 to 1.2).
EXPECTED, WEIGHT = 0.25, 40.0
#: Largest correlation taken off: beyond it a level that wanders is nearly a change.
LARGEST = 0.95


def prediction_errors(residuals: np.ndarray, earlier: Sequence[np.ndarray] = ()) -> np.ndarray:
    """Return the part of each residual that the last one does not predict, with unit variance.

    The correlation φ comes from the records before, of differences $d$ of successive residuals, which neither a level
    nor a slow drift enters: $φ = 1 + 2 \\sum d_k d_{k-1} / \\sum d_k^2$.  A negative one is left alone: it makes alarms
    rarer.

    Parameters
    ----------
    residuals : ndarray, shape (n,)
        Of unit variance; NaN where there is none.
    earlier : sequence of ndarray
        Residuals before these, about other levels.

    Examples
    --------
    >>> prediction_errors(np.array([np.nan, 1.0, 1.0])).round(3)  # nothing seen yet: φ is the expected one
    array([  nan, 1.   , 0.775])
    """
    u = np.asarray(residuals, dtype=float)
    phi = correlation_before(u, earlier)
    last = np.concatenate([[np.nan], u[:-1]])
    return np.where(np.isfinite(last), (u - phi * last) / np.sqrt(1.0 - phi**2), u)


def correlation_before(residuals: np.ndarray, earlier: Sequence[np.ndarray] = ()) -> np.ndarray:
    """Return the correlation from record to record as those before each residual tell it.

    Parameters
    ----------
    residuals, earlier
        As for `prediction_errors`.
    """
    u = np.asarray(residuals, dtype=float)
    before = (
        np.sum([_sums(np.asarray(e, dtype=float)).sum(axis=0) for e in earlier], axis=0) if earlier else np.zeros(3)
    )
    sums = before + np.vstack([np.zeros((min(3, u.size), 3)), np.cumsum(_sums(u), axis=0)[:-1]])
    products, squares, count = sums.T
    seen = 1.0 + 2.0 * np.divide(products, squares, out=np.zeros(u.size), where=squares > 0.0)
    return np.clip((count * seen + WEIGHT * EXPECTED) / (count + WEIGHT), 0.0, LARGEST)


def _sums(u: np.ndarray) -> np.ndarray:
    """Return, for each three successive residuals, the product and mean square of their differences, and 1."""
    d = np.diff(u)
    terms = np.column_stack([d[1:] * d[:-1], 0.5 * (d[1:] ** 2 + d[:-1] ** 2), np.ones(max(d.size - 1, 0))])
    return np.where(np.isfinite(terms[:, :1]), terms, 0.0)
