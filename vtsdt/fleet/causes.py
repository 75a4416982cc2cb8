"""What a change of a lift's guides means: rails that settle, a shoe that wears, lubrication, a sensor that drifts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from operation.statistics.patterns import Cause, Explanation, explain_change
from operation.store.judgement import Judgement
from vtsdt.files.parameters import LiftParameters
from vtsdt.fleet.visit import DEVIATIONS, SECTIONS, TENSION

__all__ = ["LUBRICATION", "SENSOR", "WEAR", "lift_causes", "name_change", "settled"]

WEAR, LUBRICATION, SENSOR = "shoes worn", "guides lubricated", "tension sensor drifts"
#: Usual amounts: a rail that settles and a shoe that wears by half a millimetre, friction that changes by a third, a
#: tension sensor that drifts by 5 N.  A factor of two in them changes few names.
RAIL, PLAY, FRICTION, TENSION_SIZE = 0.5e-3, 0.5e-3, 0.33, 5.0
#: Share of the variance between visits that the covariance of few visits is pulled towards a diagonal one.
SHRINKAGE = 0.2


def settled(section: str) -> str:
    """Return the name of a rail that has settled in a third of the travel."""
    return f"rails settled, {section} third"


def lift_causes(before: np.ndarray, lift: LiftParameters | None = None) -> dict[str, Cause]:
    """Return what each cause does to the deviation of the three thirds and to the tension error.

    The deviation δ follows from friction, 2 μ K (δ − play).  So a shoe with more play lowers δ everywhere by the same,
    less friction lowers it in proportion to δ − play, and a rail that settles raises it where it does.

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
    causes[WEAR] = Cause(pattern=np.concatenate([-np.ones(3), none]), size=PLAY, sign=1, unit="m")
    causes[LUBRICATION] = Cause(pattern=np.concatenate([-pressing, none]), size=FRICTION, sign=1, unit="")
    causes[SENSOR] = Cause(pattern=np.array([0.0, 0.0, 0.0, 1.0]), size=TENSION_SIZE, unit="N")
    return causes


def name_change(
    judgements: Sequence[Judgement], since: float, lift: LiftParameters | None = None
) -> tuple[Explanation, ...]:
    """Return what a change means, the most probable cause first; empty where too few visits are known.

    Parameters
    ----------
    judgements : sequence of Judgement
        Visits, in any order.
    since : float, s
        Change point.
    lift : LiftParameters, optional
    """
    ordered = sorted((j for j in judgements if TENSION in j.quantities), key=lambda j: j.at)
    rows = np.array([[j.quantities[n].value for n in (*DEVIATIONS, TENSION)] for j in ordered])
    after = np.array([j.at >= since for j in ordered])
    if np.count_nonzero(~after) < 4 or not np.any(after):
        return ()
    old, new = rows[~after], rows[after]
    spread = np.cov(old.T)
    spread = (1.0 - SHRINKAGE) * spread + SHRINKAGE * np.diag(np.diag(spread))
    covariance = spread * (1.0 / len(old) + 1.0 / len(new)) + 1e-12 * np.diag([1e-3, 1e-3, 1e-3, 1.0]) ** 2
    change = new.mean(axis=0) - old.mean(axis=0)
    usual = np.array([RAIL, RAIL, RAIL, TENSION_SIZE])
    return explain_change(change, covariance, lift_causes(old[:, :3].mean(axis=0), lift), usual)
