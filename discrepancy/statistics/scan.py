"""The score scan: which missing effect would explain the residual, and how sure that is.

`scan` is the one door. See docs/method/score-scan.md for the method in plain words and in equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from discrepancy.statistics.blocks import Array, Candidate, Residual, Sensitivities, check_compatible
from discrepancy.statistics.null_distribution import NullDistribution, cut_pieces, null_distribution
from discrepancy.statistics.projection import Layout
from discrepancy.statistics.scan_result import ScanResult, ScanRow
from discrepancy.statistics.score import CandidateColumns, Scorer, Scores
from discrepancy.statistics.verdicts import Verdict, decide
from discrepancy.statistics.whitened import (
    CleanedResidual,
    WhitenedProblem,
    best_groups,
    fit_whitened,
    largest_neg_log_p,
    raw_residual,
    remove_effects,
    scaled_by_rms,
    share_removed,
    with_local_noise,
)

__all__ = ["held_out_gain", "scan", "score_candidates", "smallest_visible"]

#: Effects at most that are removed before the noise is measured, and the level at which they must stand out.
MOST_REMOVED = 4
REMOVAL_LEVEL = 0.01
#: Strengths up to which an effect that stands out is removed without shuffling: laws have at most four, curves 17.
FEW_STRENGTHS = 4
#: At the textbook strength 58 % were detected instead of 80 %, at 1.2 times it 79 % (156 of 198): λ and the shape are
#: estimated, which the formula takes as known.
VISIBLE_MARGIN = 1.2
#: Quantile of the standard normal distribution: a probability of 80 % to be seen.
POWER_QUANTILE = 0.8416212335729143


def scan(
    residual: Residual,
    sensitivities: Sensitivities,
    candidates: Sequence[Candidate],
    *,
    level: float = 0.02,
    draws: int = 400,
    seed: int | np.random.Generator = 0,
    max_order: int = 24,
    whiten: bool = True,
    noise_floor: Sequence[float] | None = None,
    rounds: int = 2,
    clean: int = 2,
    plain: WhitenedProblem | None = None,
    few: Sequence[Candidate] | None = None,
) -> ScanResult:
    """Score every candidate effect on a residual, with p-values from the null distribution.

    Parameters
    ----------
    residual : Residual
        Measured minus modelled outputs.
    sensitivities : Sensitivities
        What calibration may move: parameters with priors, nuisances of single blocks.
    candidates : sequence of Candidate
        Effects that might be missing.
    level : float
        Family-wise level: chance of naming anything when nothing is missing.
    draws : int
        Shuffled residuals in the null.
    seed : int or Generator
    max_order : int
        Largest number of whitening coefficients per channel.
    whiten : bool
        False: every channel is weighted by its root mean square alone, and its colour is left as it is.
    noise_floor : sequence of float, optional
        Standard deviation of each channel's noise, for the strength that matters; default from the residual.
    rounds : int
        How often the whitening is refitted after removing calibration and the best candidates.
    clean : int
        How many of the best candidates are removed before the whitening is fitted.
    plain : WhitenedProblem, optional
        What `discrepancy.statistics.whitened.scaled_by_rms` gives for the same arrays, if it was computed before.
    few : sequence of Candidate, optional
        Those among which ``clean`` takes the best, if not all: for instance not those with many strengths.

    Returns
    -------
    ScanResult

    Raises
    ------
    ValueError
        If arrays do not fit together, or level and draws are out of range.
    """
    check_compatible(residual, sensitivities, candidates)
    if not 0 < level < 0.5:
        raise ValueError(f"level must lie between 0 and 0.5, got {level}")
    if draws < 50:
        raise ValueError(f"draws must be at least 50, got {draws}")
    rng = np.random.default_rng(seed)
    if whiten:
        w = fit_whitened(residual, sensitivities, candidates, max_order, rounds, clean, plain, few)
    else:
        w = plain or scaled_by_rms(residual, sensitivities, candidates)
    return score_candidates(w, residual, sensitivities, candidates, level, draws, rng, noise_floor)


def score_candidates(
    w: WhitenedProblem,
    residual: Residual,
    sens: Sensitivities,
    candidates: Sequence[Candidate],
    level: float,
    draws: int,
    rng: np.random.Generator,
    noise_floor: Sequence[float] | None,
) -> ScanResult:
    """Score candidates that are whitened and projected already; the rest is as in `scan`."""
    n_data = w.projection.layout.n_data
    common: dict[str, Any] = {
        "level": level,
        "refused": _refused(candidates, w.columns),
        "not_excited": w.projection.not_excited,
        "whitener": w.whitener,
        "projection": w.projection,
        "whitened_residual": w.e,
    }
    if w.scorer is None:
        pieces = cut_pieces(w.projection.layout, residual.dt, w.e)
        return ScanResult(
            rows=(),
            best=None,
            ties=None,
            effective_samples=float(n_data),
            typical_inflation=1.0,
            warning="",
            removed_effects=(),
            null=NullDistribution(np.zeros((0, draws)), np.zeros(0), pieces),
            scorer=None,
            **common,
        )
    scorer = w.scorer
    cleaned, null = _clean_and_shuffle(w, residual.dt, draws, rng, len(candidates))
    share = share_removed(scorer, cleaned.basis)
    s = scorer(w.e[:, None], cleaned.e[:, None], share) if cleaned.groups else scorer(w.e[:, None])
    s = with_local_noise(s, scorer, cleaned.e)
    best = best_groups(scorer, s)
    typical = float(np.median(s.inflation[:, 0]))
    floor = np.zeros(len(residual.channels)) if noise_floor is None else np.asarray(noise_floor, dtype=float)
    if not np.all(floor > 0.0):  # a noise that is not known is at most what is left
        left = np.std(np.concatenate(raw_residual(w, residual, sens, candidates, cleaned.groups)), axis=0)
        floor = np.where(floor > 0.0, floor, left)
    largest = np.zeros(len(candidates))
    largest[list(best)] = [largest_neg_log_p(scorer, s, c) for c in best]
    judged = _Judged(
        w=w,
        scores=s,
        null=null,
        level=level,
        typical_inflation=typical,
        effective_samples=n_data / typical,
        neg_log_p=largest,
        p_values=null.p_value(largest),
        critical=null.critical_values(level),
        critical_interval=null.critical_interval(level),
        floor=floor,
        residual=residual,
        parameters=sens.names,
    )
    grids: dict[int, list[int]] = {c: [] for c in best}
    for g, group in enumerate(scorer.columns.groups):
        grids[group.candidate].append(g)
    rows = [judged.row(candidates[c], g, grids[c]) for c, g in best.items()]
    rows.sort(key=lambda r: (-(r.p_value < level), r.delta_bic))
    top = next((r for r in rows if r.verdict is Verdict.MISSING), None)
    pieces = null.pieces
    warning = ""
    if pieces.too_few:
        warning = (
            f"only {len(pieces.spans)} independent pieces of residual (correlation time "
            f"{pieces.correlation_time:.2g} s in {residual.duration:.3g} s): record longer or more often"
        )
    result = ScanResult(
        rows=tuple(rows),
        best=top,
        ties=None,
        effective_samples=judged.effective_samples,
        typical_inflation=typical,
        warning=warning,
        removed_effects=tuple(candidates[scorer.columns.groups[i].candidate].name for i in cleaned.groups),
        null=null,
        scorer=scorer,
        visible_scatter=judged.scatter(list(best.values())),
        **common,
    )
    return result if top is None else replace(result, ties=result.ties_of(top.name))


def _clean_and_shuffle(
    w: WhitenedProblem, dt: float, draws: int, rng: np.random.Generator, n_candidates: int
) -> tuple[CleanedResidual, NullDistribution]:
    """Return the residual without the effects that stand out, and the null distribution of that residual.

    An effect of few strengths stands out where its F tail probability is too small for chance.  One of many strengths,
    such as a free curve, also fits what is slow in the noise; were it removed, the noise would seem lower than it is.
    It stands out where its score exceeds what shuffling gives with the residual as it is.
    """
    scorer = w.scorer
    assert scorer is not None

    def null_of(e: Array) -> NullDistribution:
        pieces = cut_pieces(w.projection.layout, dt, e)
        return null_distribution(
            scorer, w.projection, e, draws=draws, rng=rng, n_candidates=n_candidates, pieces=pieces
        )

    least = np.full(len(scorer.columns.groups), -np.log(REMOVAL_LEVEL / len(scorer.columns.groups)))
    cleaned = remove_effects(w, MOST_REMOVED, least)
    if not cleaned.groups or np.all(scorer.kdim[list(cleaned.groups)] <= FEW_STRENGTHS):
        return cleaned, null_of(cleaned.e)
    uncleaned = null_of(w.e)
    many = scorer.kdim > FEW_STRENGTHS
    own = uncleaned.critical_values(REMOVAL_LEVEL)[[g.candidate for g in scorer.columns.groups]]
    least[many] = np.maximum(least, own)[many]
    cleaned = remove_effects(w, MOST_REMOVED, least)
    return cleaned, null_of(cleaned.e) if cleaned.groups else uncleaned


def _refused(candidates: Sequence[Candidate], columns: CandidateColumns) -> dict[str, str]:
    """Return the candidates of which no point of the shape grid can be scored, with the reason."""
    scored = {g.candidate for g in columns.groups}
    out = {}
    for i, c in enumerate(candidates):
        if i not in scored:
            out[c.name] = next(why for (cand, _), why in columns.dropped.items() if cand == i)
    return out


@dataclass(frozen=True, kw_only=True)
class _Judged:
    """Scores and null distribution of a scan, from which the row of every candidate follows.

    Attributes
    ----------
    neg_log_p, p_values, critical : ndarray, shape (n_candidates,)
        Largest −ln p of each candidate, its family-wise p, and the −ln p at which it would be declared.
    critical_interval : tuple of ndarray
        Between which ``critical`` lies with nine of ten seeds of the null distribution.
    floor : ndarray, shape (n_channels,)
        Noise floor of each channel.
    parameters : tuple of str
        Uncertain parameters.
    """

    w: WhitenedProblem
    scores: Scores
    null: NullDistribution
    level: float
    typical_inflation: float
    effective_samples: float
    neg_log_p: Array
    p_values: Array
    critical: Array
    critical_interval: tuple[Array, Array]
    floor: Array
    residual: Residual
    parameters: tuple[str, ...]

    def row(self, c: Candidate, g: int, grid: Sequence[int]) -> ScanRow:
        """Return the row of a candidate, given its best group and all groups of its shape grid."""
        scorer, w = self._scorer, self.w
        group = scorer.columns.groups[g]
        score, inflation = float(self.scores.score[g, 0]), float(self.scores.inflation[g, 0])
        strength, cov = scorer.strength(g, self.scores.amplitude[group.columns, 0])
        dof = float(scorer.dof[g])
        p = float(self.p_values[group.candidate])
        alone = self.null.neg_log_p[group.candidate]
        p_alone = (1.0 + float(np.sum(alone >= self.neg_log_p[group.candidate]))) / (alone.size + 1.0)
        size, few = float(np.max(np.abs(strength))), self.null.pieces.too_few
        verdict_for = partial(decide, p=p, level=self.level, strength=size, dof=dof, few=few)
        visible, matters = self._visible(c, g)
        verdict, reason = verdict_for(visible=visible, matters=matters)
        if verdict is Verdict.ABSENT and len(grid) > 1:  # absent is what would have been seen whatever its shape
            visible, matters = self._least_visible(c, grid)
            verdict, reason = verdict_for(visible=visible, matters=matters)
        free = c.n_strengths + c.n_free_shapes
        imitated = -scorer.columns.imitation[g] @ strength
        return ScanRow(
            kind=c.kind,
            where=c.where,
            shape=dict(c.shapes[group.shape]),
            group=g,
            score=score,
            inflation=inflation,
            degrees_of_freedom=dof,
            p_value=p,
            p_value_alone=p_alone,
            critical_ratio=self._critical_ratio(g),
            expected_strength=strength,
            standard_error=np.sqrt(np.diag(cov) * inflation),
            unit=c.unit,
            confounding=w.columns.confounding[(group.candidate, group.shape)],
            imitated_by=dict(zip(self.parameters, imitated.tolist(), strict=True)),
            log_likelihood_gain=score / (2 * self.typical_inflation),
            delta_bic=-score / self.typical_inflation + free * float(np.log(self.effective_samples)),
            error_reduction=score / float(w.e @ w.e),
            held_out_gain=held_out_gain(w.columns.Z[group.columns], w.e, w.projection.layout, inflation),
            smallest_visible_strength=visible,
            strength_that_matters=matters,
            verdict=verdict,
            reason=reason,
        )

    @property
    def _scorer(self) -> Scorer:
        assert self.w.scorer is not None
        return self.w.scorer

    def scatter(self, groups: Sequence[int]) -> float:
        """Return by which share the smallest visible strengths of some groups change with the seed; the median."""
        shares = []
        for g in groups:
            low, critical, high = (
                self._critical_ratio(g, at) for at in (self.critical_interval[0], None, self.critical_interval[1])
            )
            shares.append(0.5 * (high - low) / (critical + POWER_QUANTILE))
        return float(np.median(shares))

    def _critical_ratio(self, g: int, at: Array | None = None) -> float:
        """Return √(LM/λ) that the family-wise test requires of a group; ``at``: were these its critical values."""
        from scipy.special import fdtri

        k, nu = float(self._scorer.kdim[g]), float(self._scorer.dof[g])
        critical = (self.critical if at is None else at)[self._scorer.columns.groups[g].candidate]
        return float(np.sqrt(k * fdtri(k, nu, 1.0 - np.exp(-max(critical, 1e-9)))))

    def _visible(self, c: Candidate, g: int) -> tuple[float, float]:
        """Return the smallest strength that would be seen at a group's shape, and that which would matter there."""
        group = self._scorer.columns.groups[g]
        _, cov = self._scorer.strength(g, self.scores.amplitude[group.columns, 0])
        variance = float(np.max(np.diag(cov)) * self.scores.inflation[g, 0])
        return VISIBLE_MARGIN * smallest_visible(self._critical_ratio(g), variance), self._matters(c, group.shape)

    def _least_visible(self, c: Candidate, groups: Sequence[int]) -> tuple[float, float]:
        """Return the same at the shape at which a strength that matters shows least."""
        pairs = [self._visible(c, g) for g in groups]
        return max((p for p in pairs if np.isfinite(p[1])), key=lambda p: p[0] / p[1], default=pairs[0])

    def _matters(self, c: Candidate, shape: int) -> float:
        """Return the strength that moves some output by its noise floor, or that which the candidate states."""
        if c.strength_that_matters is not None:
            return c.strength_that_matters
        blocks = c.sensitivities[shape]
        if self.residual.weighting:  # what the outputs themselves would do
            blocks = tuple(w.inverse(b) for w, b in zip(self.residual.weighting, blocks, strict=True))
        peak = np.max([np.max(np.abs(b), axis=(0, 2)) for b in blocks], axis=0)
        ok = self.floor > 0
        return float(1.0 / np.max(peak[ok] / self.floor[ok])) if np.any(peak[ok] > 0) else float("inf")


def smallest_visible(critical: float, variance: float) -> float:
    """Return the strength seen with a probability of 80 % when √(LM/λ) must exceed ``critical``.

    Parameters
    ----------
    critical : float
    variance : float
        Of the strength's estimate.
    """
    return float((critical + POWER_QUANTILE) * np.sqrt(variance))


def held_out_gain(Z: Array, e: Array, layout: Layout, lam: float) -> float:
    """Return the gain of log-likelihood on each block with the amplitudes fitted on the others, summed.

    `Layout.left_out` says what is left out.  An amplitude that only the block itself determines, such as a point of a
    curve at a speed that no other record reaches, is not known from the others: a normal prior holds it near zero, with
    the spread of the amplitudes of the whole fit.

    Parameters
    ----------
    Z : ndarray, shape (n_rows, k)
        Orthonormal columns.
    e : ndarray, shape (n_rows,)
    layout : Layout
    lam : float
        Variance of the noise.
    """
    spans = layout.left_out()
    S = np.array([Z[sp].T @ e[sp] for sp in spans])
    H = np.array([Z[sp].T @ Z[sp] for sp in spans])
    whole = S.sum(axis=0)
    prior = lam * whole.size / max(float(whole @ whole), 1e-300) * np.eye(whole.size)
    total = 0.0
    for i in range(len(spans)):
        a = np.linalg.solve(H.sum(axis=0) - H[i] + prior, whole - S[i])
        total += float(2 * a @ S[i] - a @ H[i] @ a)
    return total / (2.0 * lam)
