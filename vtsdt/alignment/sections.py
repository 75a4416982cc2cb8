"""Ranges of height where the guide is beyond the threshold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["SURE", "Section", "sections"]

_JOIN = 0.03  # m: sections nearer to each other are one
_SHORTEST = 0.02  # m
#: Standard deviations that a normal quantity exceeds on one side once in twenty.
SURE = 1.645


@dataclass(frozen=True)
class Section:
    """A range of heights where the deviation is beyond the threshold.

    Parameters
    ----------
    low, high : float, m
    largest, at : float, m
        Largest deviation, and where.
    share : float
        Of the trips whose mean deviation over the range is beyond the threshold.
    confidence : float
        Probability that the guide is beyond the threshold where the estimate is largest.
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
    """Return the ranges of height where a deviation is beyond a threshold.

    Ranges less than 30 mm apart are one, and ranges shorter than 20 mm are left out.  Of a deviation that is an
    estimate two ranges are also one if nowhere between them it is below the threshold with 95 %: a dip that the
    estimate's own error explains parts nothing.

    Parameters
    ----------
    height, deviation : ndarray, shape (n,), m
        NaN where nothing is known.
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
    surely_below = value + SURE * np.nan_to_num(std, nan=0.0) < threshold if std is not None else ~above
    found: list[list[float]] = []
    end = 0
    for a, b in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1, strict=True):
        if found and (height[a] - found[-1][1] < _JOIN or not surely_below[end:a].any()):
            found[-1][1] = float(height[b])
        else:
            found.append([float(height[a]), float(height[b])])
        end = int(b)
    return [(a, b) for a, b in found if b - a >= _SHORTEST - 1e-12]
