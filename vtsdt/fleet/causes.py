"""What a change of a lift's guides means: rails that settle, a shoe that wears, lubrication, a sensor that drifts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from operation.statistics.patterns import Cause, Explanation, explain_courses
from operation.store.judgement import Judgement
from vtsdt.files.parameters import LiftParameters
from vtsdt.fleet.visit import DEVIATIONS, SECTIONS, TENSION

__all__ = ["LUBRICATION", "SENSOR", "WEAR", "lift_causes", "name_change", "settled"]

WEAR, LUBRICATION, SENSOR = "shoes worn", "guides lubricated", "tension sensor drifts"
#: Usual amounts: a rail that settles and a shoe whose wear lowers the deviation by half a millimetre, friction that
#: changes by a third, a tension sensor that drifts by 5 N.  A factor of two in them changes few names.
RAIL, PLAY, FRICTION, TENSION_SIZE = 0.5e-3, 0.5e-3, 0.33, 5.0
#: Share of the variance between visits that the covariance of few visits is pulled towards a diagonal one.
SHRINKAGE = 0.2
#: Share of the largest change by which the patterns below may be wrong: rails press in two directions, a cabin leans.
PATTERN_ERROR = 0.15
#: What comes at once; the others grow.
AT_ONCE = (LUBRICATION,)
#: Visits before and after a change from which it is named.
FEWEST_BEFORE, FEWEST_AFTER = 4, 2


def settled(section: str) -> str:
    """Return the name of a rail that has settled in a third of the travel."""
    return f"rails settled, {section} third"


def lift_causes(before: np.ndarray, lift: LiftParameters | None = None) -> dict[str, Cause]:
    """Return what each cause does to the deviation of the three thirds and to the tension error.

    The deviation δ follows from friction, 2 μ K (δ − play), so less friction lowers it in proportion to δ − play.  A
    worn shoe presses less, and least changes where it hardly presses: nearly the same pattern, so that the two are told
    apart by time, because lubrication comes at once.  A rail that settles raises δ where it does.

    Parameters
    ----------
    before : ndarray, shape (3,), m
        Deviation of the thirds before the change.
    lift : LiftParameters, optional
    """
    lift = lift or LiftParameters.bench()
    pressing = np.maximum(before - 2.0 * lift.cabin_guide.clearance, 0.0)
    none = np.zeros(1)
    causes = {
        settled(s): Cause(pattern=np.concatenate([np.eye(3)[k], none]), size=RAIL, unit="m")
        for k, s in enumerate(SECTIONS)
    }
    worn = -pressing / max(float(pressing.mean()), 1e-9)
    causes[WEAR] = Cause(pattern=np.concatenate([worn, none]), size=PLAY, sign=1, unit="m")
    causes[LUBRICATION] = Cause(pattern=np.concatenate([-pressing, none]), size=FRICTION, sign=1, unit="")
    causes[SENSOR] = Cause(pattern=np.array([0.0, 0.0, 0.0, 1.0]), size=TENSION_SIZE, unit="N")
    return causes


def name_change(
    judgements: Sequence[Judgement], since: float, lift: LiftParameters | None = None
) -> tuple[Explanation, ...]:
    """Return what a change means, the most probable cause first; empty where too few visits are known.

    Each cause is a change of all quantities along its pattern that comes at once or grows from the change point on.

    Parameters
    ----------
    judgements : sequence of Judgement
        Visits, in any order.
    since : float, s
        Change point.
    lift : LiftParameters, optional
    """
    ordered = sorted((j for j in judgements if TENSION in j.quantities), key=lambda j: j.at)
    times = np.array([j.at for j in ordered])
    rows = np.array([[j.quantities[n].value for n in (*DEVIATIONS, TENSION)] for j in ordered])
    after = times >= since
    if np.count_nonzero(~after) < FEWEST_BEFORE or np.count_nonzero(after) < FEWEST_AFTER:
        return ()
    begin = 0.5 * (times[~after][-1] + times[after][0])
    courses = {
        "at once": after.astype(float),
        "growing": np.clip((times - begin) / max(times[-1] - begin, 1.0), 0.0, None),
    }
    causes = lift_causes(rows[~after][:, :3].mean(axis=0), lift)
    given = {course: {n: c for n, c in causes.items() if (n in AT_ONCE) == (course == "at once")} for course in courses}
    return explain_courses(rows, courses, given, np.array([RAIL, RAIL, RAIL, TENSION_SIZE]), PATTERN_ERROR, SHRINKAGE)
