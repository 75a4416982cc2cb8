"""The time by which one recording of a motion is shifted against another one."""

from __future__ import annotations

import numpy as np

__all__ = ["time_shift"]

#: Share of the samples that both must have in common at a shift.
LEAST_OVERLAP = 0.5
#: A shift nearer to zero is preferred where it leaves no more than this factor of what the best one leaves unexplained.
AS_GOOD = 1.1


def time_shift(step: float, reference: np.ndarray, signals: np.ndarray) -> tuple[float, float, float]:
    """Return the shift at which signals follow their references best, whatever their scales and offsets.

    Parameters
    ----------
    step : float, s
        Of the even grid of both.
    reference, signals : ndarray, shape (n, c)
        The signals have to be read ``shift`` later to follow: signals(t) ~ reference(t + shift).

    Returns
    -------
    shift : float, s
        A multiple of the step.
    left, left_unshifted : float
        Share of the signals' variance that a scaled reference leaves unexplained, at the shift and without it, as a
        mean over the signals; 1 where one falls while the other rises.

    Examples
    --------
    >>> t = np.arange(400) * 0.01
    >>> early = np.sin(t**2)[:, None]
    >>> round(time_shift(0.01, np.sin((t - 0.2) ** 2)[:, None], 3.0 * early + 1.0)[0], 2)
    0.2
    """
    from scipy.fft import irfft, next_fast_len, rfft

    n = len(signals)
    most = int((1.0 - LEAST_OVERLAP) * n)
    lags = np.arange(-most, most + 1)
    length = next_fast_len(2 * n, real=True)
    x = reference - reference.mean(axis=0)
    y = signals - signals.mean(axis=0)
    products = irfft(rfft(x, length, axis=0) * np.conj(rfft(y, length, axis=0)), length, axis=0)[lags]
    count = (n - np.abs(lags))[:, None]
    # of the samples i that have a partner i + lag in the reference
    of_x = [_sums(v, np.maximum(lags, 0), np.minimum(n + lags, n)) for v in (x, x**2)]
    of_y = [_sums(v, np.maximum(-lags, 0), np.minimum(n - lags, n)) for v in (y, y**2)]
    common = products - of_x[0] * of_y[0] / count
    spread_x, spread_y = (square - total**2 / count for total, square in (of_x, of_y))
    size = np.sqrt(np.maximum(spread_x, 0.0) * np.maximum(spread_y, 0.0))
    together = np.divide(common, size, out=np.zeros_like(common), where=size > 1e-12 * np.max(size, initial=0.0))
    left = np.mean(1.0 - np.clip(together, 0.0, 1.0) ** 2, axis=1)
    best = float(left.min())
    lowest = np.concatenate([[True], left[1:] <= left[:-1]]) & np.concatenate([left[:-1] <= left[1:], [True]])
    good = np.flatnonzero(lowest & (left <= AS_GOOD * best + 1e-9))
    taken = good[np.argmin(np.abs(lags[good]))]
    return float(lags[taken] * step), float(left[taken]), float(left[most])


def _sums(values: np.ndarray, first: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the sums of values[first:end] along the first axis, one row for each pair."""
    running = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    return np.asarray(running[end] - running[first])
