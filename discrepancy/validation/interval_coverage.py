"""Coverage: whether the intervals of a fitted model contain the true values of a virtual machine."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from discrepancy.stages.stage import Stage

__all__ = ["coverage", "true_values"]


def true_values(stage: Stage, truth: Mapping[str, Any]) -> dict[str, float]:
    """Return the true values of the fitted parameters: those of the machine, and the strengths of the hidden effects.

    Parameters
    ----------
    stage : Stage
        With exactly the hidden effects: the parameters of a model that lacks one have no true values.
    truth : mapping
        ``truth.json`` of a virtual machine.
    """
    known = {name: float(entry["value"]) for name, entry in truth.get("perturbed", {}).items()}
    for hidden in truth["effects"]:
        for effect in stage.effects:
            if str(effect) == f"{hidden['kind']}@{hidden['where']}":
                given = hidden["parameters"]
                known |= {effect.parameter_name(k): float(given[k]["value"]) for k in effect.strengths if k in given}
    return known


def coverage(stage: Stage, truth: Mapping[str, Any]) -> tuple[int, tuple[str, ...]]:
    """Return how many 95 % intervals contain the true value, and the parameters whose interval does not.

    Parameters at a bound, or that the records do not excite, have no interval and are left out.
    """
    inside, outside = 0, []
    fitted = stage.identify
    for name, true in true_values(stage, truth).items():
        if name not in {p.name for p in fitted.parameters} or not math.isfinite(fitted.std_of(name)):
            continue
        low, high = fitted.interval(name)
        if low <= true <= high:
            inside += 1
        else:
            outside.append(name)
    return inside, tuple(outside)
