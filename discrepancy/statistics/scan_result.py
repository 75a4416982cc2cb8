"""What a scan returns: one row per candidate, ties, refusals, and the sentence that sums them up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.statistics.blocks import Array
from discrepancy.statistics.null_distribution import NullDistribution
from discrepancy.statistics.projection import Projection
from discrepancy.statistics.score import Scorer
from discrepancy.statistics.thresholds import DECISIVE_LOG_LIKELIHOOD
from discrepancy.statistics.ties import Ties, find_ties
from discrepancy.statistics.verdicts import Verdict
from discrepancy.statistics.whitening import Whitener

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["ScanResult", "ScanRow"]


@dataclass(frozen=True, kw_only=True)
class ScanRow:
    """One candidate of a scan: its score, its expected strength, what would have been seen, and the verdict.

    Attributes
    ----------
    kind, where : str
        Of the effect.
    shape : dict
        Shape parameters of the grid point that fits best.
    group : int
        Of the scorer, for that shape.

    score : float
        Score statistic (modification index) LM = sᵀH⁻¹s, in units of the whitened noise variance.
    inflation : float
        λ, by which the colour of the residual multiplies its variance.
    degrees_of_freedom : float
        With which λ is known where the candidate acts.
    p_value, p_value_alone : float
        Family-wise p (of the largest score of all candidates), and the candidate's own, its shape grid included.
    critical_ratio : float
        √(LM/λ) at which the candidate would be declared, in standard errors.

    expected_strength, standard_error : ndarray, shape (k,)
        Strength that a fit is expected to give after recalibration, and its standard error, in ``unit``.
    unit : str
    confounding : float
        κ, the share of the effect that calibration can absorb.
    imitated_by : dict
        Parameter → change that calibration had made to imitate the effect.

    log_likelihood_gain : float
        Expected gain LM/(2·λ̄), with one λ̄ for all candidates, so that gains can be compared.
    delta_bic : float
        Expected change of BIC with the effective number of samples; negative favours the effect.
    error_reduction : float
        Expected relative drop of the whitened residual's energy.
    held_out_gain : float
        Gain of log-likelihood expected for a block from the strength of the others, summed over blocks.

    smallest_visible_strength : float
        Smallest strength that this scan would have declared with a probability of 80 %, at the shape that fits best;
        where the verdict there is "absent", at the shape of the grid at which what matters shows least.
    strength_that_matters : float
        At the same shape.

    verdict : Verdict
    reason : str
        Why the verdict is what it is.
    """

    kind: str
    where: str
    shape: Mapping[str, float]
    group: int

    score: float
    inflation: float
    degrees_of_freedom: float
    p_value: float
    p_value_alone: float
    critical_ratio: float

    expected_strength: Array
    standard_error: Array
    unit: str
    confounding: float
    imitated_by: Mapping[str, float]

    log_likelihood_gain: float
    delta_bic: float
    error_reduction: float
    held_out_gain: float

    smallest_visible_strength: float
    strength_that_matters: float

    verdict: Verdict
    reason: str

    @property
    def name(self) -> str:
        """``kind@where``."""
        return f"{self.kind}@{self.where}"

    @property
    def would_be_seen(self) -> bool:
        """True if a strength that matters would have been declared."""
        return self.smallest_visible_strength < self.strength_that_matters

    @property
    def carries_over(self) -> bool:
        """True if the strength found on all blocks but one says something of that one.

        A candidate with many strengths can follow a residual that one or two of a few blocks carry.
        """
        return self.held_out_gain > DECISIVE_LOG_LIKELIHOOD


@dataclass(frozen=True, kw_only=True)
class ScanResult:
    """What a scan found.

    Attributes
    ----------
    rows : tuple of ScanRow
        One per candidate that could be scored, best first.
    refused : dict
        Candidate → why it cannot be scored.
    best : ScanRow or None
        The effect to add next: the significant one with the largest penalised gain.
    ties : Ties or None
        What else the best could be.

    level : float
        Family-wise level of the claims.
    effective_samples : float
        Effective number of samples, N/λ̄.
    typical_inflation : float
        λ̄, the median of λ over all candidates.
    warning : str
        Says where the records are too short for the level; else empty.
    removed_effects : tuple of str
        Effects whose fit was removed before the noise was measured.
    not_excited : tuple of str
        Uncertain parameters with zero sensitivity.

    visible_scatter : float
        Share by which the smallest visible strengths change with the seed of the null distribution, up or down, in nine
        of ten scans; the median over the candidates.
    null, whitener, projection, scorer
        With which the candidates were scored; no scorer where there was nothing to score.
    whitened_residual : ndarray, shape (n_rows,)
        Whitened and projected.
    """

    rows: tuple[ScanRow, ...]
    refused: Mapping[str, str]
    best: ScanRow | None
    ties: Ties | None

    level: float
    effective_samples: float
    typical_inflation: float
    warning: str
    removed_effects: tuple[str, ...]
    not_excited: tuple[str, ...]

    null: NullDistribution = field(repr=False)
    whitener: Whitener = field(repr=False)
    projection: Projection = field(repr=False)
    scorer: Scorer | None = field(repr=False)
    whitened_residual: Array = field(repr=False)
    visible_scatter: float = 0.0

    @property
    def verdict(self) -> str:
        """The scan in one sentence."""
        return _sentence(self.rows, self.refused, self.warning)

    @property
    def nothing_missing(self) -> bool:
        """True only if nothing is significant and every effect that matters would have been seen."""
        quiet = all(r.verdict in (Verdict.ABSENT, Verdict.NEGLIGIBLE) for r in self.rows)
        return quiet and not self.refused and all(r.would_be_seen for r in self.rows)

    def __getitem__(self, name: str) -> ScanRow:
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
            lambda k: columns.Z[columns.groups[self.rows[k].group].columns],
            [r.p_value < self.level for r in self.rows],
        )

    def to_frame(self) -> pd.DataFrame:
        """Return a table with one row per candidate; refused ones last, with their reason."""
        import pandas as pd

        fields = [name for name in ScanRow.__dataclass_fields__ if name not in ("group", "imitated_by")]
        data = []
        for r in self.rows:
            row = {name: getattr(r, name) for name in fields}
            for name in ("expected_strength", "standard_error"):
                row[name] = float(row[name][0]) if len(row[name]) == 1 else tuple(float(v) for v in row[name])
            row["verdict"] = str(r.verdict)
            data.append(row)
        for name, why in self.refused.items():
            kind, _, where = name.partition("@")
            data.append({"kind": kind, "where": where, "verdict": str(Verdict.REFUSED), "reason": why})
        return pd.DataFrame(data, columns=fields)

    def __repr__(self) -> str:
        head = f"ScanResult: {self.verdict}\n"
        lines = [f"  {'candidate':38s} {'LM/λ':>9s} {'p':>8s} {'strength':>11s} {'±':>9s} {'visible':>9s}  verdict"]
        for r in self.rows[:12]:
            lines.append(
                f"  {r.name:38s} {r.score / r.inflation:9.1f} {r.p_value:8.2g} "
                f"{np.linalg.norm(r.expected_strength):11.4g} {np.linalg.norm(r.standard_error):9.2g} "
                f"{r.smallest_visible_strength:9.3g}  {r.verdict}"
            )
        if len(self.rows) > 12:
            lines.append(f"  … {len(self.rows) - 12} more")
        return head + "\n".join(lines)


def _sentence(rows: Sequence[ScanRow], refused: Mapping[str, str], warning: str) -> str:
    """Return one sentence about all candidates.

    "Nothing is missing" is said only when every effect that matters would have been seen.
    """
    missing = [r.name for r in rows if r.verdict is Verdict.MISSING]
    if missing:
        others = f" (also significant: {', '.join(missing[1:])})" if missing[1:] else ""
        return f"missing: {missing[0]}{others}"
    hidden = [r for r in rows if not r.would_be_seen]
    unseen = [f"{r.name} up to {r.smallest_visible_strength:.3g} {r.unit}".rstrip() for r in hidden]
    unseen += [f"{name} (refused)" for name in refused]
    text = "nothing is missing" if not unseen else f"nothing found; these would not be seen: {', '.join(unseen)}"
    return text + (f". {warning}" if warning else "")
