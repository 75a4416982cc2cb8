"""What a scan returns: one row per candidate, ties, refusals, and the sentence that sums them up."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.statistics.blocks import Array
from discrepancy.statistics.null import Null
from discrepancy.statistics.projection import Projection
from discrepancy.statistics.score import Scorer
from discrepancy.statistics.ties import Ties, find_ties
from discrepancy.statistics.verdicts import Row, Verdict, summary
from discrepancy.statistics.whitening import Whitener

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class ScanResult:
    """What the scan found.

    Attributes
    ----------
    rows : tuple of Row
        One per candidate that could be scored, best first.
    refused : dict
        Candidate → why it cannot be scored.
    best : Row or None
        The effect to add next: the significant one with the largest penalised gain.
    ties : Ties or None
        What else the best could be.
    level : float
        Family-wise level of the claims.
    n_eff : float
        Effective number of observations, N/λ̄.
    lam_bar : float
        Typical inflation λ̄.
    too_few : str
        Warning when the records are too short for the level asked, else empty.
    removed : tuple of str
        Effects whose fit was removed before the noise was measured.
    not_excited : tuple of str
        Uncertain parameters with zero sensitivity.
    """

    rows: tuple[Row, ...]
    refused: dict[str, str]
    best: Row | None
    ties: Ties | None
    level: float
    n_eff: float
    lam_bar: float
    too_few: str
    removed: tuple[str, ...]
    not_excited: tuple[str, ...]
    null: Null = field(repr=False)
    whitener: Whitener = field(repr=False)
    projection: Projection = field(repr=False)
    residual: Array = field(repr=False)
    scorer: Scorer | None = field(repr=False)

    @property
    def verdict(self) -> str:
        """The scan in one sentence."""
        return summary(self.rows, self.refused, self.too_few)

    @property
    def nothing_missing(self) -> bool:
        """True only if nothing is significant and every effect that matters would have been seen."""
        quiet = all(r.verdict in (Verdict.ABSENT, Verdict.NEGLIGIBLE) for r in self.rows)
        return quiet and not self.refused and all(r.mde < r.delta for r in self.rows)

    def __getitem__(self, name: str) -> Row:
        for r in self.rows:
            if r.name == name or r.kind == name:
                return r
        if name in self.refused:
            raise KeyError(f"{name} was refused: {self.refused[name]}")
        raise KeyError(f"{name} is not among the candidates: {', '.join(r.name for r in self.rows)}")

    def ties_of(self, name: str) -> Ties | None:
        """Return what else a candidate of this scan could be; None where it could not be scored.

        Each candidate is taken at the shape that fits it best.
        """
        names = [r.name for r in self.rows]
        if self.scorer is None or name not in names:
            return None
        columns = self.scorer.columns
        return find_ties(
            names.index(name),
            [(r.kind, r.where) for r in self.rows],
            [-0.5 * r.delta_bic for r in self.rows],
            [columns.Z[:, columns.groups[r.group].cols] for r in self.rows],
            [r.p < self.level for r in self.rows],
        )

    def to_frame(self) -> pd.DataFrame:
        """Table with one row per candidate."""
        import pandas as pd

        cols = (
            "kind",
            "where",
            "lm",
            "lam",
            "p",
            "gain",
            "delta_bic",
            "amplitude",
            "std",
            "unit",
            "kappa",
            "mde",
            "delta",
            "error_drop",
            "held_out_gain",
            "verdict",
            "reason",
            "shape",
        )
        data = []
        for r in self.rows:
            d = {c: getattr(r, c) for c in cols}
            for c in ("amplitude", "std"):
                d[c] = float(d[c][0]) if len(d[c]) == 1 else tuple(float(v) for v in d[c])
            d["verdict"] = str(r.verdict)
            data.append(d)
        for n, why in self.refused.items():
            kind, _, where = n.partition("@")
            data.append({"kind": kind, "where": where, "verdict": str(Verdict.REFUSED), "reason": why})
        return pd.DataFrame(data, columns=list(cols))

    def __repr__(self) -> str:
        head = f"ScanResult: {self.verdict}\n"
        lines = [
            f"  {'candidate':38s} {'LM/λ':>9s} {'p':>8s} {'amplitude':>11s} {'±':>9s} {'MDE':>9s}  verdict"
        ]
        for r in self.rows[:12]:
            lines.append(
                f"  {r.name:38s} {r.lm / r.lam:9.1f} {r.p:8.2g} {np.linalg.norm(r.amplitude):11.4g} "
                f"{np.linalg.norm(r.std):9.2g} {r.mde:9.3g}  {r.verdict}"
            )
        if len(self.rows) > 12:
            lines.append(f"  … {len(self.rows) - 12} more")
        return head + "\n".join(lines)
