"""Which candidates the records cannot tell apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.statistics.blocks import Array

GAIN_TIE = 3.0
CORRELATION_TIE = 0.95
EXACT = 1.0 - 1e-8


@dataclass(frozen=True)
class Rival:
    """A candidate that explains the residual nearly as well as the best one.

    Attributes
    ----------
    name, kind, where : str
    gain_deficit : float
        How much less calibrated log-likelihood it gains than the best.
    correlation : float
        Smallest canonical correlation of the two candidates' calibrated effects.
    why : str
        "exact" (same columns up to scale), "correlated", or "close gain".
    """

    name: str
    kind: str
    where: str
    gain_deficit: float
    correlation: float
    why: str


@dataclass(frozen=True)
class Ties:
    """Rivals of one candidate, grouped by whether the *kind* or only the *place* is in doubt."""

    best: str
    same_kind: tuple[Rival, ...]
    other_kind: tuple[Rival, ...]

    @property
    def ambiguous(self) -> bool:
        """True if another kind of effect cannot be ruled out."""
        return bool(self.other_kind)

    @property
    def names(self) -> tuple[str, ...]:
        """All names in the tie, the best first."""
        return (self.best, *(r.name for r in (*self.same_kind, *self.other_kind)))


def canonical_correlation(Qa: Array, Qb: Array) -> float:
    """Smallest canonical correlation of two orthonormal bases: 1 only if one span lies in the other."""
    s = np.linalg.svd(Qa.T @ Qb, compute_uv=False)
    return float(min(1.0, s[-1]))


def find_ties(
    best: int,
    names: Sequence[tuple[str, str]],
    gains: Sequence[float],
    bases: Sequence[Array | None],
    eligible: Sequence[bool],
) -> Ties:
    """Rivals of candidate ``best``.

    Parameters
    ----------
    names : sequence of (kind, where)
    gains : sequence of float
        Calibrated log-likelihood gains, penalised for the number of free numbers.
    bases : sequence of ndarray or None
        Orthonormal projected columns of each candidate at its best shape.
    eligible : sequence of bool
        Candidates that are significant on their own; others rival only if they are exactly collinear.
    """
    same: list[Rival] = []
    other: list[Rival] = []
    ref = bases[best]
    kind0, where0 = names[best]
    for i, (kind, where) in enumerate(names):
        base = bases[i]
        if i == best or base is None or ref is None:
            continue
        rho = canonical_correlation(ref, base)
        deficit = gains[best] - gains[i]
        if rho >= EXACT:
            why = "exact"
        elif not eligible[i]:
            continue
        elif deficit < GAIN_TIE:
            why = "close gain"
        elif rho > CORRELATION_TIE and deficit < 2 * GAIN_TIE:
            why = "correlated"
        else:
            continue
        rival = Rival(f"{kind}@{where}", kind, where, float(deficit), rho, why)
        (same if kind == kind0 else other).append(rival)
    key = lambda r: r.gain_deficit  # noqa: E731
    return Ties(f"{kind0}@{where0}", tuple(sorted(same, key=key)), tuple(sorted(other, key=key)))
