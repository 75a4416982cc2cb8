"""What can be said of a force without a name: what it depends on, what looks the same, which simple law is near."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.questions.simple_laws import Law

if TYPE_CHECKING:
    from discrepancy.effects.effect import Effect
    from discrepancy.questions.force_curves import CurveReport
    from discrepancy.stages.force_estimate import ForceEstimate
    from discrepancy.study.study import Study

__all__ = ["UnknownForce", "describe_unknown", "described"]

#: Laws that are told, and the least share of the curve's work for which a catalogue kind counts as alike.
LAWS, RESEMBLANCE = 4, 0.8
DRAWS = 200


@dataclass(frozen=True, eq=False)
class UnknownForce:
    """What is known about a force that no kind of the catalogue explains.

    Parameters
    ----------
    estimate : ForceEstimate
        The force over time.
    report : CurveReport or None
        What it is a function of; None if the sensors do not determine the force.
    laws : tuple of Law
        Simple laws for it, by error on blocks left out.
    alike : tuple of (kind, share)
        Kinds of the catalogue at the same place that would take most of the same error away.
    over : str
        What the curve that was added is a function of.
    """

    estimate: ForceEstimate
    report: CurveReport | None
    laws: tuple[Law, ...] = ()
    alike: tuple[tuple[str, float], ...] = ()
    over: str = ""

    @property
    def sentence(self) -> str:
        """What is known, in a few sentences."""
        e = self.estimate
        if self.report is None:
            return (
                f"The force at {e.where} itself cannot be reconstructed: these sensors determine "
                f"{100 * e.known:.0f} % of its variance. The curve is a fit and not a measurement."
            )
        text = (
            f"Estimated over time, without assuming a law ({100 * e.known:.0f} % of its variance is determined), the "
            f"force is {self.report.statement}."
        )
        near = [law for law in self.laws if law.as_good_as_curve]
        if near and self.report.best is not None:
            text += f" As good as a free curve on blocks left out: {near[0].formula} ({near[0].name})."
        elif self.laws and self.report.best is not None:
            worse = self.laws[0].error / max(self.laws[0].curve_error, 1e-300) - 1.0
            text += (
                f" No simple law does as well as the curve; the nearest, {self.laws[0].name} ({self.laws[0].formula}), "
                f"is {100 * worse:.0f} % worse on blocks left out."
            )
        if self.alike:
            from discrepancy.effects.kinds import kind_named

            told = ", ".join(f"{kind_named(k).text.title} ({100 * s:.0f} %)" for k, s in self.alike[:2])
            text += (
                f" It resembles {told} of the catalogue: in brackets the share of the curve's work that it would do."
            )
        return text

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, for ``diagnosis.json``."""
        best = self.report.best if self.report is not None else None
        ranked = self.report.explanations if self.report is not None else ()
        return {
            "where": self.estimate.where,
            "unit": self.estimate.unit,
            "sentence": self.sentence,
            "share_determined": self.estimate.known,
            "reconstructable": self.estimate.reconstructable,
            "memory_s": self.estimate.memory,
            "log_likelihood": self.estimate.log_likelihood,
            "depends_on": None if best is None else best.regressor,
            "turns_with_direction": None if best is None else best.parity == "odd" or best.regressor == "direction",
            "period": None if best is None else best.curve.period,
            "looks_the_same_over": {} if best is None else dict(best.aliases),
            "tried": [
                {"regressor": x.regressor, "parity": x.parity, "explained": x.explained, "p": x.p} for x in ranked
            ],
            "laws": [
                {
                    "name": x.name,
                    "formula": x.formula,
                    "parameters": x.parameters,
                    "error": x.error,
                    "curve_error": x.curve_error,
                }
                for x in self.laws
            ],
            "resembles": [{"kind": k, "share": s} for k, s in self.alike],
            "force": {
                "time": self.estimate.time,
                "record": self.estimate.record,
                "value": self.estimate.force,
                "std": self.estimate.std,
            },
        }


def describe_unknown(study: Study) -> UnknownForce | None:
    """Describe the last force without a name that a study found; None if it found none.

    The force is estimated on the model without it; what it is a function of, and which simple law is near, are asked
    of that estimate and not of the curve that was added, which has an argument already.
    """
    from discrepancy.stages.force_estimate import estimate_force

    stages = study.stages
    k = next(
        (
            i
            for i in range(len(stages) - 1, 0, -1)
            if (a := stages[i].accepted) is not None and a.effect.definition.free_form
        ),
        0,
    )
    if k < 1:
        return None
    accepted, before = stages[k].accepted, stages[k - 1]
    assert accepted is not None
    effect = accepted.effect
    study.progress(f"the force at {effect.where} over time")
    place = next(p for p in before.system.places if p.name == effect.where)
    estimate = estimate_force(before, place, stages[k])
    alike = _alike(study, effect, k)
    return described(study, estimate, alike, effect.over)


def described(
    study: Study,
    estimate: ForceEstimate,
    alike: tuple[tuple[str, float], ...] = (),
    over: str = "",
    level: float | None = None,
) -> UnknownForce:
    """Say what an estimated force is a function of and which simple law is near, if the sensors determine it.

    ``level`` is that at which it is said to be one; default: the study's.
    """
    from discrepancy.questions.force_curves import explain_force
    from discrepancy.questions.simple_laws import suggest_laws

    if not estimate.reconstructable:
        return UnknownForce(estimate, None, (), alike, over)
    study.progress(f"what the force at {estimate.where} depends on")
    moving = np.abs(estimate.motion["speed"])
    direction = np.tanh(estimate.motion["speed"] / max(0.01 * float(np.max(moving)), 1e-300))
    report = explain_force(
        estimate.force,
        estimate.motion,
        std=estimate.std,
        direction=direction,
        blocks=estimate.record,
        units=estimate.units,
        draws=DRAWS,
        level=study.problem.level if level is None else level,
        seed=study.problem.seed,
    )
    laws: tuple[Law, ...] = ()
    best = report.best
    if best is not None:
        x = direction if best.regressor == "direction" else estimate.motion[best.regressor]
        laws = tuple(suggest_laws(estimate.force, x, best.curve, direction=direction, blocks=estimate.record)[:LAWS])
    return UnknownForce(estimate, report, laws, alike, over)


def _alike(study: Study, effect: Effect, index: int) -> tuple[tuple[str, float], ...]:
    """Return kinds at the same place by the share of the curve's work that the scan before it expects of them."""
    stages = study.stages
    scan = stages[index - 1].scan
    if scan is None:  # a stage that was built again from a history
        return ()
    gone = []
    for name in stages[index].outputs:
        a, b = (s.rmse("identify")[name] for s in (stages[index], stages[index - 1]))
        gone.append(1.0 - (a / b) ** 2 if b > 0 else 0.0)
    whole = float(np.mean(gone))
    if whole <= 0.0:
        return ()
    rows = [r for r in scan.rows if r.where == effect.where and r.error_reduction > 0.0]
    shares = [(r.kind, min(1.0, float(r.error_reduction) / whole)) for r in rows]
    return tuple(sorted((s for s in shares if s[1] >= RESEMBLANCE), key=lambda s: -s[1])[:3])
