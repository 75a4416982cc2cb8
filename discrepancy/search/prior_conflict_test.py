"""Prior conflict: whether parameters outside their stated uncertainty explain as much as the first effect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.search.model_comparison import bic_difference
from discrepancy.search.policy import POLICY
from discrepancy.stages.prior_conflict import conflict_text, prior_conflicts
from discrepancy.statistics.thresholds import DECISIVE_BIC

if TYPE_CHECKING:
    from discrepancy.problem.problem import Problem
    from discrepancy.stages.stage import Stage
    from estimation.fit.calibration import UncertainParameter

__all__ = ["PriorConflict", "find_prior_conflict"]


@dataclass(frozen=True)
class PriorConflict:
    """Parameters outside their stated uncertainty that explain the residual as well as an effect does.

    Parameters
    ----------
    moved : tuple of (UncertainParameter, float)
        What was stated, and the value that explains the records.
    delta_bic : float
        BIC with these values minus that with the first effect.
    """

    moved: tuple[tuple[UncertainParameter, float], ...]
    delta_bic: float

    def message(self, effect: str) -> str:
        """Return the warning that belongs to an effect."""
        parts = [conflict_text(q, value) for q, value in self.moved]
        better = "better than" if self.delta_bic < -DECISIVE_BIC else "as well as"
        one = len(parts) == 1
        return (
            f"Check before you accept {effect}: {' and '.join(parts)} explain{'s' if one else ''} these records "
            f"{better} the effect does. Check {'that value' if one else 'these values'}, or state a larger uncertainty "
            "and run the study again."
        )


def find_prior_conflict(
    problem: Problem,
    fit: Callable[[tuple[UncertainParameter, ...], Stage], Stage],
    baseline: Stage,
    first: Stage,
) -> PriorConflict | None:
    """Test whether the uncertain parameters, without their stated deviations, explain what an effect explains.

    Parameters
    ----------
    problem : Problem
    fit : callable
        Fits a stage with other priors, given these and the stage.
    baseline : Stage
        Recalibrated, without effects.
    first : Stage
        With the first effect.

    Returns
    -------
    PriorConflict or None
        None where no parameter leaves its uncertainty, or the effect explains more.
    """
    if not any(np.isfinite(q.std) for q in problem.uncertain):
        return None
    wide = tuple(replace(q, std=POLICY.wider_prior * q.std) for q in problem.uncertain)
    try:
        free = fit(wide, baseline)
    except RuntimeError:  # values at which the machine cannot be simulated explain nothing
        return None
    moved = prior_conflicts(free.identify, {q.name: q for q in problem.uncertain})
    difference = bic_difference(free, first)
    if not moved or difference > DECISIVE_BIC:
        return None
    return PriorConflict(moved, float(difference))
