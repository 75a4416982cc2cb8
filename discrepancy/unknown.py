"""An effect that the catalogue does not have: a free curve over position, speed or time at each connection.

The curve is a force given by points.  Over each regressor its points are one candidate, judged by the same scan as
the laws; the best one is refitted in full simulation, which also removes the shrinkage of a regularised estimate.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.blocks import Candidate
from discrepancy.confrontation import Confrontation
from discrepancy.effect_laws import CURVE_OVER, CURVE_POINTS
from discrepancy.effects import Effect
from discrepancy.kinds import kind_named
from discrepancy.law_force import MOTION
from estimation.experiment import Push
from estimation.push_response import forget

if TYPE_CHECKING:
    from discrepancy.scan import ScanResult
    from discrepancy.stage import Stage
    from discrepancy.verdict import Row
    from multibody.places import Place

__all__ = ["CurveOffer", "curve_candidates", "curve_effect", "holds", "offer_curves"]


#: Log-likelihood that a curve must gain on blocks left out: what tells two explanations apart elsewhere.
HELD_OUT = 3.0


@dataclass(frozen=True, eq=False)
class CurveOffer:
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


def _tents(x: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return piecewise linear basis functions over evenly spaced points, shape (nt, CURVE_POINTS)."""
    s = np.clip((x - low) / (high - low), 0.0, 1.0) * (CURVE_POINTS - 1)
    return np.maximum(0.0, 1.0 - np.abs(s[:, None] - np.arange(CURVE_POINTS)))


def _argument(over: str, motion: dict[str, np.ndarray], time: np.ndarray) -> np.ndarray:
    return {
        "position": motion["position"],
        "friction": motion["position"],
        "speed": motion["velocity"],
        "time": time,
    }[over]


def curve_candidates(facts: Confrontation, places: Sequence[Place]) -> list[Candidate]:
    """Return a candidate for each moving place and each regressor of a free curve."""
    found = []
    runs = [facts.motions(i) for i in range(len(facts.experiments))]
    for place in places:
        names = [n for n, _ in place.motion_names()]
        motions = [
            {
                g: run[f"place.{place.name}.{n}"]
                for g, n in zip(MOTION, names, strict=True)
                if f"place.{place.name}.{n}" in run
            }
            for run in runs
        ]
        v_s = max(0.01 * float(np.quantile(np.abs(np.concatenate([m["velocity"] for m in motions])), 0.95)), 1e-12)
        curves = []
        for over in CURVE_OVER:
            arguments = [
                _argument(over, m, np.array(e.record.time)) for m, e in zip(motions, facts.experiments, strict=True)
            ]
            low, high = min(a.min() for a in arguments), max(a.max() for a in arguments)
            if high - low >= 1e-9:
                curves.append((over, low, high, arguments))
        blocks: list[list[np.ndarray]] = [[] for _ in curves]
        for i, experiment in enumerate(facts.experiments):
            pushes = []
            for over, low, high, arguments in curves:
                basis = _tents(arguments[i], low, high)
                if over == "friction":
                    basis = -basis * np.tanh(motions[i]["velocity"] / v_s)[:, None]
                pushes += [Push(f"probe.{place.name}", basis[:, k]) for k in range(CURVE_POINTS)]
            found_here = experiment.respond(facts.slim, facts.p, facts.start(i), pushes=pushes, sensors=facts.sensors)
            dy = found_here.derivatives
            forget(experiment)
            for k, mine in enumerate(blocks):
                mine.append(facts.shaped(i, dy[:, :, k * CURVE_POINTS : (k + 1) * CURVE_POINTS]))
        for (over, low, high, _), mine in zip(curves, blocks, strict=True):
            found.append(
                Candidate(
                    f"unknown_force over {over}",
                    place.name,
                    (tuple(mine),),
                    ({"low": float(low), "high": float(high), "v_s": v_s},),
                    amplitudes=tuple(f"curve.y[{k}]" for k in range(CURVE_POINTS)),
                    info={"place": place, "over": over},
                )
            )
    return found


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
    from discrepancy.verdict import Verdict

    return row.verdict is Verdict.MISSING and row.held_out_gain > HELD_OUT


def offer_curves(
    stage: Stage,
    facts: Confrontation,
    *,
    level: float,
    seed: int,
    where: Sequence[str] | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> CurveOffer:
    """Score free curves on a stage's residual.

    Parameters
    ----------
    stage : Stage
    facts : Confrontation
        Of that stage.
    level, seed
        As for the scan.
    where : sequence of str, optional
        Only these places.
    """
    from discrepancy.scan import scan
    from discrepancy.whitening import identity

    key = ("curves", facts.preparation, level, seed, tuple(where) if where is not None else None)
    if key in stage.worked_out:
        return stage.worked_out[key]
    places = [p for p in stage.system.places if where is None or p.name in where]
    progress(f"free curves at {len(places)} places")
    candidates = curve_candidates(facts, places)
    residual = facts.residual()
    sizes = np.maximum(np.sqrt(np.mean(np.concatenate(residual.blocks) ** 2, axis=0)), 1e-300)
    found = scan(
        residual,
        facts.sensitivities(),
        candidates,
        level=level,
        seed=seed,
        whitener=identity(list(sizes), residual.channels, residual.dt),
        noise_floor=[stage.noise[c] for c in residual.channels],
    )
    by_name = {c.name: c for c in candidates}
    rows = sorted((r for r in found.rows if holds(r)), key=lambda r: r.delta_bic)
    effects = tuple(curve_effect(by_name[r.name], np.atleast_1d(r.amplitude), dict(r.shape), stage) for r in rows)
    offer = CurveOffer(effects, tuple(r.p for r in rows), tuple(r.error_drop for r in rows), found)
    stage.worked_out[key] = offer
    return offer
