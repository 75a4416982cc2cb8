"""The correlation time of a residual, and blocks that are longer than it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

__all__ = ["correlation_time", "cut_rows"]


def correlation_time(e: np.ndarray, longest: float = 0.2) -> float:
    """Return the integrated autocorrelation time of a series in samples, at least 1.

    The sum ends at the first lag where the autocorrelation falls below zero, or at ``longest`` of the series.
    """
    x = np.asarray(e, dtype=float) - np.mean(e)
    n = x.size
    power = float(x @ x)
    if n < 8 or power == 0.0:
        return 1.0
    from scipy.fft import irfft, next_fast_len, rfft

    length = next_fast_len(2 * n, real=True)
    rho = irfft(np.abs(rfft(x, length)) ** 2, length)[: max(2, int(longest * n))] / power
    negative = np.flatnonzero(rho < 0.0)
    end = negative[0] if negative.size else rho.size
    return float(max(1.0, 1.0 + 2.0 * rho[1:end].sum()))


def cut_rows(lengths: Sequence[int], shortest: int, most: int = 60) -> list[np.ndarray]:
    """Cut stacked records into blocks of at least ``shortest`` rows, none across two records.

    Returns the row indices of each block.
    """
    blocks: list[np.ndarray] = []
    total = sum(lengths)
    first = 0
    for length in lengths:
        wanted = max(1, round(most * length / max(total, 1)))
        count = max(1, min(wanted, length // max(shortest, 1)))
        blocks += [first + part for part in np.array_split(np.arange(length), count)]
        first += length
    return blocks
