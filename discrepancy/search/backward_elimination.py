"""After the search: does every effect still earn its place, and would a free curve tell the truth better?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from discrepancy.effects.effect import Effect
from discrepancy.search.curve_gain import promised
from discrepancy.search.model_comparison import CLEARLY, above_floor, bic_difference, matters, taken
from discrepancy.search.record_left_out import left_out_difference
from discrepancy.search.step import LOOKS
from discrepancy.search.trial_fits import Fit, tried
from discrepancy.sensitivities.free_curve_scan import FreeCurveScan
from discrepancy.stages.stage import AcceptedEffect, RivalExplanation, Stage

__all__ = ["curve_instead", "drop_idle", "free_curve", "lasts", "replace_by_curve"]

BENT = 3.0  # times what the linear model promises that a refit may take away: up to 2.8 seen (docs/method/which-law.md)
SHARE = 0.03  # a curve must take this share more of the error away before a law is given up for it; chosen
REPEATS = 2.0  # periods within the motion from which a wave is seen to repeat; chosen
AS_MUCH = 0.9  # share of what several waves take away that a curve in their place must take; chosen


def drop_idle(stages: Sequence[Stage], fit: Fit, progress: Callable[[str], None]) -> tuple[Stage, Effect] | None:
    """Return the last stage without an effect that later ones made idle, and that effect; None when all are needed."""
    last = stages[-1]
    if len(last.effects) < 2:
        return None
    for k, effect in enumerate(last.effects[:-1]):
        rest = tuple(e for j, e in enumerate(last.effects) if j != k)
        progress(f"is {effect} still needed?")
        try:
            without = fit(last.name, rest, last)
        except RuntimeError as error:  # it keeps the machine where its inputs put it: it is needed
            progress(f"without {effect} the machine could not be simulated: {error}")
            continue
        if bic_difference(last, without) > 0.0:
            return without, effect
    return None


def free_curve(stage: Stage, fit: Fit, *, level: float, seed: int, progress: Callable[[str], None]) -> Stage | None:
    """Add the best free curve to a stage in which no law of the catalogue is left, if it is significant."""
    offer = _offered(stage, level / LOOKS, seed, progress)
    return _best_curve(stage, stage, offer.effects, offer.p_values, fit, progress)


def replace_by_curve(
    stages: Sequence[Stage],
    fit: Fit,
    *,
    level: float,
    seed: int,
    progress: Callable[[str], None],
    last_word: bool = True,
) -> tuple[int, Stage] | None:
    """Try to put one free curve in the place of all laws found at a connection.

    A law that is only near the truth leaves a pattern behind that further laws then chase.  Where one curve beats the
    law found at its connection by strong evidence, takes clearly more of the error away and clearly says more of
    records left out, the honest answer is the curve; against several laws at one connection it is enough that the curve
    is the better model.  While the search goes on (without ``last_word``) it is not enough: the next law may be what
    they lack.  Against one law only curves are fitted of which that can be expected (`discrepancy.search.curve_gain`).

    Returns
    -------
    (int, Stage) or None
        How many stages remain before the new one, and the new stage.
    """
    last = stages[-1]
    found = [e for e in last.effects if e.definition.at == "connection" and not e.definition.free_form]
    for where in dict.fromkeys(e.where for e in found):
        first = min(k for k, s in enumerate(stages) if any(e.where == where for e in s.effects))
        before = stages[first - 1]
        new = _since(before, last)
        if any(e.where != where for e in new):
            continue  # effects at several connections: a curve at one of them is no simpler story
        several = last_word and len(new) > 1
        promise = None if several else _promise(before, last, where)
        if promise or several or _waves(new):
            offer = _offered(before, level, seed, progress, [where])
        else:
            continue
        least = 0.0 if several else CLEARLY
        curve = _best_curve(before, last, *_two_of(offer, promise), fit, progress, least)
        if curve is not None and (several or (_takes_more(curve, last, before) and lasts(curve, last, new))):
            return first, curve
        curve = _instead_of_waves(before, last, new, offer, fit, progress)
        if curve is not None:
            return first, curve
    return None


def curve_instead(
    stages: Sequence[Stage], fit: Fit, *, level: float, seed: int, progress: Callable[[str], None]
) -> tuple[int, Stage] | None:
    """Try to put one free curve, at any connection, in the place of everything that was found.

    A force that no law describes can look like a drift of a sensor or like laws at several connections.

    Returns
    -------
    (int, Stage) or None
        As `replace_by_curve`, which asks about each connection by itself.
    """
    first = min(k for k, s in enumerate(stages) if s.accepted is not None)
    before, last = stages[first - 1], stages[-1]
    new = _since(before, last)
    if not new or any(e.definition.free_form for e in new):
        return None
    promise = _promise(before, last)
    if not promise:
        return None
    offer = _offered(before, level, seed, progress)
    curve = _best_curve(before, last, *_two_of(offer, promise), fit, progress)
    if curve is None or not _takes_more(curve, last, before):
        return None
    here = {e.where for e in new} == {curve.effects[-1].where}  # as `replace_by_curve` asks
    return (first, curve) if not here or lasts(curve, last, new) else None


def _since(before: Stage, last: Stage) -> list[Effect]:
    """Return the effects that came after a stage; those that it had are fitted anew since."""
    had = {e.component_name for e in before.effects}
    return [e for e in last.effects if e.component_name not in had]


def _offered(
    before: Stage, level: float, seed: int, progress: Callable[[str], None], where: Sequence[str] | None = None
) -> FreeCurveScan:
    return before.free_curve_scan(level=level, seed=seed, where=where, progress=progress)


def _promise(before: Stage, last: Stage, where: str | None = None) -> set[tuple[str, str]]:
    """Return place and regressor of the curves that may take clearly more of the error away than what was found."""
    shares = promised(before, last)
    return {curve for curve, share in shares.items() if BENT * share > SHARE and where in (None, curve[0])}


def _two_of(offer: FreeCurveScan, promise: set[tuple[str, str]] | None) -> tuple[list[Effect], list[float]]:
    """Return the two best curves of an offer, with their p-values; of these only the promising ones, if asked."""
    two = list(zip(offer.effects, offer.p_values, strict=True))[:2]
    kept = [(e, p) for e, p in two if promise is None or (e.where, e.over) in promise]
    return [e for e, _ in kept], [p for _, p in kept]


def _waves(laws: Sequence[Effect]) -> bool:
    return len(laws) > 1 and all(e.kind == "angle_harmonic" for e in laws)


def _instead_of_waves(
    before: Stage, last: Stage, waves: Sequence[Effect], offer: FreeCurveScan, fit: Fit, progress: Callable[[str], None]
) -> Stage | None:
    """Return a curve over position in the place of several waves that do not repeat, if it does as much.

    Waves along the way can add up to any curve.  Where one of them passes fewer than twice through its period, nothing
    shows that it repeats, and the curve is what is known.
    """
    if not _waves(waves):
        return None
    k = next((k for k, e in enumerate(offer.effects) if e.over == "position"), None)
    if k is None:
        return None
    curve = offer.effects[k]
    way = curve.shape["high"] - curve.shape["low"]
    if min(abs(e.shape["order"]) for e in waves) * way / (2.0 * np.pi) >= REPEATS:
        return None
    found = _best_curve(before, last, [curve], offer.p_values[k:], fit, progress, least=-np.inf)
    return found if found is not None and taken(found, before) >= AS_MUCH * taken(last, before) else None


def _best_curve(
    before: Stage,
    rival: Stage,
    effects: Sequence[Effect],
    p_values: Sequence[float],
    fit: Fit,
    progress: Callable[[str], None],
    least: float = CLEARLY,
) -> Stage | None:
    """Refit the offered curves and return the best that matters if its BIC is below that of ``rival`` by ``least``."""
    found = []
    for effect, p in list(zip(effects, p_values, strict=False))[:2]:
        progress(f"refit with a free curve over {effect.over} at {effect.where}")
        stage = tried(fit, f"+ {effect} over {effect.over}", (*before.effects, effect), before, progress)
        if stage is not None and matters(stage, before):  # as is asked of a law
            found.append((bic_difference(stage, rival), stage, p))
    found.sort(key=lambda t: t[0])
    if not found or found[0][0] > -least:
        return None
    difference, stage, p = found[0]
    rivals = tuple(
        RivalExplanation(
            kind=t[1].effects[-1].kind + f" over {t[1].effects[-1].over}",
            where=t[1].effects[-1].where,
            delta_bic=t[0] - difference,
            refitted=True,
            indistinguishable=t[0] - difference < CLEARLY,
        )
        for t in found[1:]
    )
    return replace(
        stage,
        accepted=AcceptedEffect(
            effect=stage.effects[-1], p_value=p, delta_bic=bic_difference(stage, before), rivals=rivals
        ),
    )


def lasts(curve: Stage, last: Stage, laws: Sequence[Effect]) -> bool:
    """Tell whether a curve over position clearly says more than one law of records that both were not fitted to.

    It may be one of force or of the level of friction.  A curve of many points follows what is slow in a disturbance
    and beats the true law on the records it is fitted to.  Where several laws stand in for what none of them is, their
    own predictions are worth little to compare with.  Of a curve over speed the others do not know what the fastest
    record reaches: it is not asked this.  Over time it was not tried.
    """
    if len(laws) > 1 or curve.effects[-1].over not in ("position", "friction"):
        return True
    return left_out_difference(curve, last, last.scan_preparation) < -CLEARLY


def _takes_more(curve: Stage, laws: Stage, before: Stage) -> bool:
    """Tell whether a curve removes clearly more of the error above the noise floor than the laws do."""
    with_laws, with_curve = laws.rmse("identify"), curve.rmse("identify")
    shares = [(with_laws[n] ** 2 - with_curve[n] ** 2) / start for n, start in above_floor(before).items()]
    return max(shares, default=0.0) > SHARE
