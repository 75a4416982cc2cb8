"""The conclusion of a study as ``diagnosis.json`` (schema 1)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from discrepancy.conclusion.conclusion import Conclusion, Evidence, evidence_of
from discrepancy.effects.effect import Effect
from discrepancy.questions.compare import PARTS, signal_entry
from discrepancy.questions.explained_share import explained_by_output, explained_share
from discrepancy.questions.unknown_force import UnknownCurve
from discrepancy.report.schema import SCHEMA
from discrepancy.stages.stage import AcceptedEffect, RivalExplanation, Stage
from multibody.base.json_file import write_json_atomically
from multibody.base.quantity_text import bare_unit

__all__ = ["effect_parameters", "parameter_unit", "plain", "save_diagnosis", "to_diagnosis"]


def effect_parameters(effect: Effect, stage: Stage) -> dict[str, dict[str, Any]]:
    """Return value, standard deviation and unit of what was fitted of an effect."""
    if effect.definition.free_form:
        return UnknownCurve.of_effect(effect, stage.identify).to_dict()
    std = {p.name: float(s) for p, s in zip(stage.identify.parameters, stage.identify.std, strict=True)}
    fitted = {}
    for name, value in {**effect.strengths, **effect.shape}.items():
        full = effect.parameter_name(name)
        if name in effect.strengths or full in std:
            fitted[name] = {
                "value": float(value),
                "std": std.get(full),
                "unit": parameter_unit(effect, name, stage),
            }
    return fitted


def parameter_unit(effect: Effect, name: str, stage: Stage) -> str:
    """Return the unit of an effect's parameter; errors of sensors and inputs take that of their signal."""
    at = effect.definition.at
    if at in ("connection", "parameter", "transmission") or name not in ("offset", "drift"):
        return bare_unit(effect.unit(name))
    try:
        unit = stage.system.unit(effect.where)
    except KeyError:
        return effect.unit(name)
    return unit if name == "offset" else f"{unit}/s"


def _effect_entry(accepted: AcceptedEffect, conclusion: Conclusion) -> dict[str, Any]:
    effect = accepted.effect

    def entry(rival: RivalExplanation) -> dict[str, Any]:
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
        **_probability(str(effect), conclusion),
        "p_value": accepted.p_value,
        "delta_bic": accepted.delta_bic,
        "indistinguishable_from": [entry(r) for r in accepted.rivals if r.indistinguishable],
        "runners_up": [entry(r) for r in accepted.rivals if not r.indistinguishable],
        "title": effect.definition.text.title,
        "fixed": fixed,
        **({"hidden_by": accepted.masked_by} if accepted.masked_by else {}),
    }


def _probability(name: str, conclusion: Conclusion) -> dict[str, float]:
    """Return the probability of an effect by name, if the search gives one."""
    effects = conclusion.probabilities.effects if conclusion.probabilities is not None else ()
    return next(({"probability": p.probability} for p in effects if f"{p.kind}@{p.where}" == name), {})


def to_diagnosis(conclusion: Conclusion, evidence: Evidence | None = None) -> dict[str, Any]:
    """Return the conclusion as a dict of plain values, in the form of ``diagnosis.json``.

    Parameters
    ----------
    conclusion : Conclusion
    evidence : Evidence, optional
        As computed before; else it is computed here.
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
    energy, rms = explained_share(conclusion.baseline, conclusion.final, conclusion.judged_on)
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
                "explained_by_output": explained_by_output(conclusion.baseline, conclusion.final, conclusion.judged_on),
                "explained_on": conclusion.judged_on,
                "refused": [{"kind": k, "where": w, "why": y} for k, w, y in conclusion.refused],
                "could_hide": [
                    {"kind": k, "where": w, "smallest_visible": m, "would_matter": d, "unit": u}
                    for k, w, m, d, u in conclusion.hidden
                ],
                "present_but_negligible": [
                    {"kind": k, "where": w, "amplitude": a, "std": s, "p_value": p, "unit": u}
                    for k, w, a, s, p, u in conclusion.negligible
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
    return write_json_atomically(Path(path), to_diagnosis(conclusion, evidence))
