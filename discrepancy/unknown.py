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
from estimation.push_response import forget, response_of, worth_it
from multibody.side_by_side import side_by_side

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


@dataclass(frozen=True, eq=False)
class _Curves:
    """The free curves at a place: over what, from where to where, and the arguments and the speed in every record."""

    place: Place
    v_s: float
    ranges: list[tuple[str, float, float]]
    arguments: list[list[np.ndarray]]
    speeds: list[np.ndarray]

    @classmethod
    def at(cls, place: Place, facts: Confrontation, runs: Sequence[dict[str, np.ndarray]]) -> _Curves:
        names = [n for n, _ in place.motion_names()]
        motions = [
            {
                g: run[f"place.{place.name}.{n}"]
                for g, n in zip(MOTION, names, strict=True)
                if f"place.{place.name}.{n}" in run
            }
            for run in runs
        ]
        speeds = [m["velocity"] for m in motions]
        ranges, all_arguments = [], []
        for over in CURVE_OVER:
            arguments = [
                _argument(over, m, np.array(e.record.time)) for m, e in zip(motions, facts.experiments, strict=True)
            ]
            low, high = float(min(a.min() for a in arguments)), float(max(a.max() for a in arguments))
            if high - low >= 1e-9:
                ranges.append((over, low, high))
                all_arguments.append(arguments)
        v_s = max(0.01 * float(np.quantile(np.abs(np.concatenate(speeds)), 0.95)), 1e-12)
        return cls(place, v_s, ranges, all_arguments, speeds)

    def pushes(self, record: int) -> list[Push]:
        """Return the force of every point of every curve along a record."""
        pushes = []
        for (over, low, high), arguments in zip(self.ranges, self.arguments, strict=True):
            basis = _tents(arguments[record], low, high)
            if over == "friction":
                basis = -basis * np.tanh(self.speeds[record] / self.v_s)[:, None]
            pushes += [Push(f"probe.{self.place.name}", basis[:, k]) for k in range(CURVE_POINTS)]
        return pushes

    def candidates(self, blocks: Sequence[np.ndarray]) -> list[Candidate]:
        """Return a candidate for each curve, from what its points change in the outputs of all records."""
        found = []
        for k, (over, low, high) in enumerate(self.ranges):
            own = slice(k * CURVE_POINTS, (k + 1) * CURVE_POINTS)
            found.append(
                Candidate(
                    f"unknown_force over {over}",
                    self.place.name,
                    (tuple(block[:, :, own] for block in blocks),),
                    ({"low": low, "high": high, "v_s": self.v_s},),
                    amplitudes=tuple(f"curve.y[{k}]" for k in range(CURVE_POINTS)),
                    info={"place": self.place, "over": over},
                )
            )
        return found


def curve_candidates(facts: Confrontation, places: Sequence[Place]) -> list[Candidate]:
    """Return a candidate for each moving place and each regressor of a free curve."""
    count = len(facts.experiments)
    runs = [facts.motions(i) for i in range(count)]
    curves = [c for c in (_Curves.at(place, facts, runs) for place in places) if c.ranges]

    def of_record(i: int) -> list[np.ndarray]:
        experiment, start = facts.experiments[i], facts.start(i)
        forces = [c.pushes(i) for c in curves]
        every = [f for group in forces for f in group]
        if worth_it(facts.slim, every):  # for all places at once
            response_of(experiment, facts.slim, facts.p, start, every)
        found = [
            experiment.respond(facts.slim, facts.p, start, pushes=group, sensors=facts.sensors).derivatives
            for group in forces
        ]
        forget(experiment)
        return [facts.shaped(i, one) for one in found]

    blocks = side_by_side(of_record, range(count))
    return [one for k, c in enumerate(curves) for one in c.candidates([of_one[k] for of_one in blocks])]


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

    key = ("curves", facts.preparation, level, seed, tuple(where) if where is not None else None)
    if key in stage.worked_out:
        return stage.worked_out[key]
    places = [p for p in stage.system.places if where is None or p.name in where]
    progress(f"free curves at {len(places)} places")
    candidates = curve_candidates(facts, places)
    residual = facts.residual()
    found = scan(
        residual, facts.sensitivities(), candidates,
        level=level, seed=seed, whiten=False, noise_floor=[stage.noise[c] for c in residual.channels],
    )  # fmt: skip
    by_name = {c.name: c for c in candidates}
    rows = sorted((r for r in found.rows if holds(r)), key=lambda r: r.delta_bic)
    effects = tuple(curve_effect(by_name[r.name], np.atleast_1d(r.amplitude), dict(r.shape), stage) for r in rows)
    offer = CurveOffer(effects, tuple(r.p for r in rows), tuple(r.error_drop for r in rows), found)
    stage.worked_out[key] = offer
    return offer
