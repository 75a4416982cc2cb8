"""Something is missing and no effect, curve or refit tells what: where the missing force would act, and its course."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discrepancy.questions.unknown_force import UnknownForce, described
from discrepancy.report.conclusion import UnknownCurve
from discrepancy.search.model_comparison import loud
from discrepancy.search.step import LOOKS
from discrepancy.stages.force_estimate import ForceEstimate, estimate_force

if TYPE_CHECKING:
    from discrepancy.questions.force_curves import Explanation
    from discrepancy.study.study import Study

__all__ = ["nameless_force"]

SECOND = 0.1  # level of the question what the force follows; asked only where the omnibus test has rejected; chosen


def nameless_force(study: Study) -> tuple[UnknownCurve, UnknownForce] | None:
    """Return the force that would explain what is left best, and what is known of it.

    The force is estimated over time at every connection at which the sensors determine it, and the connection with the
    largest marginal likelihood is taken.  What disturbs a machine from outside can be estimated as a force as well; one
    that the model lacks follows the motion, beyond luck.

    Parameters
    ----------
    study : Study
        Whose search found nothing, and in which what is left follows the inputs.

    Returns
    -------
    (UnknownCurve, UnknownForce) or None
        None where what is left does not follow the inputs, is near the noise, no force can be determined, or the force
        follows nothing; and where a motion is prescribed.
    """
    stage, follows = study.stages[-1], study.follows
    if study.mode == "inverse":  # its inputs are measured motions, whose noise what is left follows in any case
        return None
    if follows is None or not follows.rejects or not loud(stage):
        return None
    study.progress("the force that is missing, over time, at every connection")
    estimates = [estimate_force(stage, place, explain_all=True) for place in stage.system.places]
    known = [e for e in estimates if e.reconstructable and e.log_likelihood > 0.0]
    if not known:
        return None
    best = max(known, key=lambda e: e.log_likelihood)
    found = described(study, best, level=SECOND)
    follower = found.report.best if found.report is not None else None
    return (_curve(best, found, follower, min(1.0, LOOKS * follows.p)), found) if follower is not None else None


def _curve(estimate: ForceEstimate, found: UnknownForce, explained: Explanation, p_value: float) -> UnknownCurve:
    """Return the force over position or speed, if it follows one of them; else over time in the first record."""
    statement = (
        f"Something is missing. No law and no curve explains it; of all connections a force at {estimate.where} would "
        f"explain most. {found.sentence}"
    )
    figures = {"p_value": p_value, "delta_bic": -2.0 * estimate.log_likelihood}
    if explained.regressor in ("position", "speed") and explained.parity == "even":
        c = explained.curve
        return UnknownCurve(
            estimate.where, explained.regressor, c.unit, estimate.unit, c.grid, c.value, c.std, statement, **figures
        )
    first = estimate.record == 0
    return UnknownCurve(
        estimate.where, "time", "s", estimate.unit, estimate.time[first] - estimate.time[first][0],
        np.asarray(estimate.force[first]), np.asarray(estimate.std[first]), statement, **figures,
    )  # fmt: skip
