"""Hat functions: the piecewise-linear basis of a curve that is given by its values at knots."""

from __future__ import annotations

import numpy as np

from discrepancy.statistics.blocks import Array

__all__ = ["even_hat_functions", "hat_functions", "quantile_knots"]

#: Share of the range by which knots lie apart, at least: between closer ones a curve is free to take any slope, and
#: its curvature, relative to the usual spacing, leaves the range of the numbers.
NEAREST = 1e-3


def hat_functions(values: Array, knots: Array) -> Array:
    """Return each knot's hat function at the values, shape (n, len(knots)); rows sum to one.

    Values beyond the first or last knot are treated as if they lay on it.
    """
    x = np.clip(values, knots[0], knots[-1])
    i = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, len(knots) - 2)
    w = (x - knots[i]) / (knots[i + 1] - knots[i])
    out = np.zeros((len(values), len(knots)))
    rows = np.arange(len(values))
    out[rows, i] = 1.0 - w
    out[rows, i + 1] += w
    return out


def quantile_knots(values: Array, n: int) -> Array:
    """Return up to n knots at quantiles of the distinct values, so that long rests do not take them all.

    Values count as distinct, and knots lie apart, by a thousandth of the range at least.  Empty where that leaves fewer
    than three knots.

    Examples
    --------
    >>> quantile_knots(np.array([0.0, 0.0, 0.0, 1e-9, 1.0, 2.0]), 3).tolist()
    [0.0, 1.0, 2.0]
    """
    low, span = float(np.min(values)), float(np.ptp(values))
    if span <= 0.0:
        return np.empty(0)
    v = low + span * NEAREST * np.unique(np.round((np.asarray(values) - low) / (span * NEAREST)))
    k = np.quantile(v, np.linspace(0, 1, n))
    k = k[np.concatenate([[True], np.diff(k) > 0.5 * span * NEAREST])]
    return k if len(k) >= 3 else np.empty(0)


def even_hat_functions(position: Array, count: int) -> Array:
    """Return the hat functions of evenly spaced knots, shape (n, count).

    Parameters
    ----------
    position : ndarray, shape (n,)
        In knot intervals: 0 at the first knot, ``count − 1`` at the last.
    count : int
        Number of knots.

    Examples
    --------
    >>> even_hat_functions(np.array([0.0, 1.25]), 3).tolist()
    [[1.0, 0.0, 0.0], [0.0, 0.75, 0.25]]
    """
    return np.maximum(0.0, 1.0 - np.abs(position[:, None] - np.arange(count)))
