"""A step of the search, two effects ahead: would two together explain what one by one they hide of each other?"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from discrepancy.effects.catalogue import catalogue
from discrepancy.effects.effect import Effect
from discrepancy.effects.from_scan_row import contained, effect_of, simpler_in
from discrepancy.search.model_comparison import CLEARLY, bic_difference, matters, taken
from discrepancy.search.step import LOOKS, MOST, Step
from discrepancy.search.trial_fits import Fit, tried
from discrepancy.stages.stage import AcceptedEffect, RivalExplanation, Stage
from discrepancy.statistics.masking_pairs import MaskingPairs, Pair, find_masking_pairs
from discrepancy.statistics.thresholds import DECISIVE_BIC
from multibody.base.parallel import parallel_map

if TYPE_CHECKING:
    from discrepancy.statistics.scan_result import ScanRow

__all__ = ["look_ahead"]

PAIRS = 5  # pairs that are refitted, of those that differ in what they do; chosen
HALF = 0.5  # share of what the best pair explains from which another is worth a refit, as of single effects


def look_ahead(
    step: Step,
    stage: Stage,
    fit: Fit,
    *,
    include: Sequence[str],
    exclude: Sequence[str],
    level: float,
    seed: int,
    progress: Callable[[str], None],
) -> Step:
    """Return a step with two effects that hide each other in the place of its own, where they clearly explain more.

    One effect by itself is what a search step finds.  Of two that do nearly opposite things neither points along what
    is left, and the step finds nothing, or a third effect that resembles the difference.  So two are kept where both
    together clearly beat that third one, and that one beside the best partner it has.

    Parameters
    ----------
    step : Step
        What was found one effect at a time.
    stage : Stage
        That it begins from.
    fit : callable
        Fits a stage on trial, given its name, its effects, and the stage from where it begins.
    include, exclude : sequence of str
        Of the catalogue.
    level : float
        Family-wise level of the study, of which this look has its share.
    seed : int
    progress : callable
    """
    experiment = stage.identify.fits[0].experiment
    found = catalogue(stage.system, experiment.outputs, experiment.inputs, include=include, exclude=exclude)
    entries = {e.name: e for e in found}
    refused = {e.name for e, _ in step.refused}
    known = {r.name for r in step.scan.rows if r.name in refused or simpler_in(stage.effects, r.kind, r.where)}

    def excluded(a: ScanRow, b: ScanRow) -> bool:
        return contained(a, b) or a.name in known or b.name in known

    singly = str(step.accepted.effect) if step.accepted is not None else ""
    hidden = find_masking_pairs(step.scans, excluded, level=level / LOOKS, seed=seed, singly=singly)
    if hidden is None:
        return step

    def together(pair: Pair) -> Stage | None:
        progress(f"refit with {' and '.join(pair.names)} together: they hide each other")
        new = [effect_of(entries[r.name], r, stage.effects) for r in pair.rows]
        return _fitted(fit, (*stage.effects, *new), 2, stage, progress)

    families = _families(hidden)
    fits = parallel_map(lambda f: together(f[0]), families)
    better = [(s, f) for s, f in zip(fits, families, strict=True) if s is not None]
    better = [t for t in better if bic_difference(t[0], stage) < -DECISIVE_BIC and matters(t[0], stage)]
    if not better:
        return step
    better = _simplest_first(better, stage)
    best = better[0][0]
    if step.stage is not None and bic_difference(best, step.stage) > -CLEARLY:
        return step
    if step.stage is not None and step.accepted is not None and hidden.singly is not None:
        other = next(r for r in hidden.singly.rows if r.name != singly)
        progress(f"refit with {singly} and {other.name}")
        partner = effect_of(entries[other.name], other, step.stage.effects)
        rival = _fitted(fit, (*step.stage.effects, partner), 1, step.stage, progress)
        if rival is not None and bic_difference(best, rival) > -CLEARLY:
            more = (_two(f[0].rows, bic_difference(s, rival)) for s, f in better if singly not in f[0].names)
            rivals = (*step.accepted.rivals, *(r for r in more if r.indistinguishable))
            return replace(step, accepted=replace(step.accepted, rivals=_sorted(rivals)))
    return _both(step, stage, better, min(1.0, LOOKS * hidden.p_value), fit, progress)


def _families(hidden: MaskingPairs) -> list[list[Pair]]:
    """Return the pairs worth a refit, each with those that all but do the same."""
    families: list[list[Pair]] = []
    for pair in (p for p in hidden.pairs if p.gain > HALF * hidden.pairs[0].gain):
        family = next((f for f in families if hidden.scores.twins(pair, f[0])), None)
        if family is not None:
            family.append(pair)
        elif len(families) < PAIRS:
            families.append([pair])
    return families


def _fitted(
    fit: Fit, effects: tuple[Effect, ...], new: int, start: Stage, progress: Callable[[str], None]
) -> Stage | None:
    """Return a stage fitted on trial; None if it cannot be simulated, or puts one of the last ``new`` to nothing."""
    stage = tried(fit, f"+ {effects[-1]}", effects, start, progress)
    return stage if stage is not None and all(any(e.strengths.values()) for e in stage.effects[-new:]) else None


def _simplest_first(
    better: Sequence[tuple[Stage, list[Pair]]], stage: Stage
) -> list[tuple[Stage, list[Pair]]]:
    """Return pairs by their BIC, but first the simplest that is as good as the best, or does most of its work.

    As of single effects (`discrepancy.search.step`): a law with more freedom always fits a little better.
    """
    found = sorted(better, key=lambda t: bic_difference(t[0], stage))
    best = found[0][0]
    least, work = bic_difference(best, stage), MOST * taken(best, stage)

    def in_its_place(other: Stage) -> bool:
        names = [{f"{k}@{e.where}" for k in (e.kind, *e.definition.contains)} for e in best.effects[-2:]]
        a, b = map(str, other.effects[-2:])
        both = any(a in one and b in two for one, two in (names, names[::-1]))
        return both and taken(other, stage) >= work

    close = [t for t in found if bic_difference(t[0], stage) - least < DECISIVE_BIC or in_its_place(t[0])]
    first = min(close, key=lambda t: sum(len(e.strengths) for e in t[0].effects))
    return [first, *(t for t in found if t is not first)]


def _both(
    step: Step,
    stage: Stage,
    better: Sequence[tuple[Stage, Sequence[Pair]]],
    p_value: float,
    fit: Fit,
    progress: Callable[[str], None],
) -> Step:
    """Return the step with both effects of the best pair, that first which by itself is the better one."""
    best = better[0][0]
    two = best.effects[-2:]
    alone: list[tuple[float, Stage, Effect]] = []
    for effect, other in (two, two[::-1]):
        progress(f"refit with {effect} alone")
        by_itself = tried(fit, f"+ {effect}", (*stage.effects, effect), stage, progress)
        if by_itself is not None:
            alone.append((bic_difference(by_itself, stage), by_itself, other))
    if not alone:
        return step
    difference, first, second = min(alone, key=lambda t: t[0])
    ordered = (*best.effects[:-2], next(e for e in two if e is not second), second)
    both = replace(best, name=f"+ {second}", effects=ordered)
    rivals = _rivals(better, stage, (str(ordered[-2]), str(second)))
    accepted = [
        AcceptedEffect(
            effect=effect, p_value=p_value, delta_bic=change, rivals=rivals[str(effect)], masked_by=str(other)
        )
        for effect, other, change in (
            (ordered[-2], second, difference),
            (second, ordered[-2], bic_difference(both, first)),
        )
    ]
    return replace(step, first=(accepted[0], first), accepted=accepted[1], stage=both)


def _rivals(
    better: Sequence[tuple[Stage, Sequence[Pair]]], stage: Stage, names: tuple[str, str]
) -> Mapping[str, tuple[RivalExplanation, ...]]:
    """Return for each effect of the best pair what stands in its place in the others; two new ones go with the last.

    Of pairs that all but do the same only the first was refitted; the others are known by the scan alone.
    """
    least, own = bic_difference(better[0][0], stage), better[0][1]
    others = [(p, own[0].gain - p.gain, False) for p in own[1:]]
    others += [(f[0], bic_difference(s, stage) - least, True) for s, f in better[1:]]
    found: dict[str, list[RivalExplanation]] = {n: [] for n in names}
    for pair, difference, refitted in others:
        new = [r for r in pair.rows if r.name not in names]
        if len(new) == 2:
            found[names[-1]].append(_two(new, float(difference), refitted))
        else:
            gone = next(n for n in names if n not in pair.names)
            found[gone].append(
                RivalExplanation(
                    kind=new[0].kind,
                    where=new[0].where,
                    delta_bic=float(difference),
                    refitted=refitted,
                    indistinguishable=difference < DECISIVE_BIC,
                )
            )
    return {n: _sorted(r) for n, r in found.items()}


def _sorted(rivals: Iterable[RivalExplanation]) -> tuple[RivalExplanation, ...]:
    return tuple(sorted(rivals, key=lambda r: r.delta_bic))


def _two(rows: Sequence[ScanRow], difference: float, refitted: bool = True) -> RivalExplanation:
    """Return two effects as one other explanation."""
    kind = f"{rows[0].kind} with {rows[1].name}"
    return RivalExplanation(
        kind=kind,
        where=rows[0].where,
        delta_bic=difference,
        refitted=refitted,
        indistinguishable=difference < DECISIVE_BIC,
    )
