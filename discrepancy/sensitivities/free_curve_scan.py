"""An effect that the catalogue does not have: a free curve over position, speed or time at each connection.

The curve is a force given by points.  Over each regressor its points are one candidate, judged by the same scan as
the laws; the best one is refitted in full simulation, which also removes the shrinkage of a regularised estimate.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.effects.effect import Effect
from discrepancy.effects.kinds import kind_named
from discrepancy.sensitivities.free_curves import free_curve_sensitivities, free_curves
from discrepancy.sensitivities.linearised_problem import LinearisedProblem
from discrepancy.statistics.blocks import Candidate
from estimation.response.perturbation_response import forget
from multibody.base.parallel import side_by_side

if TYPE_CHECKING:
    from discrepancy.stages.stage import Stage
    from discrepancy.statistics.scan import ScanResult
    from discrepancy.statistics.verdicts import Row
    from multibody.assembly.places import Place

__all__ = ["FreeCurveScan", "curve_effect", "free_curve_candidates", "holds", "scan_free_curves"]


@dataclass(frozen=True, eq=False)
class FreeCurveScan:
    """Free curves that the scan found significant, best first.

    Parameters
    ----------
    effects : tuple of Effect
    p_values : tuple of float
        Family-wise over all curves at all places.
    explained : tuple of float
        Predicted share of the residual's energy that each takes away.
    scan : ScanResult
    """

    effects: tuple[Effect, ...]
    p_values: tuple[float, ...]
    explained: tuple[float, ...]
    scan: ScanResult


def free_curve_candidates(facts: LinearisedProblem, places: Sequence[Place]) -> list[Candidate]:
    """Return a candidate for each moving place and each regressor of a free curve."""
    wanted = {p.name for p in places}
    curves = [c for c in free_curves(facts) if c.place.name in wanted]

    def of_record(i: int) -> dict[str, np.ndarray]:
        found = free_curve_sensitivities(facts, i)
        forget(facts.experiments[i])
        return found

    blocks = side_by_side(of_record, range(len(facts.experiments)))
    return [one for c in curves for one in c.candidates([of_one[c.place.name] for of_one in blocks])]


def curve_effect(candidate: Candidate, amplitude: np.ndarray, shape: dict[str, float], stage: Stage) -> Effect:
    """Return a free curve as an effect."""
    kind = kind_named("unknown_force")
    number = 1 + sum(1 for e in stage.effects if e.kind == kind.name and e.where == candidate.where)
    kept = {k: v for k, v in shape.items() if k != "v_s" or candidate.info["over"] == "friction"}
    return Effect.at_place(
        kind.name,
        candidate.info["place"],
        strengths=dict(zip(kind.strengths, map(float, amplitude), strict=True)),
        shape=kept,
        number=number,
        over=candidate.info["over"],
    )


def holds(row: Row) -> bool:
    """Tell whether a free curve is significant and also predicts blocks that were left out of its fit.

    A curve of many points can follow a residual that one or two of a few blocks carry; what it then says of the others
    is worse than nothing.
    """
    from discrepancy.statistics.verdicts import Verdict

    return row.verdict is Verdict.MISSING and row.carries_over


def scan_free_curves(
    stage: Stage,
    facts: LinearisedProblem,
    *,
    level: float,
    seed: int,
    where: Sequence[str] | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> FreeCurveScan:
    """Score free curves on a stage's residual.

    Parameters
    ----------
    stage : Stage
    facts : LinearisedProblem
        Of that stage.
    level, seed
        As for the scan.
    where : sequence of str, optional
        Only these places.
    """
    from discrepancy.statistics.scan import scan

    key = ("curves", facts.preparation, level, seed, tuple(where) if where is not None else None)
    if key in stage.worked_out:
        return stage.worked_out[key]
    places = [p for p in stage.system.places if where is None or p.name in where]
    progress(f"free curves at {len(places)} places")
    candidates = free_curve_candidates(facts, places)
    residual = facts.residual()
    found = scan(
        residual, facts.sensitivities(), candidates,
        level=level, seed=seed, whiten=False, noise_floor=[stage.noise[c] for c in residual.channels],
    )  # fmt: skip
    by_name = {c.name: c for c in candidates}
    rows = sorted((r for r in found.rows if holds(r)), key=lambda r: r.delta_bic)
    effects = tuple(curve_effect(by_name[r.name], np.atleast_1d(r.amplitude), dict(r.shape), stage) for r in rows)
    offer = FreeCurveScan(effects, tuple(r.p for r in rows), tuple(r.error_drop for r in rows), found)
    stage.worked_out[key] = offer
    return offer
