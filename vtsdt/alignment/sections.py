"""Ranges of height where the deviation of the guide is above the threshold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vtsdt.files.rail_profile_table import JOIN

__all__ = ["ONE_SIDED_95", "Section", "sections"]

_SHORTEST = 0.02  # m
#: Quantile of the normal distribution for 95 % on one side.
ONE_SIDED_95 = 1.645


@dataclass(frozen=True, kw_only=True)
class Section:
    """A range of heights where the deviation is above the threshold.

    Parameters
    ----------
    low, high : float, m
    largest, at : float, m
        Largest deviation, and where.
    share : float
        Of the trips, those whose mean deviation over the range is above the threshold.
    confidence : float
        Probability that the deviation is above the threshold where the estimate is largest; not a number with one
        trip alone there, which has no scatter that would show how certain the estimate is.
    """

    low: float
    high: float
    largest: float
    at: float
    share: float = 1.0
    confidence: float = 1.0

    def __str__(self) -> str:
        return f"{self.low:.2f} to {self.high:.2f} m (up to {1e3 * self.largest:.2f} mm at {self.at:.2f} m)"


def sections(
    height: np.ndarray, deviation: np.ndarray, threshold: float, std: np.ndarray | None = None
) -> list[tuple[float, float]]:
    """Return the ranges of height where a deviation is above a threshold.

    Ranges less than 30 mm apart are joined, and ranges shorter than 20 mm are left out.  With the standard deviation of
    an estimate, two ranges are also joined if the estimate is nowhere between them below the threshold with 95 %: its
    own error explains the dip.

    Parameters
    ----------
    height, deviation : ndarray, shape (n,), m
        NaN where it is unknown.
    threshold : float, m
    std : ndarray, shape (n,), m, optional
        Standard deviation of an estimate.

    Examples
    --------
    >>> h = np.linspace(0.0, 1.0, 101)
    >>> [(round(a, 2), round(b, 2)) for a, b in sections(h, np.where(abs(h - 0.5) < 0.105, 3e-3, 1e-3), 2.3e-3)]
    [(0.4, 0.6)]
    """
    value = np.nan_to_num(deviation, nan=-np.inf)
    above = value > threshold
    edges = np.diff(np.concatenate([[0], above.astype(int), [0]]))
    surely_below = value + ONE_SIDED_95 * np.nan_to_num(std, nan=0.0) < threshold if std is not None else ~above
    ranges: list[list[float]] = []
    end = 0
    for a, b in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1, strict=True):
        if ranges and (height[a] - ranges[-1][1] < JOIN or not surely_below[end:a].any()):
            ranges[-1][1] = float(height[b])
        else:
            ranges.append([float(height[a]), float(height[b])])
        end = int(b)
    return [(a, b) for a, b in ranges if b - a >= _SHORTEST - 1e-12]
