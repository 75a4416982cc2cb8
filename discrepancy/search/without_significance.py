"""Where no effect is significant and yet the residual follows the inputs: the likeliest effects, fitted from anew.

A scan looks along straight lines from the recalibrated model.  What bends too much for that, as a large play that
calibration has replaced by softer springs, is found by fits that begin where the parameters were stated.  They are made
only where the omnibus test says that something is missing, so they keep its level; and one is believed only if it takes
a good part of the error away.

Before them come the effects that the scan has found and that were passed over as changing little: where what is left
follows the inputs by an amount that matters, one of them is the likeliest reason.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from discrepancy.effects.catalogue import Entry, catalogue
from discrepancy.search.model_comparison import bic_difference, loud, taken
from discrepancy.search.step import FINALISTS, LOOKS
from discrepancy.search.trial_fits import Refit, best_of, fits_with
from discrepancy.stages.stage import AcceptedEffect, RivalExplanation, Stage
from discrepancy.statistics.thresholds import DECISIVE_BIC
from discrepancy.statistics.verdicts import Verdict
from multibody.base.parallel import parallel_map

if TYPE_CHECKING:
    from discrepancy.statistics.scan_result import ScanResult, ScanRow

__all__ = ["last_resort"]

SHARE = 0.25  # of the mean square error that an effect must take away, on average over the outputs; chosen


def last_resort(
    stage: Stage,
    scan: ScanResult,
    refit: Refit,
    *,
    include: Sequence[str],
    exclude: Sequence[str],
    p_value: float,
    progress: Callable[[str], None],
) -> Stage | None:
    """Return the stage with the likeliest effect, or None if there is none.

    An effect that the scan has found, however small, need only be the better model; of the others it is the one that
    takes most of the error away, and that must be a good part.

    Parameters
    ----------
    stage : Stage
        In which no effect was significant.
    scan : ScanResult
        Of that stage.
    refit : Refit
    include, exclude : sequence of str
    p_value : float
        Of the omnibus test that asks for this.
    progress : callable
    """
    experiment = stage.identify.fits[0].experiment
    found = catalogue(stage.system, experiment.outputs, experiment.inputs, include=include, exclude=exclude)
    entries = {e.name: e for e in found}
    small = _small(stage, scan, refit, entries, progress)
    if small is not None or not loud(stage):
        return small
    facts = stage.linearised_problem()
    by_drop = sorted((r for r in scan.rows if r.name in entries), key=lambda r: -r.error_reduction)
    bent = [r for r in by_drop if not entries[r.name].kind.linear]
    rows = list({r.name: r for r in (*bent, *by_drop[:FINALISTS])}.values())

    def trial(row: ScanRow) -> Stage | None:
        entry = entries[row.name]
        progress(f"refit with {row.name}, from the parameters as stated")
        shapes = entry.kind.shape_grid(facts.motion_range(entry)) if entry.kind.at == "connection" else [row.shape]
        best = best_of(fits_with(refit, entry, row, shapes, stage.effects, anew=True), stage, progress)
        return best if isinstance(best, Stage) else None

    tried = [s for s in parallel_map(trial, rows) if s is not None and taken(s, stage) > SHARE]
    return _best(tried, stage, dict.fromkeys((str(s.effects[-1]) for s in tried), p_value))


def _small(
    stage: Stage,
    scan: ScanResult,
    refit: Refit,
    entries: Mapping[str, Entry],
    progress: Callable[[str], None],
) -> Stage | None:
    """Return the stage with the best effect of those that are surely there and change little, or None."""
    there = [r for r in scan.rows if r.verdict in (Verdict.NEGLIGIBLE, Verdict.MISSING) and r.name in entries]
    rows = sorted(there, key=lambda r: r.delta_bic)[:FINALISTS]

    def trial(row: ScanRow) -> Stage | None:
        progress(f"refit with {row.name}, which is there and changes little")
        best = best_of(fits_with(refit, entries[row.name], row, [row.shape], stage.effects), stage, progress)
        return best if isinstance(best, Stage) else None

    tried = [s for s in parallel_map(trial, rows) if s is not None]
    return _best(tried, stage, {r.name: min(1.0, LOOKS * r.p_value) for r in rows})


def _best(tried: Sequence[Stage], stage: Stage, p_values: Mapping[str, float]) -> Stage | None:
    """Return the best of some trials by BIC, with the others as its rivals; None if none is clearly better."""
    better = sorted(
        (s for s in tried if bic_difference(s, stage) < -DECISIVE_BIC), key=lambda s: bic_difference(s, stage)
    )
    if not better:
        return None
    best, least = better[0], bic_difference(better[0], stage)
    rivals = tuple(_rival(s, bic_difference(s, stage) - least) for s in better[1:])
    return replace(
        best,
        accepted=AcceptedEffect(
            effect=best.effects[-1], p_value=p_values[str(best.effects[-1])], delta_bic=least, rivals=rivals
        ),
    )


def _rival(stage: Stage, difference: float) -> RivalExplanation:
    effect = stage.effects[-1]
    return RivalExplanation(
        kind=effect.kind,
        where=effect.where,
        delta_bic=difference,
        refitted=True,
        indistinguishable=difference < DECISIVE_BIC,
    )
