"""Pairs of effects that hide each other: each alone changes next to nothing, both together much.

A reference that comes late and a loop that is stiffer than stated do nearly opposite things to the motion.  What is
left of the two is all that the records show, and along neither of them alone does it point.  So the gain of every pair
is worked out jointly, from the Gram matrix of the candidates' columns in a scan; see docs/method/score-scan.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.statistics.blocks import Array
from discrepancy.statistics.null import cut, shuffled, tail_p
from discrepancy.statistics.ties import canonical_correlation
from discrepancy.statistics.verdicts import Row

if TYPE_CHECKING:
    from discrepancy.statistics.scan_result import ScanResult

__all__ = ["HiddenPairs", "Pair", "PairScores", "hidden_pairs"]

MASK = 2.0  # times what two effects explain one by one that they explain together, if they hide each other; chosen
APART = 1e-3  # share of an effect's energy that another must leave of it, to tell the two from each other; chosen
TWINS = 0.999  # correlation from which a refit of a second pair would tell next to nothing; chosen
MORE = 10.0  # twice the log-likelihood by which a pair must surpass what one effect leads to; chosen
DRAWS = 200  # shuffled residuals that say what luck gives the best of all pairs


@dataclass(frozen=True)
class Pair:
    """Two candidates and what they explain together.

    Parameters
    ----------
    rows : tuple of (Row, Row)
        Of the scan, with the amplitudes that they have beside each other.
    gain : float
        Twice the log-likelihood that both gain together, with the noise of the scan: LM/λ̄.
    alone : tuple of (float, float)
        The same of each by itself.
    """

    rows: tuple[Row, Row]
    gain: float
    alone: tuple[float, float]

    @property
    def names(self) -> tuple[str, str]:
        """``kind@where`` of both."""
        return self.rows[0].name, self.rows[1].name



@dataclass(frozen=True)
class _Beside:
    """One candidate i beside others of k columns each, for m residuals.

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
class HiddenPairs:
    """Pairs that hide each other and explain more than luck does.

    Parameters
    ----------
    pairs : tuple of Pair
        Those first that explain most.
    p_value : float
        Chance that luck gives any pair as much, in any of the scans.
    singly : Pair or None
        The effect that was found by itself, beside the best partner that it has.
    scores : PairScores
    """

    pairs: tuple[Pair, ...]
    p_value: float
    singly: Pair | None
    scores: PairScores


def hidden_pairs(
    scans: Sequence[ScanResult],
    excluded: Callable[[Row, Row], bool],
    *,
    level: float,
    seed: int,
    singly: str = "",
) -> HiddenPairs | None:
    """Return the pairs that hide each other, of the first scan in which they surprise; None where they do in none.

    The best of them must explain more than the best effect alone, or than the effect that was found beside its best
    partner.  As with single effects, the plain scan sees what is slow and the whitened one what is small: each is asked
    at its share of the level.

    Parameters
    ----------
    scans : sequence of ScanResult
        Of the same residual.
    excluded : callable
        Says of two rows that they are not to be tried beside each other.
    level : float
        Of all scans together.
    seed : int
        Of the shuffled residuals.
    singly : str
        What was found by itself, as ``kind@where``; empty if nothing was.
    """
    for scan in scans:
        if scan.null.pieces.few:  # nothing shows what luck could do
            continue
        scores = PairScores(scan, excluded)
        beside = scores.beside(singly)[:1] if any(r.name == singly for r in scan.rows) else []
        pairs = scores.masking()
        if not pairs or pairs[0].gain < (beside[0].gain if beside else scores.most_alone) + MORE:
            continue
        p_value = min(1.0, len(scans) * scores.p_value(pairs[0].gain, seed))
        if p_value < level:
            return HiddenPairs(tuple(pairs), p_value, beside[0] if beside else None, scores)
    return None


class PairScores:
    """Joint scores of the candidates of a scan, two by two, each at the shape that fits it best by itself.

    Parameters
    ----------
    scan : ScanResult
    excluded : callable
        Says of two rows that they are not to be tried beside each other.
    """

    def __init__(self, scan: ScanResult, excluded: Callable[[Row, Row], bool] = lambda a, b: False) -> None:
        self.scan, self.rows = scan, scan.rows
        if scan.scorer is None or not scan.rows:
            self._s = self._alone = np.zeros((0, 1))
            return
        columns = scan.scorer.columns
        groups = [columns.groups[r.group] for r in self.rows]
        ends = np.cumsum([g.cols.stop - g.cols.start for g in groups])
        self._cols = [np.arange(end - g.cols.stop + g.cols.start, end) for g, end in zip(groups, ends, strict=True)]
        self._one_sided = np.array([g.one_sided for g in groups])
        self._R_inverse = [np.linalg.inv(columns.R[r.group]) for r in self.rows]
        self._Z = np.concatenate([columns.Z[:, g.cols] for g in groups], axis=1)
        self._gram = self._Z.T @ self._Z
        n, sizes = len(self.rows), np.array([c.size for c in self._cols])
        tried = ~np.eye(n, dtype=bool)
        for i, j in zip(*np.tril_indices(n, -1), strict=True):
            tried[i, j] = tried[j, i] = not excluded(self.rows[i], self.rows[j])
        self._others = [[np.flatnonzero(tried[i] & (sizes == k)) for k in np.unique(sizes)] for i in range(n)]
        self._s = (self._Z.T @ scan.residual)[:, None]
        self._alone = self._own_gain(self._s)

    @property
    def most_alone(self) -> float:
        """Gain of the best candidate by itself."""
        return float(np.max(self._alone, initial=0.0)) / self.scan.lam_bar

    def masking(self) -> list[Pair]:
        """Return the pairs that hide each other, those first that explain most."""
        found = [p for i in range(len(self.rows)) for p in self._pairs(i, masking=True)]
        return sorted(found, key=lambda p: -p.gain)

    def beside(self, name: str) -> list[Pair]:
        """Return the pairs of one candidate with every other, those first that explain most."""
        k = next(i for i, r in enumerate(self.rows) if r.name == name)
        return sorted(self._pairs(k), key=lambda p: -p.gain)

    def alike(self, one: Pair, other: Pair) -> bool:
        """Tell whether two pairs all but do the same, effect by effect."""

        def same(a: Row, b: Row) -> bool:
            mine, its = (self._cols[next(k for k, r in enumerate(self.rows) if r.name == x.name)] for x in (a, b))
            if mine.size != its.size:  # what has more strengths may contain the other
                return False
            return canonical_correlation(self._Z[:, mine], self._Z[:, its]) >= TWINS

        (a, b), (c, d) = one.rows, other.rows
        return (same(a, c) and same(b, d)) or (same(a, d) and same(b, c))

    def p_value(self, gain: float, seed: int) -> float:
        """Return the chance that luck gives any two candidates that hide each other a joint gain as large.

        By the residual in pieces that are put in other places, as for single candidates
        (`discrepancy.statistics.null`).
        """
        scan = self.scan
        pieces = cut(scan.projection.layout, scan.whitener.dt, scan.residual)
        most = []
        for residuals in shuffled(scan.residual, scan.projection, pieces, DRAWS, np.random.default_rng(seed)):
            S = self._Z.T @ residuals
            alone, best = self._own_gain(S), np.zeros(S.shape[1])
            for i in range(len(self.rows)):
                for found in self._joint(i, S):
                    masked = found.allowed & (found.gain > MASK * (alone[i] + alone[found.others]))
                    best = np.maximum(best, np.max(found.gain, axis=0, initial=0.0, where=masked))
            most.append(best)
        return float(tail_p(np.concatenate(most) / scan.lam_bar, np.array([gain]))[0])

    def _own_gain(self, S: Array) -> Array:
        return np.array([np.sum(S[c] ** 2, axis=0) for c in self._cols])

    def _pairs(self, i: int, masking: bool = False) -> Iterator[Pair]:
        """Yield the pairs of a candidate whose signs make sense; on request those that hide each other, each once."""
        lam = self.scan.lam_bar
        for found in self._joint(i, self._s):
            kept = found.allowed[:, 0]
            if masking:
                alone = self._alone[i, 0] + self._alone[found.others, 0]
                kept = kept & (found.gain[:, 0] > MASK * alone) & (found.others < i)
            for n in np.flatnonzero(kept):
                j = found.others[n]
                own = replace(self.rows[i], amplitude=self._R_inverse[i] @ found.own[n, :, 0])
                other = replace(self.rows[j], amplitude=self._R_inverse[j] @ found.other[n, :, 0])
                each = (float(self._alone[i, 0]) / lam, float(self._alone[j, 0]) / lam)
                yield Pair((own, other), float(found.gain[n, 0]) / lam, each)

    def _joint(self, i: int, S: Array) -> Iterator[_Beside]:
        """Yield a candidate beside the others: what they gain once it is projected away comes on top of its own."""
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
            yield _Beside(others, own + np.sum(b * rest[cols], axis=1), a, b, allowed)
