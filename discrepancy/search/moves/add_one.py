"""Add one effect: which candidates are fitted, and which of the fits is accepted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.effects.catalogue import Entry
from discrepancy.effects.effect import Effect
from discrepancy.effects.from_scan_row import effect_of, simpler_in
from discrepancy.effects.kinds import kind_named
from discrepancy.search.decision import Decision, TriedModel
from discrepancy.search.fits_on_trial import EffectFit, best_fit, fits_of_candidate
from discrepancy.search.model_comparison import bic_difference, error_reduction, is_relevant
from discrepancy.search.policy import POLICY
from discrepancy.search.rivals import rivals_of_effect
from discrepancy.search.scoring import score_candidates
from discrepancy.sensitivities.candidates import cannot_be_built
from discrepancy.stages.prior_conflict import needs_prior_conflict
from discrepancy.stages.stage import AcceptedEffect, Stage
from discrepancy.statistics.thresholds import DECISIVE_BIC, LEVEL_SHARES
from multibody.base.errors import ModelError
from multibody.base.parallel import parallel_map
from multibody.base.progress import silent

if TYPE_CHECKING:
    from discrepancy.statistics.scan_result import ScanResult, ScanRow

__all__ = ["propose_effect", "require_presence"]


def propose_effect(
    stage: Stage,
    refit: EffectFit,
    *,
    include: Sequence[str],
    exclude: Sequence[str],
    level: float,
    seed: int,
    progress: Callable[[str], None] = silent,
) -> Decision:
    """Score all candidates on a stage's residual, refit the best of them, and accept one or none.

    Parameters
    ----------
    stage : Stage
    refit : EffectFit
    include, exclude : sequence of str
        Patterns of the catalogue.
    level : float
        Family-wise significance level.
    seed : int
    progress : callable
    """
    scans, candidates, refused = score_candidates(
        stage, include=include, exclude=exclude, level=level, seed=seed, progress=progress
    )
    finalists = _finalists(scans, [c.name for c in candidates], stage.effects)
    if not finalists:
        return Decision(scans=tuple(scans), refused=tuple(refused), reason="no candidate is significant")
    by_name = {c.name: c for c in candidates}

    def fitted(row: ScanRow) -> Stage | ModelError | None:
        candidate = by_name[row.name]
        entry: Entry = candidate.info["entry"]
        simpler = simpler_in(stage.effects, row.kind, row.where)
        effect = effect_of(entry, row, stage.effects, simpler)
        progress(f"refit with {effect}" + (f" in place of {simpler[0]}" if simpler else ""))
        best = best_fit(fits_of_candidate(refit, entry, row, candidate.shapes, stage.effects, simpler), stage, progress)
        if isinstance(best, Stage) and simpler and not entry.kind.by_direction and bic_difference(best, stage) >= 0.0:
            added = partial(refit, effect_of(entry, row, stage.effects), ())  # in addition to them, not in their place
            best = best_fit([added], stage, progress)
        return best

    better: list[tuple[Stage, ScanRow]] = []
    irrelevant: list[ScanRow] = []
    trials: list[TriedModel] = []

    def try_all(rows: Sequence[ScanRow]) -> None:
        for row, result in zip(rows, parallel_map(fitted, rows), strict=True):
            if isinstance(result, ModelError):
                refused.append((by_name[row.name].info["entry"], cannot_be_built(result)))
            if not isinstance(result, Stage):
                trials.append(TriedModel(row.name, np.nan, "failed"))
                continue
            difference = bic_difference(result, stage)
            if not difference < 0.0:
                trials.append(TriedModel(row.name, difference, "not better"))
            elif is_relevant(result, stage) or needs_prior_conflict(result.identify, stage.identify):
                trials.append(TriedModel(row.name, difference, "better"))
                better.append((result, row))
            else:
                trials.append(TriedModel(row.name, difference, "not relevant"))
                irrelevant.append(row)
        better.sort(key=lambda t: bic_difference(t[0], stage))

    try_all(finalists)
    if not better:
        return Decision(
            scans=tuple(scans),
            trials=tuple(trials),
            refused=tuple(refused),
            irrelevant=tuple(irrelevant),
            reason="no refit is better by BIC and above the noise floor",
        )
    p_value = min(1.0, LEVEL_SHARES * better[0][1].p_value)
    if error_reduction(better[0][0], stage) < POLICY.well_explained:
        try_all(_nonlinear_at(scans[-1], better[0][1].where, [r.name for r in finalists]))
    better = _simplest_first(better, stage)
    best, row = better[0]
    p_value = min(p_value, LEVEL_SHARES * row.p_value)
    rivals = rivals_of_effect(best, stage, better[1:], scans, row.name)
    accepted = AcceptedEffect(
        effect=best.effects[-1], p_value=p_value, delta_bic=bic_difference(best, stage), rivals=rivals
    )
    return Decision(
        scans=tuple(scans),
        trials=tuple(trials),
        refused=tuple(refused),
        irrelevant=tuple(irrelevant),
        accepted=accepted,
        stage=best,
        reason="the simplest of the refits that are as good as the best one",
    )


def _finalists(scans: Sequence[ScanResult], known: Sequence[str], effects: Sequence[Effect]) -> list[ScanRow]:
    """Return the significant candidates that deserve a refit, best first.

    Each brings the simpler kinds that it contains.  Significant richer kinds of the effects that are already in the
    model are tried as well, however little they explain: a law that was only the first answer may be what is wrong.
    """
    from discrepancy.statistics.verdicts import Verdict

    scan = scans[-1]
    significant = sorted((r for r in scan.rows if r.verdict is Verdict.MISSING), key=lambda r: r.delta_bic)
    if not significant:
        return []
    close = [r for r in significant if r.error_reduction > POLICY.finalist_reduction * significant[0].error_reduction]
    strongest = _different(scan, close, effects)
    simpler = [f"{kind}@{r.where}" for r in strongest for kind in kind_named(r.kind).contains]
    names = [r.name for r in strongest]
    richer = [r.name for r in significant if simpler_in(effects, r.kind, r.where)]
    more = dict.fromkeys([*simpler, *richer])
    names += [n for n in more if n not in names and n in known and n not in scan.refused]
    return [scan[n] for n in names]


def _different(scan: ScanResult, rows: Sequence[ScanRow], effects: Sequence[Effect]) -> list[ScanRow]:
    """Return the first candidates of which no two change the same, as many as a step fits.

    Of several that change the same, the one at a place where something was found already is kept, else the first.
    """
    known = {e.where for e in effects}
    left = list(rows)
    kept: list[ScanRow] = []
    while left and len(kept) < POLICY.finalists:
        ties = scan.ties_of(left[0].name)
        tied = (*ties.same_kind, *ties.other_kind) if ties is not None else ()
        same = {left[0].name, *(t.name for t in tied if t.correlation >= POLICY.same_correlation)}
        kept.append(next((r for r in left if r.name in same and r.where in known), left[0]))
        left = [r for r in left if r.name not in same]
    return kept


def _nonlinear_at(scan: ScanResult, where: str, known: Sequence[str]) -> list[ScanRow]:
    """Return the kinds at a place that are not linear in their strength, which a linear scan misjudges."""
    return [r for r in scan.rows if r.where == where and r.name not in known and not kind_named(r.kind).linear]


def _simplest_first(better: list[tuple[Stage, ScanRow]], stage: Stage) -> list[tuple[Stage, ScanRow]]:
    """Put first the simplest explanation that is tied with the best, or that does most of its work.

    A law with more freedom always fits a little better, because no law is exact.  Where a simpler law that it contains
    removes nearly as much of the error, that one is the answer of this step; if the rest matters, the next step finds
    it, and redundant effects are then removed.
    """
    least = bic_difference(better[0][0], stage)
    tied = [t for t in better if bic_difference(t[0], stage) - least < DECISIVE_BIC]
    known = {e.where for e in stage.effects}  # of two places that look the same, the one where something was found
    first = min(tied, key=lambda t: (_complexity(t[0]), t[1].where not in known))
    contained_in_first = [
        t
        for t in better
        if t[1].kind in first[0].effects[-1].definition.contains
        and t[1].where == first[1].where
        and error_reduction(t[0], stage) >= POLICY.simpler_reduction * error_reduction(first[0], stage)
    ]
    first = contained_in_first[0] if contained_in_first else first
    return [first, *(t for t in better if t is not first)]


def _complexity(stage: Stage) -> tuple[int, int, int]:
    """Return strengths and effects of a model, and the number of laws that its last law contains."""
    effects = stage.effects
    return sum(len(e.strengths) for e in effects), len(effects), len(effects[-1].definition.contains)


def require_presence(decision: Decision, stage: Stage, fit: Callable[[Stage], Stage]) -> Decision:
    """Withdraw an effect that removes no error, unless the full fit shows that its strength differs from zero.

    An effect that calibration replaces with parameters outside their stated uncertainty is accepted for their sake.  A
    model that is wrong in another way also drives parameters outside, and the strength of the effect that brings them
    back is then badly known: intervals account for the correlation of the residual.

    Parameters
    ----------
    decision : Decision
    stage : Stage
        From which the step begins.
    fit : callable
        Fits the stage of a trial fully.
    """
    if decision.accepted is None or decision.stage is None or is_relevant(decision.stage, stage):
        return decision
    effect = decision.accepted.effect
    fitted = fit(decision.stage).identify
    deviations = {q.name: float(s) for q, s in zip(fitted.parameters, fitted.std, strict=True)}
    for name in map(effect.parameter_name, effect.strengths):
        if np.isfinite(deviations[name]) and abs(fitted[name]) > POLICY.presence * deviations[name]:
            return decision
    reason = f"{effect} removes no error above the noise floor, and its strength may be zero"
    return replace(decision, accepted=None, stage=None, reason=reason)
