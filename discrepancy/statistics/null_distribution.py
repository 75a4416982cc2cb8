"""The null distribution of the scores: drawn from shuffled residuals, with family-wise p-values.

Blocks of the whitened residual change places, with a random sign and a random circular shift, while the candidates
stay as they are.  With six or more records a block is a whole record; with fewer, records are cut into pieces that are
longer than the residual's correlation time.  The family-wise p-value compares with the most improbable score of each
draw, over all candidates.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import islice, pairwise

import numpy as np

from discrepancy.statistics.blocks import Array
from discrepancy.statistics.columns import columns_together
from discrepancy.statistics.projection import Layout, Projection
from discrepancy.statistics.score import Scorer
from multibody.base.memory import memory_limit
from multibody.base.parallel import available_cores

MIN_PIECES = 12
WHOLE_RECORDS = 6
P_FLOOR = 1e-12
DRAWS_TOGETHER = 50  # shuffled residuals that are scored in one product
#: Share of the limit of memory for the shuffled residuals for which the columns are read once; chosen.
DRAWS_SHARE = 0.1


@dataclass(frozen=True)
class Pieces:
    """Pieces that are shuffled: (block, first sample, number of samples)."""

    spans: tuple[tuple[int, int, int], ...]
    correlation_time: float
    dt: float

    @property
    def too_few(self) -> bool:
        """True if there are too few pieces for the shuffle to be varied."""
        return len(self.spans) < WHOLE_RECORDS


def correlation_length(layout: Layout, e: Array) -> float:
    """Integral correlation length of a stacked residual, samples: the largest of the channels."""
    from scipy.fft import irfft, next_fast_len, rfft

    worst = 1.0
    for c in range(layout.n_channels):
        num, den = None, 0.0
        n_lag = max(8, min(layout.lengths) // 4)
        for b, n in enumerate(layout.lengths):
            x = layout.view(e, b)[:, c]
            length = next_fast_len(2 * n, real=True)
            acf = irfft(np.abs(rfft(x, length)) ** 2, length)[:n_lag]
            num = acf if num is None else num[: len(acf)] + acf[: len(num)]
            den += float(x @ x)
        if num is None or den == 0:
            continue
        rho = np.asarray(num) / den
        below = np.flatnonzero(rho < 0.05)
        stop = int(below[0]) if below.size else len(rho)
        worst = max(worst, 1.0 + 2.0 * float(np.sum(rho[1:stop])))
    return worst


def cut_pieces(layout: Layout, dt: float, e: Array) -> Pieces:
    """Cut a residual into the pieces that are shuffled."""
    corr = correlation_length(layout, e)
    if len(layout.lengths) >= WHOLE_RECORDS:
        spans = [(b, 0, n) for b, n in enumerate(layout.lengths)]
        return Pieces(tuple(spans), corr * dt, dt)
    total = sum(layout.lengths)
    size = max(total / MIN_PIECES, 8.0 * corr, 32.0)
    spans = []
    for b, n in enumerate(layout.lengths):
        parts = max(1, int(n // size))
        edges = np.linspace(0, n, parts + 1).astype(int)
        spans += [(b, int(a), int(z - a)) for a, z in pairwise(edges)]
    return Pieces(tuple(spans), corr * dt, dt)


def shuffled_residuals(
    e: Array, projection: Projection, pieces: Pieces, draws: int, rng: np.random.Generator
) -> Iterator[Array]:
    """Yield projected shuffled residuals, shape (n_rows, ≤ `DRAWS_TOGETHER`)."""
    lay = projection.layout
    chunk = columns_together(lay.n_rows, DRAWS_TOGETHER)
    C = lay.n_channels
    n_piece = len(pieces.spans)
    scale = np.sqrt(lay.n_data / max(1.0, lay.n_data - projection.n_directions))
    views = [lay.view(e, b) for b in range(len(lay.lengths))]
    done = 0
    while done < draws:
        m = min(chunk, draws - done)
        out = np.zeros((lay.n_rows, m))
        for j in range(m):
            source = rng.permutation(n_piece)
            for target, src in enumerate(source):
                b, first, length = pieces.spans[target]
                sb, sfirst, slength = pieces.spans[src]
                idx = sfirst + (rng.integers(slength) + np.arange(length)) % slength
                r0 = lay.starts[b] + first * C
                sign = scale if rng.random() < 0.5 else -scale
                out[r0 : r0 + length * C, j] = (sign * views[sb][idx]).reshape(-1)
        if lay.n_prior:
            out[lay.n_data :] = rng.standard_normal((lay.n_prior, m))
        yield projection.remove(out)
        done += m


class CandidateNulls:
    """Null distribution of each candidate: its own draws, continued beyond the upper tenth as an exponential.

    Candidates differ in how large a score chance can give them.  A narrow bump meets few independent stretches of
    residual, and its −ln p has a long tail; were all compared with the largest of all, that tail would hide the others.

    Parameters
    ----------
    draws : ndarray, shape (n_candidates, n)
        −ln p of the F tail for shuffled residuals.
    """

    def __init__(self, draws: Array) -> None:
        self._sorted = np.sort(draws, axis=1)
        n = draws.shape[1]
        tail = max(10, n // 10)
        self._base = self._sorted[:, max(0, n - tail - 1)]
        self._scale = np.maximum(1.0, np.mean(self._sorted[:, n - tail :], axis=1) - self._base)
        self._at_base = -np.log((tail + 1.0) / (n + 1.0))

    def neg_log_p(self, u: Array) -> Array:
        """Return −ln of the probability that chance gives each candidate a u as large, for u (n_candidates, m)."""
        n = self._sorted.shape[1]
        below = np.array(
            [np.searchsorted(draws, values, side="left") for draws, values in zip(self._sorted, u, strict=True)]
        )
        within = -np.log((1.0 + n - below.reshape(u.shape)) / (n + 1.0))
        beyond = self._at_base + (u - self._base[:, None]) / self._scale[:, None]
        return np.where(u > self._base[:, None], beyond, within)

    def quantile(self, neg_log_p: float) -> Array:
        """Return the u of each candidate that chance reaches with probability exp(−neg_log_p), (n_candidates,)."""
        within = np.quantile(self._sorted, 1.0 - np.exp(-neg_log_p), axis=1)
        beyond = self._base + (neg_log_p - self._at_base) * self._scale
        return np.where(neg_log_p > self._at_base, beyond, within)


@dataclass(frozen=True)
class NullDistribution:
    """Null distribution of u, the −ln p of a score by its F distribution.

    Attributes
    ----------
    neg_log_p : ndarray, shape (n_candidates, draws)
        Largest u over each candidate's own shape grid.
    inflation : ndarray, shape (n_groups,)
        Mean LM/df of each group over the draws, the inflation that shuffling alone would give.
    pieces : Pieces
        What was shuffled.
    """

    neg_log_p: Array
    inflation: Array
    pieces: Pieces

    @cached_property
    def by_candidate(self) -> CandidateNulls:
        """Null distribution of each candidate."""
        return CandidateNulls(self.neg_log_p)

    @cached_property
    def maxima(self) -> Array:
        """Largest −ln p of every draw over all candidates, each by its own null, sorted, shape (draws,).

        A draw is compared with the other half of the draws, as data are compared with draws that they are not among.
        """
        largest = np.zeros(self.neg_log_p.shape[1])
        if len(self.neg_log_p):
            for half in (slice(0, None, 2), slice(1, None, 2)):
                rest = slice(1, None, 2) if half.start == 0 else slice(0, None, 2)
                nulls = CandidateNulls(self.neg_log_p[:, rest])
                largest[half] = nulls.neg_log_p(self.neg_log_p[:, half]).max(axis=0)
        return np.sort(largest)

    def p_value(self, u: Array) -> Array:
        """Return the family-wise p of the u of every candidate; beyond the draws as `tail_p` continues them."""
        return tail_p(self.maxima, self.by_candidate.neg_log_p(u[:, None])[:, 0])

    def critical_values(self, level: float) -> Array:
        """Return the u of every candidate that chance exceeds, at any of them, with probability ``level``."""
        if not len(self.neg_log_p):
            return np.zeros(0)
        return self.by_candidate.quantile(float(np.quantile(self.maxima, 1.0 - level)))

    def critical_interval(self, level: float) -> tuple[Array, Array]:
        """Return between which u of every candidate `critical_values` lies with nine of ten seeds.

        From the order statistics of the draws: how many of them lie beyond the true value is a binomial number.
        """
        from scipy.stats import binom

        if not len(self.neg_log_p):
            return np.zeros(0), np.zeros(0)
        n = self.maxima.size
        most, least = (int(binom.ppf(share, n, level)) for share in (0.95, 0.05))
        ends = (self.maxima[max(0, n - 1 - most)], self.maxima[min(n - 1, n - least)])
        low, high = (self.by_candidate.quantile(float(end)) for end in ends)
        return low, high


def tail_p(draws: Array, u: Array) -> Array:
    """Tail probability of u from sorted draws.

    Where ten or more draws lie above u this is their share, (1 + count)/(1 + draws). Further out the upper
    tenth is continued as an exponential. Its scale is the upper 95 % confidence limit of the mean excess and
    not less than one, the scale that a perfectly calibrated u would have. Nothing below 1e-12 is returned: a
    smaller number would describe the assumed tail and not the data.
    """
    x = np.sort(draws)
    n = len(x)
    above = n - np.searchsorted(x, u, side="left")
    p = (1.0 + above) / (n + 1.0)
    n_tail = max(10, n // 10)
    if n > 2 * n_tail:
        base = x[n - n_tail - 1]
        mean = float(np.mean(x[n - n_tail :] - base))
        scale = max(1.0, mean * (1.0 + 1.645 / np.sqrt(n_tail)))
        tail = (n_tail + 1.0) / (n + 1.0) * np.exp(-(np.maximum(u, base) - base) / scale)
        p = np.where(above >= 10, p, np.minimum(tail, (1.0 + 10) / (n + 1.0)))
    out: Array = np.clip(p, P_FLOOR, 1.0)
    return out


def null_distribution(
    scorer: Scorer,
    projection: Projection,
    e: Array,
    *,
    draws: int,
    rng: np.random.Generator,
    n_candidates: int,
    pieces: Pieces,
) -> NullDistribution:
    """Draw the null distribution: score shuffled residuals.

    Parameters
    ----------
    e : ndarray, shape (n_rows,)
        Projected residual with the significant effects removed.
    """
    groups = scorer.columns.groups
    owner = np.array([g.candidate for g in groups])
    largest = np.zeros((n_candidates, draws))
    total = np.zeros(len(groups))
    done = 0
    shuffled = shuffled_residuals(e, projection, pieces, draws, rng)
    bands, channels = scorer.variance.bands, projection.layout.n_channels
    together = columns_together(projection.layout.n_rows, DRAWS_TOGETHER)
    taken = together * (8 * projection.layout.n_rows + 16 * bands.n * channels**2)  # bytes, with their cross-spectra
    while some := list(islice(shuffled, max(available_cores(), int(DRAWS_SHARE * memory_limit() / taken)))):
        for s in scorer.each(some):
            m = s.neg_log_p.shape[1]
            block = np.zeros((n_candidates, m))
            np.maximum.at(block, owner, s.neg_log_p)
            largest[:, done : done + m] = block
            total += np.sum(s.score, axis=1)
            done += m
    return NullDistribution(largest, total / draws / scorer.kdim, pieces)
