"""After the search: does every effect still earn its place, and would a free curve tell the truth better?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from discrepancy.confrontation import Confrontation
from discrepancy.effects import Effect
from discrepancy.search import LOOKS, scan_preparation
from discrepancy.stage import Accepted, Rival, Stage
from discrepancy.unknown import offer_curves
from discrepancy.worth import bic_difference
from multibody.errors import ModelError

__all__ = ["drop_idle", "free_curve", "replace_by_curve"]

CLEARLY = 10.0  # difference of BIC that counts as strong evidence (Kass and Raftery 1995)
SHARE = 0.1  # a curve must take this share more of the error away before a law is given up for it

Fit = Callable[[str, tuple[Effect, ...], Stage], Stage]


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
    facts = Confrontation.of_stage(stage, scan_preparation(stage))
    offer = offer_curves(stage, facts, level=level / LOOKS, seed=seed, progress=progress)
    return _best_curve(stage, stage, offer.effects, offer.p_values, fit, progress)


def replace_by_curve(
    stages: Sequence[Stage], fit: Fit, *, level: float, seed: int, progress: Callable[[str], None]
) -> tuple[int, Stage] | None:
    """Try to put one free curve in the place of all laws found at a connection.

    A law that is only near the truth leaves a pattern behind that further laws then chase.  Where one curve beats the
    law found at its connection by strong evidence, and takes clearly more of the error away, the honest answer is the
    curve; against several laws at one connection it is enough that the curve is the better model.

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
        others = [e for e in last.effects if e not in before.effects and e.where != where]
        if others:
            continue  # effects at several connections: a curve at one of them is no simpler story
        facts = Confrontation.of_stage(before, scan_preparation(before))
        offer = offer_curves(before, facts, level=level, seed=seed, where=[where], progress=progress)
        several = sum(1 for e in found if e.where == where) > 1
        least = 0.0 if several else CLEARLY
        curve = _best_curve(before, last, offer.effects[:2], offer.p_values, fit, progress, least)
        if curve is not None and (several or _takes_more(curve, last, before)):
            return first, curve
    return None


def _best_curve(
    before: Stage,
    rival: Stage,
    effects: Sequence[Effect],
    p_values: Sequence[float],
    fit: Fit,
    progress: Callable[[str], None],
    least: float = CLEARLY,
) -> Stage | None:
    """Refit the offered curves and return the best if its BIC is below that of ``rival`` by ``least``."""
    tried = []
    for effect, p in list(zip(effects, p_values, strict=False))[:2]:
        progress(f"refit with a free curve over {effect.over} at {effect.where}")
        try:
            stage = fit(f"+ {effect} over {effect.over}", (*before.effects, effect), before)
        except (RuntimeError, ModelError) as error:
            progress(f"{effect} could not be simulated: {error}")
            continue
        tried.append((bic_difference(stage, rival), stage, p))
    tried.sort(key=lambda t: t[0])
    if not tried or tried[0][0] > -least:
        return None
    difference, stage, p = tried[0]
    rivals = tuple(
        Rival(
            t[1].effects[-1].kind + f" over {t[1].effects[-1].over}",
            t[1].effects[-1].where,
            t[0] - difference,
            True,
            t[0] - difference < CLEARLY,
        )
        for t in tried[1:]
    )
    return replace(stage, accepted=Accepted(stage.effects[-1], p, bic_difference(stage, before), rivals))


def _takes_more(curve: Stage, laws: Stage, before: Stage) -> bool:
    """Tell whether a curve removes clearly more of the error above the noise floor than the laws do."""
    shares = []
    for name in curve.outputs:
        floor = curve.noise.get(name, 0.0) ** 2
        start = before.rmse("identify")[name] ** 2 - floor
        if start <= 0.0:
            continue
        shares.append((laws.rmse("identify")[name] ** 2 - curve.rmse("identify")[name] ** 2) / start)
    return bool(shares) and float(np.max(shares)) > SHARE
