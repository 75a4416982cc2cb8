"""The bandwidth of a recorded signal: the highest frequency at which it stands out of its noise."""

from __future__ import annotations

import numpy as np

__all__ = ["signal_bandwidth"]


def signal_bandwidth(time: np.ndarray, values: np.ndarray) -> float:
    """Return the highest frequency at which a signal stands out of its noise, Hz, at most a tenth of the sampling rate.

    The noise is taken as white with the median density of the upper quarter of the spectrum; the signal stands out
    where the density, smoothed over neighbours, is ten times that.
    """
    values = np.asarray(values, dtype=float)
    n = values.size
    rate = (n - 1) / float(time[-1] - time[0])
    line = values[0] + (values[-1] - values[0]) * np.arange(n) / max(n - 1, 1)
    density = np.abs(np.fft.rfft((values - line) * np.hanning(n))) ** 2
    frequency = np.arange(density.size) * rate / n
    neighbours = max(3, density.size // 200)
    smooth = np.convolve(density, np.ones(neighbours) / neighbours, mode="same")
    # The median of a periodogram is ln 2 times its mean.
    noise = float(np.median(density[3 * density.size // 4 :])) / np.log(2.0)
    out = np.flatnonzero(smooth > 10.0 * noise)
    low, high = 4.0 * rate / n, 0.1 * rate
    return float(np.clip(frequency[out[-1]] if out.size else low, min(low, high), high))
