"""Which candidates the records cannot tell apart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.statistics.blocks import Array
from discrepancy.statistics.thresholds import DECISIVE_LOG_LIKELIHOOD

TIE_CORRELATION = 0.95  # correlation from which twice the decisive gain still leaves a tie; chosen
EXACT = 1.0 - 1e-8


@dataclass(frozen=True, kw_only=True)
class Tie:
    """A candidate that explains the residual nearly as well as the best one.

    Attributes
    ----------
    kind, where : str
    gain_deficit : float
        How much less calibrated log-likelihood it gains than the best.
    correlation : float
        Smallest canonical correlation of the two candidates' calibrated effects.
    why : str
        "exact" (same sensitivities up to scale), "correlated", or "close gain".
    """

    kind: str
    where: str
    gain_deficit: float
    correlation: float
    why: str

    @property
    def name(self) -> str:
        """``kind@where``."""
        return f"{self.kind}@{self.where}"


@dataclass(frozen=True)
class Ties:
    """Ties of one candidate, grouped by whether the *kind* or only the *place* is in doubt."""

    best: str
    same_kind: tuple[Tie, ...]
    other_kind: tuple[Tie, ...]

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
    basis: Callable[[int], Array | None],
    eligible: Sequence[bool],
) -> Ties:
    """Return the ties of candidate ``best``.

    Parameters
    ----------
    names : sequence of (kind, where)
    gains : sequence of float
        Calibrated log-likelihood gains, penalised for the number of free numbers.
    basis : callable
        Returns the orthonormal projected sensitivities of a candidate at its best shape, or None.
    eligible : sequence of bool
        Candidates that are significant on their own; others tie only if they are exactly collinear.
    """
    same: list[Tie] = []
    other: list[Tie] = []
    ref = basis(best)
    kind0, where0 = names[best]
    for i, (kind, where) in enumerate(names):
        if i == best or ref is None:
            continue
        base = basis(i)
        if base is None:
            continue
        rho = canonical_correlation(ref, base)
        deficit = gains[best] - gains[i]
        if rho >= EXACT:
            why = "exact"
        elif not eligible[i]:
            continue
        elif deficit < DECISIVE_LOG_LIKELIHOOD:
            why = "close gain"
        elif rho > TIE_CORRELATION and deficit < 2 * DECISIVE_LOG_LIKELIHOOD:
            why = "correlated"
        else:
            continue
        tie = Tie(kind=kind, where=where, gain_deficit=float(deficit), correlation=rho, why=why)
        (same if kind == kind0 else other).append(tie)
    same.sort(key=lambda t: t.gain_deficit)
    other.sort(key=lambda t: t.gain_deficit)
    return Ties(f"{kind0}@{where0}", tuple(same), tuple(other))
