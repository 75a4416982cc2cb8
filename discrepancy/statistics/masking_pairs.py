"""Masking pairs: two effects that nearly cancel in the outputs, so that each alone explains little and both much.

A reference that comes late and a loop that is stiffer than stated do nearly opposite things to the motion.  The records
show only the difference of the two, and neither effect alone explains it.  So the gain of every pair is computed
jointly, from the Gram matrix of the candidates' columns in a scan; see docs/method/score-scan.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from discrepancy.statistics.blocks import Array
from discrepancy.statistics.null_distribution import cut_pieces, shuffled_residuals, tail_p
from discrepancy.statistics.scan_result import ScanResult, ScanRow
from discrepancy.statistics.thresholds import TWIN_CORRELATION
from discrepancy.statistics.ties import canonical_correlation

__all__ = ["MaskingPairs", "Pair", "PairScores", "find_masking_pairs"]

MASKING_RATIO = 2.0  # joint gain over the sum of the two gains alone, from which a pair counts as masking; chosen
APART = 1e-3  # share of an effect's energy that another must leave of it, to tell the two from each other; chosen
LEAST_ADVANTAGE = 10.0  # twice the log-likelihood by which a pair must surpass what one effect leads to; chosen
DRAWS = 200  # shuffled residuals in the null distribution of the best pair


@dataclass(frozen=True)
class Pair:
    """Two candidates and what they explain together.

    Parameters
    ----------
    rows : tuple of (ScanRow, ScanRow)
        Of the scan, with the strengths that the two have together.
    gain : float
        Twice the log-likelihood that both gain together, with the noise of the scan: LM/λ̄.
    alone : tuple of (float, float)
        The same of each by itself.
    """

    rows: tuple[ScanRow, ScanRow]
    gain: float
    alone: tuple[float, float]

    @property
    def names(self) -> tuple[str, str]:
        """``kind@where`` of both."""
        return self.rows[0].name, self.rows[1].name


@dataclass(frozen=True, kw_only=True)
class _JointScores:
    """One candidate i together with others of k columns each, for m residuals.

    Attributes
    ----------
    others : ndarray, shape (n,)
    gain : ndarray, shape (n, m)
    own, other : ndarray, shape (n, k_i, m) and (n, k, m)
        Amplitudes in the orthonormal columns.
    allowed : ndarray of bool, shape (n, m)
        Whether the signs of both make sense.
    """

    others: np.ndarray
    gain: Array
    own: Array
    other: Array
    allowed: np.ndarray


@dataclass(frozen=True)
class MaskingPairs:
    """Masking pairs whose best explains more than chance would.

    Parameters
    ----------
    pairs : tuple of Pair
        Those first that explain most.
    p_value : float
        Probability that chance gives any pair as much, in any of the scans.
    singly : Pair or None
        The effect that was found by itself, with its best partner.
    scores : PairScores
    """

    pairs: tuple[Pair, ...]
    p_value: float
    singly: Pair | None
    scores: PairScores


def find_masking_pairs(
    scans: Sequence[ScanResult],
    excluded: Callable[[ScanRow, ScanRow], bool],
    *,
    level: float,
    seed: int,
    singly: str = "",
) -> MaskingPairs | None:
    """Return the masking pairs of the first scan in which they are significant; None where they are in none.

    The best of them must explain more than the best effect alone, or than the effect found by itself with its best
    partner.  As with single effects, the plain scan sees what is slow and the whitened one what is small: each is
    tested at its share of the significance level.

    Parameters
    ----------
    scans : sequence of ScanResult
        Of the same residual.
    excluded : callable
        Says of two rows that they are not to be tried together.
    level : float
        Of all scans together.
    seed : int
        Of the shuffled residuals.
    singly : str
        The effect found by itself, as ``kind@where``; empty if there was none.
    """
    for scan in scans:
        if scan.null.pieces.too_few:  # too few to draw a null distribution
            continue
        scores = PairScores(scan, excluded)
        partners = scores.with_partners(singly)[:1] if any(r.name == singly for r in scan.rows) else []
        pairs = scores.masking()
        if not pairs or pairs[0].gain < (partners[0].gain if partners else scores.most_alone) + LEAST_ADVANTAGE:
            continue
        p_value = min(1.0, len(scans) * scores.p_value(pairs[0].gain, seed))
        if p_value < level:
            return MaskingPairs(tuple(pairs), p_value, partners[0] if partners else None, scores)
    return None


class PairScores:
    """Joint scores of the candidates of a scan, two by two, each at the shape that fits it best by itself.

    Parameters
    ----------
    scan : ScanResult
    excluded : callable
        Says of two rows that they are not to be tried together.
    """

    def __init__(self, scan: ScanResult, excluded: Callable[[ScanRow, ScanRow], bool] = lambda a, b: False) -> None:
        self.scan, self.rows = scan, scan.rows
        if scan.scorer is None or not scan.rows:
            self._s = self._alone = np.zeros((0, 1))
            return
        columns = scan.scorer.columns
        groups = [columns.groups[r.group] for r in self.rows]
        sizes = np.array([g.columns.stop - g.columns.start for g in groups])
        ends = np.cumsum(sizes)
        self._cols = [np.arange(end - size, end) for end, size in zip(ends, sizes, strict=True)]
        self._one_sided = np.array([g.one_sided for g in groups])
        self._R_inverse = [np.linalg.inv(columns.R[r.group]) for r in self.rows]
        self._Z = columns.Z.selected([g.columns for g in groups])
        self._gram = self._Z.gram()
        n = len(self.rows)
        tried = ~np.eye(n, dtype=bool)
        for i, j in zip(*np.tril_indices(n, -1), strict=True):
            tried[i, j] = tried[j, i] = not excluded(self.rows[i], self.rows[j])
        self._others = [[np.flatnonzero(tried[i] & (sizes == k)) for k in np.unique(sizes)] for i in range(n)]
        self._s = self._Z.transposed_times(scan.whitened_residual)[:, None]
        self._alone = self._own_gain(self._s)

    @property
    def most_alone(self) -> float:
        """Gain of the best candidate by itself."""
        return float(np.max(self._alone, initial=0.0)) / self.scan.typical_inflation

    def masking(self) -> list[Pair]:
        """Return the masking pairs, those first that explain most."""
        pairs = [p for i in range(len(self.rows)) for p in self._pairs(i, masking=True)]
        return sorted(pairs, key=lambda p: -p.gain)

    def with_partners(self, name: str) -> list[Pair]:
        """Return the pairs of one candidate with every other, those first that explain most."""
        k = next(i for i, r in enumerate(self.rows) if r.name == name)
        return sorted(self._pairs(k), key=lambda p: -p.gain)

    def twins(self, one: Pair, other: Pair) -> bool:
        """Tell whether two pairs do nearly the same, effect by effect."""

        def same(a: ScanRow, b: ScanRow) -> bool:
            of_a, of_b = (self._cols[next(k for k, r in enumerate(self.rows) if r.name == x.name)] for x in (a, b))
            if of_a.size != of_b.size:  # what has more strengths may contain the other
                return False
            bases = (self._Z[slice(int(of[0]), int(of[-1]) + 1)] for of in (of_a, of_b))
            return canonical_correlation(*bases) >= TWIN_CORRELATION

        (a, b), (c, d) = one.rows, other.rows
        return (same(a, c) and same(b, d)) or (same(a, d) and same(b, c))

    def p_value(self, gain: float, seed: int) -> float:
        """Return the probability that chance gives any masking pair a joint gain as large.

        From shuffled residuals, as for single candidates (`discrepancy.statistics.null_distribution`).
        """
        scan = self.scan
        pieces = cut_pieces(scan.projection.layout, scan.whitener.dt, scan.whitened_residual)
        rng = np.random.default_rng(seed)
        largest = []
        for residuals in shuffled_residuals(scan.whitened_residual, scan.projection, pieces, DRAWS, rng):
            S = self._Z.transposed_times(residuals)
            alone, best = self._own_gain(S), np.zeros(S.shape[1])
            for i in range(len(self.rows)):
                for joint in self._joint(i, S):
                    masking = joint.allowed & (joint.gain > MASKING_RATIO * (alone[i] + alone[joint.others]))
                    best = np.maximum(best, np.max(joint.gain, axis=0, initial=0.0, where=masking))
            largest.append(best)
        return float(tail_p(np.concatenate(largest) / scan.typical_inflation, np.array([gain]))[0])

    def _own_gain(self, S: Array) -> Array:
        return np.array([np.sum(S[c] ** 2, axis=0) for c in self._cols])

    def _pairs(self, i: int, masking: bool = False) -> Iterator[Pair]:
        """Yield the pairs of a candidate whose signs make sense; with ``masking`` the masking ones, each once."""
        inflation = self.scan.typical_inflation
        for joint in self._joint(i, self._s):
            kept = joint.allowed[:, 0]
            if masking:
                alone = self._alone[i, 0] + self._alone[joint.others, 0]
                kept = kept & (joint.gain[:, 0] > MASKING_RATIO * alone) & (joint.others < i)
            for n in np.flatnonzero(kept):
                j = joint.others[n]
                own = replace(self.rows[i], expected_strength=self._R_inverse[i] @ joint.own[n, :, 0])
                other = replace(self.rows[j], expected_strength=self._R_inverse[j] @ joint.other[n, :, 0])
                gains = (float(self._alone[i, 0]) / inflation, float(self._alone[j, 0]) / inflation)
                yield Pair((own, other), float(joint.gain[n, 0]) / inflation, gains)

    def _joint(self, i: int, S: Array) -> Iterator[_JointScores]:
        """Yield a candidate's joint scores with the others: theirs after its projection are added to its own."""
        mine = self._cols[i]
        along = self._gram[:, mine]
        own, rest = np.sum(S[mine] ** 2, axis=0), S - along @ S[mine]
        for others in self._others[i]:
            if not others.size:
                continue
            cols = np.stack([self._cols[j] for j in others])
            H = self._gram[cols[:, :, None], cols[:, None, :]] - along[cols] @ along[cols].swapaxes(1, 2)
            apart = np.linalg.eigvalsh(H)[:, 0] > APART
            others, cols, H = others[apart], cols[apart], H[apart]
            if not others.size:
                continue
            b = np.linalg.solve(H, rest[cols])
            a = S[mine] - along[cols].swapaxes(1, 2) @ b
            other_signs = np.stack([self._R_inverse[j] for j in others]) @ b
            allowed = np.all(other_signs >= 0.0, axis=1) | ~self._one_sided[others][:, None]
            if self._one_sided[i]:
                allowed &= np.all(self._R_inverse[i] @ a >= 0.0, axis=1)
            gain = own + np.sum(b * rest[cols], axis=1)
            yield _JointScores(others=others, gain=gain, own=a, other=b, allowed=allowed)
