"""A force that no kind of the catalogue explains: where it acts, its course over time, and what it is a function of."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.effects.effect import Effect
from discrepancy.effects.kinds import kind_named
from discrepancy.questions.simple_laws import Law
from discrepancy.search.model_comparison import exceeds_noise
from discrepancy.search.state import SearchState
from discrepancy.stages.force_estimate import ForceEstimate, estimate_force
from discrepancy.statistics.thresholds import FEWEST_FORCES, LEVEL_SHARES
from multibody.base.quantity_text import count_text

if TYPE_CHECKING:
    from discrepancy.questions.force_curves import CurveReport, Explanation
    from estimation.fit.calibrate import Calibration

__all__ = ["UnknownCurve", "UnknownForce", "describe_accepted_curve", "find_unidentified_force"]

#: Simple laws that are listed.
MOST_LAWS = 4
#: Least share of the curve's error reduction from which a kind of the catalogue is said to resemble it.
RESEMBLANCE = 0.8
#: Level of the test what an unidentified force follows, made only where the omnibus test has rejected; chosen.
FOLLOWS_LEVEL = 0.1
DRAWS = 200


@dataclass(frozen=True, eq=False, kw_only=True)
class UnknownCurve:
    """An unidentified force, as a curve over what it follows.

    Parameters
    ----------
    where : str
        Connection at which it acts.
    regressor : str
        ``"position"``, ``"speed"``, ``"time"`` or ``"friction"`` (a level over position that turns with the
        direction).
    regressor_unit, unit : str
        Unit of ``x``; unit of the force.
    x, force, std : ndarray, shape (n,)
    statement : str
        What is known about it, in a sentence.
    p_value, delta_bic : float
        As for named effects.
    """

    where: str
    regressor: str
    regressor_unit: str
    unit: str
    x: np.ndarray
    force: np.ndarray
    std: np.ndarray
    statement: str = ""
    p_value: float = math.nan
    delta_bic: float = math.nan

    @classmethod
    def of_effect(cls, effect: Effect, calibration: Calibration, statement: str = "", **figures: float) -> UnknownCurve:
        """Return the curve of an effect of kind ``unknown_force``, with the deviations of its points."""
        known = {p.name: s for p, s in zip(calibration.parameters, calibration.std, strict=True)}
        std = np.array([known.get(effect.parameter_name(n), math.nan) for n in effect.strengths], dtype=float)
        turns = effect.domain == "rotation"
        unit = {"time": "s", "speed": "rad/s" if turns else "m/s"}.get(effect.over, "rad" if turns else "m")
        return cls(
            where=effect.where,
            regressor=effect.over,
            regressor_unit=unit,
            unit="N*m" if turns else "N",
            x=np.array(effect.knots),
            force=np.array(list(effect.strengths.values()), dtype=float),
            std=std,
            statement=statement,
            **figures,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the curve and what it is a function of, as ``parameters`` of the effect."""
        return {
            "function_of": {"value": self.regressor, "std": None, "unit": self.regressor_unit},
            "curve": {
                "x": self.x.tolist(),
                "value": self.force.tolist(),
                "std": self.std.tolist(),
                "unit": self.unit,
                "x_unit": self.regressor_unit,
            },
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class UnknownForce:
    """What the records say about a force that no kind of the catalogue explains.

    Parameters
    ----------
    estimate : ForceEstimate
        The force over time.
    report : CurveReport or None
        What it is a function of; None if the sensors do not determine the force, or at too few instants.
    laws : tuple of Law
        Simple laws for it, by error on blocks left out.
    similar : tuple of (kind, share)
        Kinds of the catalogue at the same place that would remove most of the same error.
    over : str
        What the curve that was added is a function of.
    """

    estimate: ForceEstimate
    report: CurveReport | None
    laws: tuple[Law, ...] = ()
    similar: tuple[tuple[str, float], ...] = ()
    over: str = ""

    @property
    def sentence(self) -> str:
        """The description, in a few sentences."""
        e = self.estimate
        if self.report is None and e.reconstructable:
            return (
                f"The force at {e.where} is estimated at {count_text(e.force.size, 'instant')}, which are too few to "
                f"say what it depends on (at least {FEWEST_FORCES}): take longer records."
            )
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
        if self.similar:
            titles = ", ".join(f"{kind_named(k).text.title} ({100 * s:.0f} %)" for k, s in self.similar[:2])
            text += (
                f" It resembles {titles} of the catalogue; in brackets, the share of the curve's error reduction that "
                "it would reach."
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
            "resembles": [{"kind": k, "share": s} for k, s in self.similar],
            "force": {
                "time": self.estimate.time,
                "record": self.estimate.record,
                "value": self.estimate.force,
                "std": self.estimate.std,
            },
        }


def describe_accepted_curve(state: SearchState) -> UnknownForce | None:
    """Describe the force of the last free curve that a search accepted; None if it accepted none.

    The force is estimated on the model without it.  What it is a function of, and which simple law is near, follow
    from that estimate and not from the accepted curve, whose argument was chosen before.
    """
    stages = state.stages
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
    state.progress(f"the force at {effect.where} over time")
    place = next(p for p in before.system.places if p.name == effect.where)
    estimate = estimate_force(before, place, stages[k])
    similar = _similar_kinds(state, effect, k)
    return describe_force(state, estimate, similar, effect.over)


def describe_force(
    state: SearchState,
    estimate: ForceEstimate,
    similar: tuple[tuple[str, float], ...] = (),
    over: str = "",
    level: float | None = None,
) -> UnknownForce:
    """Describe what an estimated force is a function of and which simple law is near, if the sensors determine it.

    ``level`` is the significance level of that statement; default: that of the study.
    """
    from discrepancy.questions.force_curves import explain_force
    from discrepancy.questions.simple_laws import suggest_laws

    if not estimate.reconstructable or estimate.force.size < FEWEST_FORCES:
        return UnknownForce(estimate=estimate, report=None, laws=(), similar=similar, over=over)
    state.progress(f"what the force at {estimate.where} depends on")
    direction = estimate.direction
    report = explain_force(
        estimate.force,
        estimate.motion,
        std=estimate.std,
        direction=direction,
        blocks=estimate.record,
        units=estimate.units,
        draws=DRAWS,
        level=state.problem.level if level is None else level,
        seed=state.problem.seed,
    )
    laws: tuple[Law, ...] = ()
    best = report.best
    if best is not None:
        x = direction if best.regressor == "direction" else estimate.motion[best.regressor]
        laws = tuple(
            suggest_laws(estimate.force, x, best.curve, direction=direction, blocks=estimate.record)[:MOST_LAWS]
        )
    return UnknownForce(estimate=estimate, report=report, laws=laws, similar=similar, over=over)


def _similar_kinds(state: SearchState, effect: Effect, index: int) -> tuple[tuple[str, float], ...]:
    """Return kinds at the same place, by the share of the curve's error reduction that the scan expects of them."""
    stages = state.stages
    scan = stages[index - 1].scan
    if scan is None:  # a stage that was built again from a history
        return ()
    reductions = []
    for name in stages[index].outputs:
        a, b = (s.rmse("identify")[name] for s in (stages[index], stages[index - 1]))
        reductions.append(1.0 - (a / b) ** 2 if b > 0 else 0.0)
    whole = float(np.mean(reductions))
    if whole <= 0.0:
        return ()
    rows = [r for r in scan.rows if r.where == effect.where and r.error_reduction > 0.0]
    shares = [(r.kind, min(1.0, float(r.error_reduction) / whole)) for r in rows]
    return tuple(sorted((s for s in shares if s[1] >= RESEMBLANCE), key=lambda s: -s[1])[:3])


def find_unidentified_force(state: SearchState) -> tuple[UnknownCurve, UnknownForce] | None:
    """Return the force that would explain the residual best where no effect does, and its description.

    The force is estimated over time at every connection at which the sensors determine it, and the connection with the
    largest marginal likelihood is taken.  A disturbance from outside can be estimated as a force as well; one that the
    model lacks follows the motion significantly.

    Parameters
    ----------
    state : SearchState
        Of a search that found nothing, while the residual follows the inputs.

    Returns
    -------
    (UnknownCurve, UnknownForce) or None
        None where the residual does not follow the inputs or is near the noise, where no force can be determined or the
        force follows nothing, and where a motion is prescribed.
    """
    stage, omnibus = state.stages[-1], state.omnibus
    if state.mode == "inverse":  # its inputs are measured motions, whose noise the residual follows in any case
        return None
    if omnibus is None or not omnibus.rejects or not exceeds_noise(stage):
        return None
    state.progress("estimate the missing force over time at every connection")
    estimates = [estimate_force(stage, place, explain_all=True) for place in stage.system.places]
    known = [e for e in estimates if e.reconstructable and e.log_likelihood > 0.0]
    if not known:
        return None
    best = max(known, key=lambda e: e.log_likelihood)
    force = describe_force(state, best, level=FOLLOWS_LEVEL)
    explanation = force.report.best if force.report is not None else None
    if explanation is None:
        return None
    return _curve(best, force, explanation, min(1.0, LEVEL_SHARES * omnibus.p)), force


def _curve(estimate: ForceEstimate, force: UnknownForce, explanation: Explanation, p_value: float) -> UnknownCurve:
    """Return the force over position or speed, if it follows one of them; else over time in the first record."""
    statement = (
        f"Something is missing. No law and no curve explains it; of all connections a force at {estimate.where} would "
        f"explain most. {force.sentence}"
    )
    figures = {"p_value": p_value, "delta_bic": -2.0 * estimate.log_likelihood}
    if explanation.regressor in ("position", "speed") and explanation.parity == "even":
        c = explanation.curve
        return UnknownCurve(
            where=estimate.where,
            regressor=explanation.regressor,
            regressor_unit=c.unit,
            unit=estimate.unit,
            x=c.grid,
            force=c.value,
            std=c.std,
            statement=statement,
            **figures,
        )
    first = estimate.record == 0
    return UnknownCurve(
        where=estimate.where,
        regressor="time",
        regressor_unit="s",
        unit=estimate.unit,
        x=estimate.time[first] - estimate.time[first][0],
        force=np.asarray(estimate.force[first]),
        std=np.asarray(estimate.std[first]),
        statement=statement,
        **figures,
    )
