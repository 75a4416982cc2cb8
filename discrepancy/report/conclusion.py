"""What a study concludes, and how that stands in ``diagnosis.json`` (schema 1)."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.effects.effect import Effect
from discrepancy.questions.compare import PARTS, Comparison, compare, signal_entry
from discrepancy.questions.explained_share import explained, explained_by_output
from discrepancy.questions.locate import WhereItFails, locate
from discrepancy.report.schema import SCHEMA, VERDICTS, check_diagnosis
from discrepancy.stages.stage import AcceptedEffect, RivalExplanation, Stage
from multibody.base.quantity_text import bare_unit

if TYPE_CHECKING:
    from estimation.fit.calibrate import Calibration

__all__ = [
    "SCHEMA",
    "VERDICTS",
    "Conclusion",
    "Evidence",
    "UnknownCurve",
    "check_diagnosis",
    "effect_parameters",
    "evidence_of",
    "explained",
    "parameter_unit",
    "plain",
    "save_diagnosis",
    "to_diagnosis",
]


@dataclass(frozen=True, eq=False)
class UnknownCurve:
    """A force without a name, as a curve over what it follows.

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
    def of_effect(
        cls, effect: Effect, calibration: Calibration, statement: str = "", **figures: float
    ) -> UnknownCurve:
        """Return the curve of an effect of kind ``unknown_force``, with the deviations of its points."""
        known = {p.name: s for p, s in zip(calibration.parameters, calibration.std, strict=True)}
        std = np.array([known.get(effect.parameter_name(n), math.nan) for n in effect.strengths], dtype=float)
        turns = effect.domain == "rotation"
        unit = {"time": "s", "speed": "rad/s" if turns else "m/s"}.get(effect.over, "rad" if turns else "m")
        return cls(
            effect.where,
            effect.over,
            unit,
            "N*m" if turns else "N",
            np.array(effect.knots),
            np.array(list(effect.strengths.values()), dtype=float),
            std,
            statement,
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


@dataclass(frozen=True, eq=False)
class Conclusion:
    """Everything that a study has to say.

    Parameters
    ----------
    verdict : str
        One of `VERDICTS`; empty if nobody asked what is missing (``vtsdt compare``).
    sentence : str
        The answer in two or three plain sentences.
    stages : tuple of Stage
        As given, recalibrated, then one for each effect.
    refused : tuple of (kind, where, why)
        What these records cannot speak about.
    hidden : tuple of (kind, where, mde, delta, unit)
        What was looked for and not found; ``mde`` is the smallest amplitude that would have been seen,
        ``delta`` the one that would matter.
    slight : tuple of (kind, where, amplitude, std, p, unit)
        What the last step has found and passed over, because it changes too little.
    next_measurement : tuple of str
    unknown : UnknownCurve or None
    warnings : tuple of str
        From records and study.
    residual_mode, residual_reason : str
        How the model was confronted with the records, and why so.
    seed : int
    level : float
        Chance of naming an effect when nothing is missing.
    name : str
        Of the study.
    paths : tuple of str
        Of the study file and the recordings.
    """

    verdict: str
    sentence: str
    stages: tuple[Stage, ...]
    refused: tuple[tuple[str, str, str], ...] = ()
    hidden: tuple[tuple[str, str, float, float, str], ...] = ()
    slight: tuple[tuple[str, str, float, float, float, str], ...] = ()
    next_measurement: tuple[str, ...] = ()
    unknown: UnknownCurve | None = None
    warnings: tuple[str, ...] = ()
    residual_mode: str = "simulation"
    residual_reason: str = ""
    seed: int = 0
    level: float = 0.02
    name: str = ""
    paths: tuple[str, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict)

    @property
    def baseline(self) -> Stage:
        """The recalibrated stage, or the only one there is."""
        return self.stages[min(1, len(self.stages) - 1)]

    @property
    def final(self) -> Stage:
        """The last stage."""
        return self.stages[-1]

    @property
    def accepted(self) -> tuple[AcceptedEffect, ...]:
        """What was added, in that order, with the values of the last stage."""
        from dataclasses import replace

        last = {(e.kind, e.where, e.number): e for e in self.final.effects}
        found = [s.accepted for s in self.stages if s.accepted is not None]
        keys = [(a.effect.kind, a.effect.where, a.effect.number) for a in found]
        return tuple(replace(a, effect=last.get(k, a.effect)) for a, k in zip(found, keys, strict=True))

    @property
    def judged_on(self) -> str:
        """Part on which the falling error is judged: held-out records where there are any."""
        return "validate" if self.baseline.fits("validate") else "identify"


@dataclass(frozen=True, eq=False)
class Evidence:
    """What is worked out from the stages once and used by file, figures and page alike.

    Attributes
    ----------
    comparisons : tuple of Comparison
        Of every stage.
    before, after : WhereItFails
        Of the recalibrated and of the last stage, on the identification records.
    """

    comparisons: tuple[Comparison, ...]
    before: WhereItFails
    after: WhereItFails


def evidence_of(conclusion: Conclusion) -> Evidence:
    """Compare every stage and locate the error before and after."""
    before = locate(conclusion.baseline)
    after = before if conclusion.final is conclusion.baseline else locate(conclusion.final)
    return Evidence(tuple(compare(s) for s in conclusion.stages), before, after)


def effect_parameters(effect: Effect, stage: Stage) -> dict[str, dict[str, Any]]:
    """Return value, standard deviation and unit of what was fitted of an effect."""
    if effect.definition.free_form:
        return UnknownCurve.of_effect(effect, stage.identify).to_dict()
    std = {p.name: float(s) for p, s in zip(stage.identify.parameters, stage.identify.std, strict=True)}
    found = {}
    for name, value in {**effect.strengths, **effect.shape}.items():
        full = effect.parameter_name(name)
        if name in effect.strengths or full in std:
            found[name] = {
                "value": float(value),
                "std": std.get(full),
                "unit": parameter_unit(effect, name, stage),
            }
    return found


def parameter_unit(effect: Effect, name: str, stage: Stage) -> str:
    """Return the unit of an effect's parameter; errors of sensors and inputs take that of their signal."""
    at = effect.definition.at
    if at in ("connection", "parameter") or name not in ("offset", "drift"):
        return bare_unit(effect.unit(name))
    try:
        unit = stage.system.unit(effect.where)
    except KeyError:
        return effect.unit(name)
    return unit if name == "offset" else f"{unit}/s"


def _effect_entry(accepted: AcceptedEffect, conclusion: Conclusion) -> dict[str, Any]:
    effect = accepted.effect

    def told(rival: RivalExplanation) -> dict[str, Any]:
        return {
            "kind": rival.kind,
            "where": rival.where,
            "delta_bic": rival.delta_bic,
            "refitted": rival.refitted,
        }

    fixed = (
        {}
        if effect.definition.free_form
        else {k: v for k, v in effect.shape.items() if k not in effect_parameters(effect, conclusion.final)}
    )
    return {
        "kind": effect.kind,
        "where": effect.where,
        "parameters": effect_parameters(effect, conclusion.final),
        "p_value": accepted.p_value,
        "delta_bic": accepted.delta_bic,
        "indistinguishable_from": [told(r) for r in accepted.rivals if r.indistinguishable],
        "runners_up": [told(r) for r in accepted.rivals if not r.indistinguishable],
        "title": effect.definition.text.title,
        "fixed": fixed,
        **({"hidden_by": accepted.masked_by} if accepted.masked_by else {}),
    }


def to_diagnosis(conclusion: Conclusion, evidence: Evidence | None = None) -> dict[str, Any]:
    """Return the conclusion as a dict of plain values, in the form of ``diagnosis.json``.

    Parameters
    ----------
    conclusion : Conclusion
    evidence : Evidence, optional
        Worked out before; else it is made here.
    """
    evidence = evidence or evidence_of(conclusion)
    effects = [_effect_entry(a, conclusion) for a in conclusion.accepted]
    curve = conclusion.unknown
    if curve is not None and not any(e["kind"] == "unknown_force" for e in effects):
        effects.append(
            {
                "kind": "unknown_force",
                "where": curve.where,
                "parameters": curve.to_dict(),
                "p_value": curve.p_value,
                "delta_bic": curve.delta_bic,
                "indistinguishable_from": [],
                "runners_up": [],
            }
        )
    energy, rms = explained(conclusion)
    stages = []
    for stage, comparison in zip(conclusion.stages, evidence.comparisons, strict=True):
        figures = {part: {n: signal_entry(a) for n, a in comparison.pooled(part).items()} for part in PARTS}
        stages.append({"name": stage.name, **figures})
    final = conclusion.final
    return dict(
        plain(
            {
                "schema": SCHEMA,
                "verdict": conclusion.verdict or None,
                "sentence": conclusion.sentence,
                "effects": effects,
                "stages": stages,
                "where_it_fails": evidence.before.to_dict(),
                "where_it_still_fails": evidence.after.to_dict(),
                "noise_floor": dict(conclusion.baseline.noise),
                "explained": energy,
                "explained_rms": rms,
                "explained_by_output": explained_by_output(conclusion),
                "explained_on": conclusion.judged_on,
                "refused": [{"kind": k, "where": w, "why": y} for k, w, y in conclusion.refused],
                "could_hide": [
                    {"kind": k, "where": w, "smallest_visible": m, "would_matter": d, "unit": u}
                    for k, w, m, d, u in conclusion.hidden
                ],
                "present_but_negligible": [
                    {"kind": k, "where": w, "amplitude": a, "std": s, "p_value": p, "unit": u}
                    for k, w, a, s, p, u in conclusion.slight
                ],
                "next_measurement": list(conclusion.next_measurement),
                "parameters": [
                    {
                        "name": p.name,
                        "start": p.value,
                        "value": v,
                        "std": s,
                        "unit": p.unit,
                        "at_bound": p.name in final.identify.at_bound,
                        "not_excited": p.name in final.identify.not_excited,
                    }
                    for p, v, s in zip(
                        final.identify.parameters, final.identify.values, final.identify.std, strict=True
                    )
                ],
                "units": {n: final.system.unit(n) for n in final.outputs},
                "residual": {"mode": conclusion.residual_mode, "why": conclusion.residual_reason},
                "seed": conclusion.seed,
                "level": conclusion.level,
                "study": conclusion.name,
                "paths": list(conclusion.paths),
                "warnings": list(conclusion.warnings),
                **conclusion.extra,
            }
        )
    )


def plain(value: Any) -> Any:
    """Return numbers, text, lists and dicts as JSON has them; what is not finite becomes None."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value if value is None else str(value)


def save_diagnosis(conclusion: Conclusion, path: str | Path, evidence: Evidence | None = None) -> Path:
    """Write ``diagnosis.json`` and return its path."""
    path = Path(path)
    text = json.dumps(to_diagnosis(conclusion, evidence), indent=1, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")
    return path
