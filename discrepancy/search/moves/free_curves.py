"""Add a free curve where no law was found, or replace laws by one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from discrepancy.effects.effect import Effect
from discrepancy.search.fits_on_trial import TrialFit, fit_on_trial
from discrepancy.search.model_comparison import (
    bic_difference,
    error_reduction,
    excess_error,
    expected_curve_reductions,
    is_relevant,
    left_out_difference,
)
from discrepancy.search.policy import POLICY
from discrepancy.search.rivals import rival_explanation
from discrepancy.sensitivities.free_curve_scan import FreeCurveScan
from discrepancy.stages.stage import AcceptedEffect, Stage
from discrepancy.statistics.thresholds import LEVEL_SHARES, VERY_STRONG_BIC

__all__ = ["laws_at_connections", "predicts_better", "propose_curve", "propose_curve_for_all", "propose_curve_for_laws"]


def laws_at_connections(effects: Sequence[Effect]) -> list[Effect]:
    """Return the laws at connections, in whose place a free curve may stand."""
    return [e for e in effects if e.definition.at == "connection" and not e.definition.free_form]


def propose_curve(
    stage: Stage, fit: TrialFit, *, level: float, seed: int, progress: Callable[[str], None]
) -> Stage | None:
    """Return a stage with the best free curve added, if it is significant; for a stage that no law improves."""
    offer = _offered(stage, level / LEVEL_SHARES, seed, progress)
    return _best_curve(stage, stage, *_to_refit(offer), fit, progress)


def propose_curve_for_laws(
    stages: Sequence[Stage],
    fit: TrialFit,
    *,
    level: float,
    seed: int,
    progress: Callable[[str], None],
    final: bool = True,
) -> tuple[int, Stage] | None:
    """Try to replace all laws found at a connection by one free curve.

    A law that is only near the truth leaves a pattern that further laws then fit.  Where one curve beats the law found
    at its connection by strong evidence, removes clearly more of the error and clearly predicts records left out
    better, the curve is the honest answer; against several laws at one connection it is enough that the curve is the
    better model.  While the search goes on (not ``final``) that is not enough: the next law may be the missing one.
    Against one law only curves are fitted of which that can be expected (`expected_curve_reductions`).

    Returns
    -------
    (int, Stage) or None
        The number of stages that remain before the new one, and the new stage.
    """
    last = stages[-1]
    for where in dict.fromkeys(e.where for e in laws_at_connections(last.effects)):
        first = min(k for k, s in enumerate(stages) if any(e.where == where for e in s.effects))
        before = stages[first - 1]
        new = _since(before, last)
        if any(e.where != where for e in new):
            continue  # effects at several connections: a curve at one of them is no simpler
        several = final and len(new) > 1
        promising = None if several else _promising(before, last, where)
        if promising or several or _are_waves(new):
            offer = _offered(before, level, seed, progress, [where])
        else:
            continue
        least = 0.0 if several else VERY_STRONG_BIC
        curve = _best_curve(before, last, *_to_refit(offer, promising), fit, progress, least)
        if curve is None or not (several or _is_better_than_law(curve, last, before, new)):
            curve = _curve_for_waves(before, last, new, offer, fit, progress)
        if curve is not None:
            return first, curve
    return None


def propose_curve_for_all(
    stages: Sequence[Stage], fit: TrialFit, *, level: float, seed: int, progress: Callable[[str], None]
) -> tuple[int, Stage] | None:
    """Try to replace everything that was found by one free curve, at any connection.

    A force that no law describes can look like a drift of a sensor or like laws at several connections.

    Returns
    -------
    (int, Stage) or None
        As `propose_curve_for_laws`, which looks at each connection by itself.
    """
    first = min(k for k, s in enumerate(stages) if s.accepted is not None)
    before, last = stages[first - 1], stages[-1]
    new = _since(before, last)
    if not new or any(e.definition.free_form for e in new):
        return None
    promising = _promising(before, last)
    if not promising:
        return None
    offer = _offered(before, level, seed, progress)
    curve = _best_curve(before, last, *_to_refit(offer, promising), fit, progress)
    if curve is None or not _removes_more(curve, last, before):
        return None
    same_place = {e.where for e in new} == {curve.effects[-1].where}  # the case of `propose_curve_for_laws`
    return (first, curve) if not same_place or predicts_better(curve, last, new) else None


def _is_better_than_law(curve: Stage, last: Stage, before: Stage, laws: Sequence[Effect]) -> bool:
    return _removes_more(curve, last, before) and predicts_better(curve, last, laws)


def _since(before: Stage, last: Stage) -> list[Effect]:
    """Return the effects that came after a stage; those that it had are fitted anew since."""
    had = {e.component_name for e in before.effects}
    return [e for e in last.effects if e.component_name not in had]


def _offered(
    before: Stage, level: float, seed: int, progress: Callable[[str], None], where: Sequence[str] | None = None
) -> FreeCurveScan:
    return before.free_curve_scan(level=level, seed=seed, where=where, progress=progress)


def _promising(before: Stage, last: Stage, where: str | None = None) -> set[tuple[str, str]]:
    """Return place and regressor of the curves that may remove clearly more of the error than what was found."""
    shares = expected_curve_reductions(before, last)
    return {
        curve
        for curve, share in shares.items()
        if POLICY.linear_error * share > POLICY.curve_reduction and where in (None, curve[0])
    }


def _to_refit(offer: FreeCurveScan, promising: set[tuple[str, str]] | None = None) -> tuple[list[Effect], list[float]]:
    """Return the best curves of an offer, with their p-values; of these only the promising ones, if given."""
    best = list(zip(offer.effects, offer.p_values, strict=True))[: POLICY.curves]
    kept = [(e, p) for e, p in best if promising is None or (e.where, e.over) in promising]
    return [e for e, _ in kept], [p for _, p in kept]


def _are_waves(laws: Sequence[Effect]) -> bool:
    return len(laws) > 1 and all(e.kind == "angle_harmonic" for e in laws)


def _curve_for_waves(
    before: Stage,
    last: Stage,
    waves: Sequence[Effect],
    offer: FreeCurveScan,
    fit: TrialFit,
    progress: Callable[[str], None],
) -> Stage | None:
    """Return a curve over position in place of several waves that do not repeat, if it removes as much.

    Waves along the path can add up to any curve.  Where one of them passes too few of its periods, nothing shows that
    it repeats, and the curve is what is known.
    """
    if not _are_waves(waves):
        return None
    k = next((k for k, e in enumerate(offer.effects) if e.over == "position"), None)
    if k is None:
        return None
    curve = offer.effects[k]
    path = curve.shape["high"] - curve.shape["low"]
    if min(abs(e.shape["order"]) for e in waves) * path / (2.0 * np.pi) >= POLICY.repeats:
        return None
    best = _best_curve(before, last, [curve], offer.p_values[k : k + 1], fit, progress, least=-np.inf)
    enough = POLICY.wave_reduction * error_reduction(last, before)
    return best if best is not None and error_reduction(best, before) >= enough else None


def _best_curve(
    before: Stage,
    rival: Stage,
    effects: Sequence[Effect],
    p_values: Sequence[float],
    fit: TrialFit,
    progress: Callable[[str], None],
    least: float = VERY_STRONG_BIC,
) -> Stage | None:
    """Refit the offered curves; return the best relevant one if its BIC is below that of ``rival`` by ``least``."""
    fits = []
    for effect, p in zip(effects, p_values, strict=True):
        progress(f"refit with a free curve over {effect.over} at {effect.where}")
        stage = fit_on_trial(fit, f"+ {effect} over {effect.over}", (*before.effects, effect), before, progress)
        if stage is not None and is_relevant(stage, before):  # as is required of a law
            fits.append((bic_difference(stage, rival), stage, p))
    fits.sort(key=lambda t: t[0])
    if not fits or fits[0][0] > -least:
        return None
    difference, stage, p = fits[0]
    rivals = []
    for other_difference, other, _ in fits[1:]:
        curve, more = other.effects[-1], other_difference - difference
        other_curve = rival_explanation(curve, more, refitted=True, tied=more < VERY_STRONG_BIC)
        rivals.append(replace(other_curve, kind=f"{curve.kind} over {curve.over}"))
    accepted = AcceptedEffect(
        effect=stage.effects[-1], p_value=p, delta_bic=bic_difference(stage, before), rivals=tuple(rivals)
    )
    return replace(stage, accepted=accepted)


def predicts_better(curve: Stage, last: Stage, laws: Sequence[Effect]) -> bool:
    """Tell whether a curve over position clearly predicts records left out better than one law.

    It may be a curve of force or of the level of friction.  A curve of many points follows what is slow in a
    disturbance and beats the true law on the records it is fitted to.  The predictions of several laws that stand in
    for another one are no measure, so against several laws this is not required.  A curve over speed is not tested:
    other records do not reach the speed of the fastest one.  Over time it was not examined.
    """
    if len(laws) > 1 or curve.effects[-1].over not in ("position", "friction"):
        return True
    return left_out_difference(curve, last, last.scan_preparation) < -VERY_STRONG_BIC


def _removes_more(curve: Stage, laws: Stage, before: Stage) -> bool:
    """Tell whether a curve removes clearly more of the error above the noise floor than the laws do."""
    with_laws, with_curve = laws.rmse("identify"), curve.rmse("identify")
    shares = [(with_laws[n] ** 2 - with_curve[n] ** 2) / start for n, start in excess_error(before).items()]
    return max(shares, default=0.0) > POLICY.curve_reduction
