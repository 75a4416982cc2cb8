"""Free curves at every place of a machine: how each of their points would change the outputs, worked out once.

The transitions that carry a force through the machine cost far more than the forces carried.  So the columns of all
curves at all places are made together, in a scan along with those of the laws, and whoever asks about one place finds
them there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.effects.law_along_motion import MOTION
from discrepancy.effects.laws import CURVE_OVER, CURVE_POINTS
from discrepancy.sensitivities.linearised_problem import LinearisedProblem
from discrepancy.statistics.blocks import Candidate
from estimation.response.perturbation_response import response_of, worth_it
from estimation.response.perturbations import Push

if TYPE_CHECKING:
    from multibody.assembly.places import Place

__all__ = ["FreeCurves", "free_curve_sensitivities", "free_curves"]


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
class FreeCurves:
    """The free curves at a place: over what, from where to where, and the arguments and the speed in every record."""

    place: Place
    v_s: float
    ranges: list[tuple[str, float, float]]
    arguments: list[list[np.ndarray]]
    speeds: list[np.ndarray]

    @classmethod
    def at(cls, place: Place, facts: LinearisedProblem, runs: Sequence[dict[str, np.ndarray]]) -> FreeCurves:
        """Return the curves at a place, of which every record has its motion among ``runs``."""
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

    @property
    def channel(self) -> str:
        """Input of the model through which the curves act."""
        return f"probe.{self.place.name}"

    def pushes(self, record: int) -> list[Push]:
        """Return the force of every point of every curve along a record."""
        pushes = []
        for (over, low, high), arguments in zip(self.ranges, self.arguments, strict=True):
            basis = _tents(arguments[record], low, high)
            if over == "friction":
                basis = -basis * np.tanh(self.speeds[record] / self.v_s)[:, None]
            pushes += [Push(self.channel, basis[:, k]) for k in range(CURVE_POINTS)]
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


def free_curves(facts: LinearisedProblem) -> list[FreeCurves]:
    """Return the free curves at all places that move."""
    if "free curves" not in facts._cache:
        runs = [facts.motions(i) for i in range(len(facts.experiments))]
        found = (FreeCurves.at(place, facts, runs) for place in facts.system.places)
        facts._cache["free curves"] = [c for c in found if c.ranges]
    return facts._cache["free curves"]


def free_curve_sensitivities(facts: LinearisedProblem, record: int) -> dict[str, np.ndarray]:
    """Return what the points of all free curves change in the outputs of a record, by place, (n, n_channels, points).

    Transitions that are at hand are used and left there: see `estimation.response.perturbation_response.forget`.
    """
    key = f"free curves {record}"
    if key not in facts._cache:
        experiment, start = facts.experiments[record], facts.start(record)
        forces = {c.place.name: c.pushes(record) for c in free_curves(facts)}
        every = [f for group in forces.values() for f in group]
        if worth_it(facts.slim, every):  # for all places at once
            response_of(experiment, facts.slim, facts.p, start, every)
        found = {}
        for name, group in forces.items():
            changed = experiment.respond(facts.slim, facts.p, start, pushes=group, sensors=facts.sensors)
            found[name] = facts.shaped(record, changed.derivatives)
        facts._cache[key] = found
    return facts._cache[key]
