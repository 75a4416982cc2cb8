"""Parameters that may be wrong beyond their stated uncertainty: asked before an effect is believed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.search.model_comparison import bic_difference
from discrepancy.stages.prior_conflict import conflict_text, prior_conflicts
from discrepancy.statistics.thresholds import DECISIVE_BIC

if TYPE_CHECKING:
    from discrepancy.stages.stage import Stage
    from discrepancy.study.study import Study
    from estimation.fit.calibration import UncertainParameter

__all__ = ["Beyond", "beyond_priors"]

WIDER = 1000.0  # by which the stated deviations are multiplied: hardly any pull is left


@dataclass(frozen=True)
class Beyond:
    """Parameters outside their stated uncertainty that explain the residual as well as an effect does.

    Parameters
    ----------
    moved : tuple of (UncertainParameter, float)
        What was stated, and the value that explains the records.
    delta_bic : float
        BIC with these values minus that with the first effect found.
    """

    moved: tuple[tuple[UncertainParameter, float], ...]
    delta_bic: float

    def told(self, effect: str) -> str:
        """Say it in a sentence or two."""
        parts = [conflict_text(q, value) for q, value in self.moved]
        better = "better than" if self.delta_bic < -DECISIVE_BIC else "as well as"
        return (
            f"Before {effect} is believed: {' and '.join(parts)} explain{'s' if len(parts) == 1 else ''} these records "
            f"{better} the effect does. Check {'that value' if len(parts) == 1 else 'these values'}, or state a "
            "larger uncertainty and ask again."
        )


def beyond_priors(study: Study, baseline: Stage, found: Stage) -> Beyond | None:
    """Ask whether the uncertain parameters, freed of their stated deviations, explain what an effect explains.

    Parameters
    ----------
    study : Study
    baseline : Stage
        Recalibrated, without effects.
    found : Stage
        With the first effect.

    Returns
    -------
    Beyond or None
        None where no parameter has to leave its uncertainty, or the effect explains more.
    """
    if not any(np.isfinite(q.std) for q in study.problem.uncertain):
        return None
    wide = tuple(replace(q, std=WIDER * q.std) for q in study.problem.uncertain)
    try:
        free = study.with_uncertain(wide, baseline)
    except RuntimeError:  # values at which the machine cannot be simulated explain nothing
        return None
    moved = prior_conflicts(free.identify, {q.name: q for q in study.problem.uncertain})
    difference = bic_difference(free, found)
    if not moved or difference > DECISIVE_BIC:
        return None
    return Beyond(moved, float(difference))
