"""Take the colour out of a residual: prediction-error filters whose memory reaches far with few numbers.

A residual of a real machine mixes fast sensor noise with slow drift. A plain autoregression at a high
sampling rate forgets after a few milliseconds and never sees the drift. Here each channel is predicted from
its last samples one by one and, further back, from means over windows that double in length (5-8, 9-16, 17-32
… samples ago). A dozen coefficients then reach seconds into the past. The number of single lags and of
windows is chosen by AIC: BIC prefers filters that forget a slow drift, and with one or two records of 6 s
that raised false alarms under a mixed disturbance from 4 in 60 to 9 in 60. The first samples of a block,
which have no past, use the same predictor cut short, each with its own variance, so nothing has to be thrown
away.

The long windows are those of the heterogeneous autoregression of Corsi (2009), J. Financial Econometrics 7,
174.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from discrepancy.statistics.blocks import Array

# Cost of one coefficient in units of twice the log-likelihood; 2 is Akaike's.
PENALTY = 2.0
# Samples up to which a filter is applied as a matrix, where there are at least as many signals.
AS_MATRIX = 400
_SINGLE_LAGS = (0, 1, 2, 4, 8, 16, 32)


def _groups(single: int, longest: int) -> list[tuple[int, int]]:
    """Return lag windows (first, last), inclusive: single lags, then doubling windows, none beyond ``longest``."""
    groups = [(k, k) for k in range(1, min(single, longest) + 1)]
    first = single + 1
    while True:
        width = max(1, first - 1) if single else first
        last = first + width - 1
        if last > longest:
            return groups
        groups.append((first, last))
        first = last + 1


def _lag_mean(x: Array, cs: Array, first: int, last: int, start: int, stop: int) -> Array:
    """Mean of x[t-last .. t-first] for t in [start, stop); needs start >= last."""
    if first == last:
        return x[start - first : stop - first]
    out: Array = (cs[start - first + 1 : stop - first + 1] - cs[start - last : stop - last]) / (last - first + 1)
    return out


def _cumsum(x: Array) -> Array:
    cs = np.zeros((x.shape[0] + 1, *x.shape[1:]))
    np.cumsum(x, axis=0, out=cs[1:])
    return cs


@dataclass(frozen=True)
class ChannelFilter:
    """Prediction-error filter of one channel.

    Attributes
    ----------
    groups : tuple of (int, int)
        Lag windows, samples.
    coefficients : tuple of ndarray
        ``coefficients[j]`` uses the first j windows; the last one is the full filter.
    stds : ndarray
        Standard deviation of the prediction error with the first j windows, in the channel's unit.
    matrices : dict of int to ndarray
        The filter as a matrix, by number of samples: one product for many short signals.
    """

    groups: tuple[tuple[int, int], ...]
    coefficients: tuple[Array, ...]
    stds: Array
    matrices: dict[int, Array] = field(default_factory=dict, repr=False, compare=False)

    @property
    def order(self) -> int:
        """Number of coefficients."""
        return len(self.groups)

    @property
    def memory(self) -> int:
        """Longest lag used, samples."""
        return self.groups[-1][1] if self.groups else 0

    def apply(self, x: Array) -> Array:
        """WhitenedProblem signal in units of the noise standard deviation, for x of shape (n_t,) or (n_t, m)."""
        if x.ndim > 1 and x.shape[0] <= min(AS_MATRIX, x.shape[1]):
            return self._as_matrix(x.shape[0]) @ x
        return self._step_by_step(x)

    def _as_matrix(self, n: int) -> Array:
        """Return what whitens n samples, shape (n, n)."""
        if n not in self.matrices:
            self.matrices[n] = self._step_by_step(np.eye(n))
        return self.matrices[n]

    def _step_by_step(self, x: Array) -> Array:
        out = np.array(x, dtype=float)
        n = x.shape[0]
        cs = _cumsum(x) if any(a != b for a, b in self.groups) else np.empty(0)
        edges = [0, *[last for _, last in self.groups], n]
        for j in range(len(self.groups) + 1):
            start, stop = min(edges[j], n), (min(edges[j + 1], n) if j < len(self.groups) else n)
            if stop <= start:
                continue
            part = out[start:stop]
            for phi, (first, last) in zip(self.coefficients[j], self.groups[:j], strict=True):
                part -= phi * _lag_mean(x, cs, first, last, start, stop)
            part /= self.stds[j]
        return out


@dataclass(frozen=True)
class Whitener:
    """One prediction-error filter per channel; apply it to residual, sensitivities and candidates alike."""

    filters: tuple[ChannelFilter, ...]
    channels: tuple[str, ...]
    dt: float

    def apply(self, block: Array) -> Array:
        """Whiten a block of shape (n_t, n_channels) or (n_t, n_channels, m)."""
        out = np.empty_like(block, dtype=float)
        for c, f in enumerate(self.filters):
            out[:, c] = f.apply(block[:, c])
        return out

    @property
    def noise_std(self) -> Array:
        """Standard deviation of the one-step prediction error, per channel, in the channel's unit."""
        return np.array([f.stds[-1] for f in self.filters])

    def __repr__(self) -> str:
        parts = [
            f"{n}: {f.order} coefficients, memory {f.memory * self.dt:.3g} s, noise {f.stds[-1]:.3g}"
            for n, f in zip(self.channels, self.filters, strict=True)
        ]
        return "Whitener(" + "; ".join(parts) + ")"


def identity(stds: Sequence[float], channels: Sequence[str], dt: float) -> Whitener:
    """Divide by a known noise level and leave the colour alone."""
    none = tuple(ChannelFilter((), (np.empty(0),), np.array([s])) for s in stds)
    return Whitener(none, tuple(channels), dt)


def _fit_channel(series: Sequence[Array], max_order: int, longest: int) -> ChannelFilter:
    best: tuple[float, list[tuple[int, int]], int] | None = None
    pooled = float(np.mean(np.concatenate([s**2 for s in series])))
    if pooled == 0.0:
        return ChannelFilter((), (np.empty(0),), np.array([1.0]))
    sums = [_cumsum(s) for s in series]

    def design(groups: list[tuple[int, int]], start: int) -> tuple[Array, Array]:
        rows = [s[start:] for s in series if len(s) > start]
        mats = [
            np.column_stack([_lag_mean(s, cs, a, b, start, len(s)) for a, b in groups])
            for s, cs in zip(series, sums, strict=True)
            if len(s) > start
        ]
        return np.concatenate(mats), np.concatenate(rows)

    for single in (k for k in _SINGLE_LAGS if k <= max_order):
        groups = _groups(single, longest)[: max(max_order, single)]
        if not groups:
            continue
        X, y = design(groups, longest)
        n = len(y)
        if n < 4 * len(groups):
            continue
        q = np.asarray(np.linalg.qr(np.column_stack([X, y]), mode="r"))
        r = q[: len(groups), -1]
        rss = float(y @ y) - np.concatenate([[0.0], np.cumsum(r**2)])
        rss = np.maximum(rss, 1e-14 * float(y @ y))
        aic = n * np.log(rss / n) + np.arange(len(groups) + 1) * PENALTY
        j = int(np.argmin(aic))
        if best is None or aic[j] < best[0]:
            best = (float(aic[j]), groups, j)
    if best is None:
        return ChannelFilter((), (np.empty(0),), np.array([np.sqrt(pooled)]))
    groups = best[1][: best[2]]
    coefs: list[Array] = [np.empty(0)]
    stds = [np.sqrt(pooled)]
    if groups:
        # The start of the fit leaves out only what the chosen filter needs, so that no data are wasted.
        X, y = design(groups, groups[-1][1])
        R = np.asarray(np.linalg.qr(np.column_stack([X, y]), mode="r"))
        for j in range(1, len(groups) + 1):
            phi = np.linalg.lstsq(R[:j, :j], R[:j, -1], rcond=1e-12)[0]
            coefs.append(phi)
            tail = float(R[j:, -1] @ R[j:, -1])
            stds.append(np.sqrt(max(tail, 1e-20 * pooled) / max(1, len(y) - j)))
    return ChannelFilter(tuple(groups), tuple(coefs), np.array(stds))


def fit_whitener(
    blocks: Sequence[Array],
    dt: float,
    channels: Sequence[str],
    *,
    max_order: int = 24,
    memory: float | None = None,
) -> Whitener:
    """Fit the prediction-error filters on a residual.

    Parameters
    ----------
    blocks : sequence of ndarray, shape (n_t, n_channels)
        Residual from which calibration and, if known, the missing effects have been removed. An effect left
        in the residual is taken for noise and the scan loses power, but stays honest.
    dt : float
        Sampling interval, s.
    channels : sequence of str
        Channel names.
    max_order : int
        Largest number of coefficients per channel.
    memory : float, optional
        Longest memory, s; default a sixth of the longest block.
    """
    n_long = max(len(b) for b in blocks)
    longest = n_long // 6 if memory is None else min(n_long // 3, round(memory / dt))
    filters = tuple(_fit_channel([b[:, c] for b in blocks], max_order, max(1, longest)) for c in range(len(channels)))
    return Whitener(filters, tuple(channels), dt)
