"""Add the likeliest effect where none is significant and yet the residual follows the inputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from discrepancy.effects.catalogue import Entry
from discrepancy.search.fits_on_trial import EffectFit, best_fit, fits_of_candidate
from discrepancy.search.model_comparison import bic_difference, error_reduction, exceeds_noise
from discrepancy.search.policy import POLICY
from discrepancy.search.rivals import rival_explanation
from discrepancy.search.scoring import catalogue_of
from discrepancy.stages.stage import AcceptedEffect, Stage
from discrepancy.statistics.thresholds import DECISIVE_BIC, LEVEL_SHARES
from multibody.base.parallel import parallel_map

if TYPE_CHECKING:
    from discrepancy.statistics.scan_result import ScanResult, ScanRow

__all__ = ["propose_without_significance"]


def propose_without_significance(
    stage: Stage,
    scan: ScanResult,
    refit: EffectFit,
    *,
    include: Sequence[str],
    exclude: Sequence[str],
    p_value: float,
    progress: Callable[[str], None],
) -> Stage | None:
    """Return the stage with the likeliest effect where none is significant and yet the residual follows the inputs.

    A scan is linear about the recalibrated model.  An effect that is too nonlinear for that, such as a large backlash
    that calibration has replaced by softer springs, is found by fits from the parameters as stated.  They are made only
    where the omnibus test says that something is missing, so they keep its level; one is accepted only if it removes a
    good part of the error.  Before them come the effects that the scan has found to be present but irrelevant: one of
    them is the likeliest reason for a residual that follows the inputs, and it only has to be the better model.

    Parameters
    ----------
    stage : Stage
        In which no effect was significant.
    scan : ScanResult
        Of that stage.
    refit : EffectFit
    include, exclude : sequence of str
        Patterns of the catalogue.
    p_value : float
        Of the omnibus test.
    progress : callable
    """
    entries = {e.name: e for e in catalogue_of(stage, include, exclude)}
    present = _best_present(stage, scan, refit, entries, progress)
    if present is not None or not exceeds_noise(stage):
        return present
    problem = stage.linearised_problem()
    by_reduction = sorted((r for r in scan.rows if r.name in entries), key=lambda r: -r.error_reduction)
    nonlinear = [r for r in by_reduction if not entries[r.name].kind.linear]
    rows = list({r.name: r for r in (*nonlinear, *by_reduction[: POLICY.finalists])}.values())

    def fitted(row: ScanRow) -> Stage | None:
        entry = entries[row.name]
        progress(f"refit with {row.name}, from the parameters as stated")
        shapes = entry.kind.shape_grid(problem.motion_range(entry)) if entry.kind.at == "connection" else [row.shape]
        fits = fits_of_candidate(refit, entry, row, shapes, stage.effects, from_prior=True)
        best = best_fit(fits, stage, progress)
        return best if isinstance(best, Stage) else None

    fits = [
        s for s in parallel_map(fitted, rows) if s is not None and error_reduction(s, stage) > POLICY.likely_reduction
    ]
    return _best_with_rivals(fits, stage, dict.fromkeys((str(s.effects[-1]) for s in fits), p_value))


def _best_present(
    stage: Stage,
    scan: ScanResult,
    refit: EffectFit,
    entries: Mapping[str, Entry],
    progress: Callable[[str], None],
) -> Stage | None:
    """Return the stage with the best of the effects that the scan has found to be present but irrelevant, or None."""
    from discrepancy.statistics.verdicts import Verdict

    present = [r for r in scan.rows if r.verdict in (Verdict.NEGLIGIBLE, Verdict.MISSING) and r.name in entries]
    rows = sorted(present, key=lambda r: r.delta_bic)[: POLICY.finalists]

    def fitted(row: ScanRow) -> Stage | None:
        progress(f"refit with {row.name}, which is present and changes little")
        best = best_fit(fits_of_candidate(refit, entries[row.name], row, [row.shape], stage.effects), stage, progress)
        return best if isinstance(best, Stage) else None

    fits = [s for s in parallel_map(fitted, rows) if s is not None]
    return _best_with_rivals(fits, stage, {r.name: min(1.0, LEVEL_SHARES * r.p_value) for r in rows})


def _best_with_rivals(fits: Sequence[Stage], stage: Stage, p_values: Mapping[str, float]) -> Stage | None:
    """Return the best of some fits by BIC, the others as its rivals; None if none is clearly better."""
    improved = (s for s in fits if bic_difference(s, stage) < -DECISIVE_BIC)
    better = sorted(improved, key=lambda s: bic_difference(s, stage))
    if not better:
        return None
    best, least = better[0], bic_difference(better[0], stage)
    rivals = []
    for other in better[1:]:
        effect, difference = other.effects[-1], bic_difference(other, stage) - least
        tied = difference < DECISIVE_BIC
        rivals.append(rival_explanation(effect, difference, refitted=True, tied=tied))
    effect = best.effects[-1]
    accepted = AcceptedEffect(effect=effect, p_value=p_values[str(effect)], delta_bic=least, rivals=tuple(rivals))
    return replace(best, accepted=accepted)
