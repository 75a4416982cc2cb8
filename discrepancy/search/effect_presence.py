"""Whether an effect that takes no error away is there at all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.search.model_comparison import matters
from discrepancy.search.step import Step

if TYPE_CHECKING:
    from discrepancy.stages.stage import Stage

__all__ = ["standing"]

KNOWN = 2.0  # standard deviations of the full fit from which a strength is known to be there


def standing(step: Step, stage: Stage, fit: Callable[[Stage], Stage]) -> Step:
    """Return a step without its effect, where that takes no error away and the full fit does not know its strength.

    An effect that calibration replaces with parameters outside their stated uncertainty is believed for their sake.  A
    model that is wrong in another way pulls parameters outside as well, and what brings them back is then known badly:
    intervals hold for what the residual looks like.

    Parameters
    ----------
    step : Step
    stage : Stage
        That the step begins from.
    fit : callable
        Fits a trial's stage fully.
    """
    if step.accepted is None or step.stage is None or matters(step.stage, stage):
        return step
    effect = step.accepted.effect
    fitted = fit(step.stage).identify
    known = {q.name: float(s) for q, s in zip(fitted.parameters, fitted.std, strict=True)}
    for name in map(effect.parameter_name, effect.strengths):
        if np.isfinite(known[name]) and abs(fitted[name]) > KNOWN * known[name]:
            return step
    return replace(step, accepted=None, stage=None)
