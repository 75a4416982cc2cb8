"""Add two effects that mask each other, where both together clearly explain more than any single one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.effects.effect import Effect
from discrepancy.effects.from_scan_row import contained, effect_of, simpler_in
from discrepancy.search.decision import Decision, TriedModel
from discrepancy.search.fits_on_trial import TrialFit, fit_on_trial, fitted_present
from discrepancy.search.model_comparison import bic_difference, error_reduction, is_relevant
from discrepancy.search.policy import POLICY
from discrepancy.search.rivals import by_bic, rival_pair, rivals_of_pair
from discrepancy.search.scoring import catalogue_of
from discrepancy.stages.stage import AcceptedEffect, Stage
from discrepancy.statistics.masking_pairs import MaskingPairs, Pair, find_masking_pairs
from discrepancy.statistics.thresholds import DECISIVE_BIC, LEVEL_SHARES, VERY_STRONG_BIC
from multibody.base.parallel import parallel_map

if TYPE_CHECKING:
    from discrepancy.statistics.scan_result import ScanRow

__all__ = ["propose_pair"]


def propose_pair(
    decision: Decision,
    stage: Stage,
    fit: TrialFit,
    *,
    include: Sequence[str],
    exclude: Sequence[str],
    level: float,
    seed: int,
    progress: Callable[[str], None],
) -> Decision:
    """Replace a decision by one for a masking pair, where the two effects together clearly explain more.

    A step finds one effect at a time.  Of two that nearly cancel neither points along the residual, and the step finds
    nothing, or a third effect that resembles their difference.  The pair is accepted where both together clearly beat
    that third effect, and that effect with the best partner it has.

    Parameters
    ----------
    decision : Decision
        Of the step with one effect at a time.
    stage : Stage
        From which it begins.
    fit : TrialFit
    include, exclude : sequence of str
        Patterns of the catalogue.
    level : float
        Family-wise level of the study, of which this test has its share.
    seed : int
    progress : callable
    """
    entries = {e.name: e for e in catalogue_of(stage, include, exclude)}
    refused = {e.name for e, _ in decision.refused}
    known = {r.name for r in decision.scan.rows if r.name in refused or simpler_in(stage.effects, r.kind, r.where)}

    def excluded(a: ScanRow, b: ScanRow) -> bool:
        return contained(a, b) or a.name in known or b.name in known

    single = str(decision.accepted.effect) if decision.accepted is not None else ""
    pairs = find_masking_pairs(decision.scans, excluded, level=level / LEVEL_SHARES, seed=seed, singly=single)
    if pairs is None:
        return decision

    def together(pair: Pair) -> Stage | None:
        progress(f"refit with the masking pair {' and '.join(pair.names)}")
        new = [effect_of(entries[r.name], r, stage.effects) for r in pair.rows]
        return fitted_present(fit, f"+ {new[-1]}", (*stage.effects, *new), 2, stage, progress)

    families = _families(pairs)
    fits = parallel_map(lambda f: together(f[0]), families)
    decision = replace(decision, trials=(*decision.trials, *_pair_trials(fits, families, stage)))
    better = [(s, f) for s, f in zip(fits, families, strict=True) if s is not None]
    better = [t for t in better if bic_difference(t[0], stage) < -DECISIVE_BIC and is_relevant(t[0], stage)]
    if not better:
        return decision
    better = _simplest_pair_first(better, stage)
    best = better[0][0]
    if decision.stage is not None and bic_difference(best, decision.stage) > -VERY_STRONG_BIC:
        return decision
    if decision.stage is not None and decision.accepted is not None and pairs.singly is not None:
        other = next(r for r in pairs.singly.rows if r.name != single)
        progress(f"refit with {single} and {other.name}")
        partner = effect_of(entries[other.name], other, decision.stage.effects)
        both = (*decision.stage.effects, partner)
        rival = fitted_present(fit, f"+ {partner}", both, 1, decision.stage, progress)
        if rival is not None and bic_difference(best, rival) > -VERY_STRONG_BIC:
            accepted = decision.accepted
            others = ((s, f[0]) for s, f in better if single not in f[0].names)
            more = (rival_pair(pair.rows, bic_difference(s, rival)) for s, pair in others)
            rivals = (*accepted.rivals, *(r for r in more if r.indistinguishable))
            return replace(decision, accepted=replace(accepted, rivals=by_bic(rivals)))
    return _both(decision, stage, better, min(1.0, LEVEL_SHARES * pairs.p_value), fit, progress)


def _pair_trials(fits: Sequence[Stage | None], families: Sequence[Sequence[Pair]], stage: Stage) -> list[TriedModel]:
    trials = []
    for fitted, family in zip(fits, families, strict=True):
        name = " + ".join(family[0].names)
        difference = bic_difference(fitted, stage) if fitted is not None else np.nan
        outcome = "failed" if fitted is None else "better" if difference < -DECISIVE_BIC else "not better"
        trials.append(TriedModel(name, difference, outcome))
    return trials


def _families(pairs: MaskingPairs) -> list[list[Pair]]:
    """Return the pairs that deserve a refit, each with those that change almost the same."""
    families: list[list[Pair]] = []
    for pair in (p for p in pairs.pairs if p.gain > POLICY.finalist_reduction * pairs.pairs[0].gain):
        family = next((f for f in families if pairs.scores.twins(pair, f[0])), None)
        if family is not None:
            family.append(pair)
        elif len(families) < POLICY.pairs:
            families.append([pair])
    return families


def _simplest_pair_first(better: Sequence[tuple[Stage, list[Pair]]], stage: Stage) -> list[tuple[Stage, list[Pair]]]:
    """Return pairs by their BIC, but first the simplest that is as good as the best, or does most of its work.

    As of single effects (`discrepancy.search.moves.add_one`): a law with more freedom always fits a little better.
    """
    ranked = sorted(better, key=lambda t: bic_difference(t[0], stage))
    best = ranked[0][0]
    least, needed = bic_difference(best, stage), POLICY.simpler_reduction * error_reduction(best, stage)

    def contained_in_best(other: Stage) -> bool:
        names = [{f"{k}@{e.where}" for k in (e.kind, *e.definition.contains)} for e in best.effects[-2:]]
        a, b = map(str, other.effects[-2:])
        both = any(a in one and b in two for one, two in (names, names[::-1]))
        return both and error_reduction(other, stage) >= needed

    close = [t for t in ranked if bic_difference(t[0], stage) - least < DECISIVE_BIC or contained_in_best(t[0])]
    first = min(close, key=lambda t: sum(len(e.strengths) for e in t[0].effects))
    return [first, *(t for t in ranked if t is not first)]


def _both(
    decision: Decision,
    stage: Stage,
    better: Sequence[tuple[Stage, Sequence[Pair]]],
    p_value: float,
    fit: TrialFit,
    progress: Callable[[str], None],
) -> Decision:
    """Return the decision for both effects of the best pair; the one that is better alone comes first."""
    best = better[0][0]
    two = best.effects[-2:]
    alone: list[tuple[float, Stage, Effect]] = []
    for effect, other in (two, two[::-1]):
        progress(f"refit with {effect} alone")
        by_itself = fit_on_trial(fit, f"+ {effect}", (*stage.effects, effect), stage, progress)
        if by_itself is not None:
            alone.append((bic_difference(by_itself, stage), by_itself, other))
    if not alone:
        return decision
    difference, first, second = min(alone, key=lambda t: t[0])
    ordered = (*best.effects[:-2], next(e for e in two if e is not second), second)
    both = replace(best, name=f"+ {second}", effects=ordered)
    rivals = rivals_of_pair(better, stage, (str(ordered[-2]), str(second)))
    accepted = [
        AcceptedEffect(
            effect=effect, p_value=p_value, delta_bic=change, rivals=rivals[str(effect)], masked_by=str(other)
        )
        for effect, other, change in (
            (ordered[-2], second, difference),
            (second, ordered[-2], bic_difference(both, first)),
        )
    ]
    reason = "both together are clearly better than any single effect"
    return replace(decision, first=(accepted[0], first), accepted=accepted[1], stage=both, reason=reason)
