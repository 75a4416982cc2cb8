"""An effect that the catalogue does not have: free curves over position, speed or time at each connection, scored.

The curve is a force given by points.  Over each argument its points are one candidate, scored by the same scan as the
laws; the best one is refitted in full simulation, which also removes the shrinkage of a regularised estimate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.effects.effect import Effect
from discrepancy.effects.kinds import kind_named
from discrepancy.sensitivities.linearised_problem import LinearisedProblem
from discrepancy.statistics.blocks import Array, Candidate
from discrepancy.statistics.projection import Projection
from discrepancy.statistics.scan import scan
from discrepancy.statistics.verdicts import Verdict
from discrepancy.statistics.whitened import rms_projection
from estimation.signals.correlation import correlation_time
from multibody.base.parallel import parallel_map

if TYPE_CHECKING:
    from discrepancy.statistics.scan_result import ScanResult, ScanRow
    from multibody.assembly.places import Place

__all__ = [
    "FreeCurveScan",
    "free_curve",
    "free_curve_candidates",
    "free_curve_error_drops",
    "scan_free_curves",
    "significant_and_predictive",
]


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


def free_curve_candidates(linearised: LinearisedProblem, places: Sequence[Place]) -> list[Candidate]:
    """Return a candidate for each moving place and each argument of a free curve."""
    wanted = {p.name for p in places}
    curves = [c for c in linearised.free_curves() if c.place.name in wanted]

    def of_record(i: int) -> dict[str, list[int]]:
        numbers = linearised.free_curve_sensitivities(i)
        linearised.experiments[i].trim_cache()
        return numbers

    numbers = parallel_map(of_record, range(len(linearised.experiments)))
    return [one for c in curves for one in c.candidates(linearised.store, [of_one[c.place.name] for of_one in numbers])]


def significant_and_predictive(row: ScanRow) -> bool:
    """Tell whether a free curve is significant and also predicts blocks that were left out of its fit.

    A curve of many points can follow a residual that one or two of a few blocks carry; its prediction of the others is
    then worse than none.
    """
    return row.verdict is Verdict.MISSING and row.carries_over


def scan_free_curves(
    linearised: LinearisedProblem,
    effects: Sequence[Effect],
    *,
    level: float,
    seed: int,
    where: Sequence[str] | None = None,
) -> FreeCurveScan:
    """Score free curves on a residual.

    Parameters
    ----------
    linearised : LinearisedProblem
    effects : sequence of Effect
        Effects that the model already has: a second curve at the same place gets a number.
    level, seed
        As for the scan.
    where : sequence of str, optional
        Only these places.
    """
    places = [p for p in linearised.system.places if where is None or p.name in where]
    candidates = free_curve_candidates(linearised, places)
    residual = linearised.residual()
    result = scan(
        residual,
        linearised.sensitivities(),
        candidates,
        level=level,
        seed=seed,
        whiten=False,
        noise_floor=[linearised.noise[c] for c in residual.channels],
    )
    by_name = {c.name: c for c in candidates}
    rows = sorted((r for r in result.rows if significant_and_predictive(r)), key=lambda r: r.delta_bic)
    significant = [(by_name[r.name].info, np.atleast_1d(r.expected_strength), dict(r.shape)) for r in rows]
    curves = tuple(_effect(info["place"], info["over"], height, shape, effects) for info, height, shape in significant)
    return FreeCurveScan(curves, tuple(r.p_value for r in rows), tuple(r.error_reduction for r in rows), result)


def free_curve(
    linearised: LinearisedProblem, effects: Sequence[Effect], where: str, over: str, *, level: float, seed: int
) -> Effect:
    """Return the free curve at a place over an argument at its expected height, significant or not.

    Parameters
    ----------
    linearised, effects, level, seed
        As of `scan_free_curves`.
    where : str
        Place.
    over : str
        ``"position"``, ``"speed"``, ``"time"`` or ``"friction"``.

    Raises
    ------
    KeyError
        If there is no such curve: the place is unknown or stands still, or the argument does not change.
    """
    result = scan_free_curves(linearised, effects, level=level, seed=seed, where=[where]).scan
    places = {p.name: p for p in linearised.system.places}
    rows = {r.kind.removeprefix("unknown_force over "): r for r in result.rows}
    if where not in places or over not in rows:
        known = f"its arguments are {', '.join(sorted(rows))}" if rows else "no such place, or nothing moves there"
        raise KeyError(f"there is no free curve over '{over}' at '{where}': {known}")
    row = rows[over]
    return _effect(places[where], over, np.atleast_1d(row.expected_strength), dict(row.shape), effects)


def _effect(
    place: Place, over: str, amplitude: np.ndarray, shape: dict[str, float], effects: Sequence[Effect]
) -> Effect:
    """Return a free curve as an effect."""
    kind = kind_named("unknown_force")
    number = 1 + sum(1 for e in effects if e.kind == kind.name and e.where == place.name)
    return Effect.at_place(
        kind.name,
        place,
        strengths=dict(zip(kind.strengths, map(float, amplitude), strict=True)),
        shape={k: v for k, v in shape.items() if k != "v_s" or over == "friction"},
        number=number,
        over=over,
    )


def free_curve_error_drops(linearised: LinearisedProblem) -> dict[tuple[str, str], Array]:
    """Return the share of each output's residual energy that every free curve would take away, by place and argument.

    Computed by one projection in the linearised problem; a refit in full simulation costs seconds.
    """
    residual = linearised.residual()
    projection = rms_projection(residual, linearised.sensitivities())
    e = projection.remove(projection.layout.stack(projection.whitener, residual.blocks))
    return {
        (c.where, str(c.info["over"])): _error_drop(projection, e, e - _fitted(c, projection, e), c.n_strengths)
        for c in free_curve_candidates(linearised, linearised.system.places)
    }


def _error_drop(projection: Projection, before: Array, after: Array, points: int) -> Array:
    """Return the share of each channel's energy that a fit takes away beyond what it takes of mere noise.

    Of noise with the memory of the remaining residual, a fit of k points takes k of the effective number of samples.
    """
    blocks = range(len(projection.layout.lengths))
    shares = []
    for c in range(projection.layout.n_channels):
        b, a = ([projection.layout.view(e, k)[:, c] for k in blocks] for e in (before, after))
        left = sum(float(x @ x) for x in a) / max(sum(float(x @ x) for x in b), 1e-300)
        count = sum(x.size / correlation_time(x) for x in a)
        shares.append(1.0 - left * (1.0 + points / count))
    return np.array(shares)


def _fitted(candidate: Candidate, projection: Projection, e: Array) -> Array:
    """Return the part of a projected residual that a candidate can follow, however dependent its sensitivities are."""
    columns = projection.remove(projection.layout.stack(projection.whitener, candidate.sensitivities[0]))
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 0.0] / size[size > 0.0]
    out: Array = columns @ np.linalg.lstsq(columns, e, rcond=1e-10)[0]
    return out
