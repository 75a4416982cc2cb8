"""Free curves at a place: a force given by points over position, speed or time, and the candidates that they make.

The state-transition matrices that carry a force through the machine cost far more than the forces carried.  So the
sensitivities of all curves at all places are computed together
(`discrepancy.sensitivities.linearised_problem.LinearisedProblem.free_curve_sensitivities`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.effects.law_along_motion import MOTION
from discrepancy.effects.laws import CURVE_OVER, CURVE_POINTS
from discrepancy.statistics.blocks import Candidate, KeptSensitivities
from discrepancy.statistics.hat_functions import even_hat_functions
from estimation.response.perturbations import InputPerturbation

if TYPE_CHECKING:
    from discrepancy.effects.effect import Effect
    from multibody.assembly.places import Place
    from multibody.base.memory import ArrayStore

__all__ = ["FreeCurves"]


def _argument(over: str, motion: dict[str, np.ndarray], time: np.ndarray) -> np.ndarray:
    return {
        "position": motion["position"],
        "friction": motion["position"],
        "speed": motion["velocity"],
        "time": time,
    }[over]


@dataclass(frozen=True, eq=False, kw_only=True)
class FreeCurves:
    """The free curves at a place.

    Parameters
    ----------
    place : Place
    v_s : float, m/s or rad/s
        Speed over which a friction curve changes its sign.
    ranges : list of (str, float, float)
        Argument of each curve (``"position"``, ``"friction"``, ``"speed"`` or ``"time"``), its first and last point.
    arguments : list of list of ndarray
        The argument of each curve in every record.
    speeds : list of ndarray
        The speed of the place in every record.
    """

    place: Place
    v_s: float
    ranges: list[tuple[str, float, float]]
    arguments: list[list[np.ndarray]]
    speeds: list[np.ndarray]

    @classmethod
    def at(cls, place: Place, times: Sequence[np.ndarray], runs: Sequence[dict[str, np.ndarray]]) -> FreeCurves:
        """Return the curves at a place from the times and the outputs of every record."""
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
            arguments = [_argument(over, m, t) for m, t in zip(motions, times, strict=True)]
            low, high = float(min(a.min() for a in arguments)), float(max(a.max() for a in arguments))
            if high - low >= 1e-9:
                ranges.append((over, low, high))
                all_arguments.append(arguments)
        v_s = max(0.01 * float(np.quantile(np.abs(np.concatenate(speeds)), 0.95)), 1e-12)
        return cls(place=place, v_s=v_s, ranges=ranges, arguments=all_arguments, speeds=speeds)

    @property
    def channel(self) -> str:
        """Input of the model through which the curves act."""
        return f"probe.{self.place.name}"

    def perturbations(self, record: int, curves: slice = slice(None)) -> list[InputPerturbation]:
        """Return the force of every point of every curve, or of some, along a record."""
        forces = []
        for (over, low, high), arguments in zip(self.ranges[curves], self.arguments[curves], strict=True):
            position = np.clip((arguments[record] - low) / (high - low), 0.0, 1.0) * (CURVE_POINTS - 1)
            basis = even_hat_functions(position, CURVE_POINTS)
            if over == "friction":
                basis = -basis * np.tanh(self.speeds[record] / self.v_s)[:, None]
            forces += [InputPerturbation(self.channel, basis[:, k]) for k in range(CURVE_POINTS)]
        return forces

    def forces_of(self, curve: Effect) -> list[np.ndarray]:
        """Return the force of a free curve at this place along every record."""
        k = next(k for k, (over, *_) in enumerate(self.ranges) if over == curve.over)
        own = replace(
            self,
            v_s=curve.shape.get("v_s", self.v_s),
            ranges=[(curve.over, curve.shape["low"], curve.shape["high"])],
            arguments=[self.arguments[k]],
        )
        heights = np.array(list(curve.strengths.values()))
        return [np.column_stack([p.values for p in own.perturbations(i)]) @ heights for i in range(len(self.speeds))]

    def candidates(self, store: ArrayStore, numbers: Sequence[Sequence[int]]) -> list[Candidate]:
        """Return a candidate for each curve.

        Parameters
        ----------
        store : ArrayStore
        numbers : sequence over records of sequence over curves of int
            Of the sensitivities in the store, each (n, n_channels, points).
        """
        candidates = []
        for k, (over, low, high) in enumerate(self.ranges):
            candidates.append(
                Candidate(
                    kind=f"unknown_force over {over}",
                    where=self.place.name,
                    sensitivities=KeptSensitivities(store, [[of_record[k] for of_record in numbers]]),
                    shapes=({"low": low, "high": high, "v_s": self.v_s},),
                    strengths=tuple(f"curve.y[{k}]" for k in range(CURVE_POINTS)),
                    info={"place": self.place, "over": over},
                )
            )
        return candidates
