"""The content of ``updating.json``."""

from __future__ import annotations

import math
from typing import Any

from gearbox.updating.outcome import Candidate, UpdatingOutcome

__all__ = ["SCHEMA", "content"]

SCHEMA = 1
MARGIN = 0.3  # of the band's ends, beyond which no lines of the spectra are written; chosen: what the figure shows


def content(result: UpdatingOutcome) -> dict[str, Any]:
    """Everything a script may want of a result, as plain numbers and texts."""
    s = result.settings
    study = result.choice.study.drop(columns=["note"], errors="ignore")
    result_content = {
        "schema": SCHEMA,
        "accepted": result.accepted,
        "improved": result.improved,
        "sentence": result.sentence(),
        "objective": s.objective,
        "lag_rule": s.rule,
        "processing": s.processing.describe(),
        "parameters": {
            name: {
                "unit": unit,
                "min": low,
                "max": high,
                "start": result.start.values[name],
                "updated": result.updated.values[name],
                "selected": name in result.selected,
            }
            for name, unit, low, high in zip(s.space.names, s.space.units, s.space.lower, s.space.upper, strict=True)
        },
        "start": _candidate(result.start),
        "optimum": _candidate(result.optimum),
        "updated": _candidate(result.updated),
        "tried": [_candidate(candidate) for candidate in result.tried],
        "speed": {
            "reported_rpm": result.frequencies.reported_rpm,
            "matched_rpm": result.frequencies.condition.speed_rpm,
        },
        "frequencies": {
            "mesh_Hz": result.frequencies.virtual.mesh_frequency,
            "model": _components(result.frequencies.virtual),
            "measured": _components(result.frequencies.measured),
        },
        "sensitivity": {
            name: {"range": float(r), "slope_at_base": float(slope)}
            for name, r, slope in zip(s.space.names, result.sensitivity.ranges, result.sensitivity.slopes, strict=True)
        },
        "selected": list(result.selected),
        "surface": {
            "points": result.choice.points,
            "order": result.choice.order,
            "failed_simulations": result.choice.failed,
            "terms": list(result.choice.surface.term_names),
            "coefficients": result.choice.surface.coefficients.tolist(),
            "study": study.to_dict(orient="records"),
        },
        "search": result.search.to_dict(),
        "spectra": _spectra(result),
        "conditions": [
            {
                "name": c.condition.label,
                "load_Nm": c.condition.load_Nm,
                "reported_rpm": c.reported_rpm,
                "matched_rpm": c.condition.speed_rpm,
                "before": c.before.to_dict(),
                "after": c.after.to_dict(),
                "lines_explained_before": c.amplitude_before,
                "lines_explained_after": c.amplitude_after,
                "model_components": _components(c.components),
            }
            for c in result.checks
        ],
        "directions": [d.to_dict() for d in result.directions],
        "simulations": {
            "made": result.simulations,
            "reused": result.reused,
            "failed": result.failed,
            "computing_seconds": result.seconds,
            "off_mesh_share": result.off_mesh,
        },
        "notes": list(result.notes),
    }
    return _plain(result_content)  # type: ignore[no-any-return]


def _candidate(candidate: Candidate) -> dict[str, Any]:
    return {
        "origin": candidate.origin,
        "values": dict(candidate.values),
        "predicted": candidate.predicted,
        "simulated": candidate.simulated,
        "similarity": None if candidate.similarity is None else candidate.similarity.to_dict(),
    }


def _spectra(result: UpdatingOutcome) -> dict[str, Any]:
    """Return the spectra of the processed signals at the base condition, and where mesh lines and sidebands are."""
    from gearbox.signals.spectrum import spectrum

    recording, *signals = result.pictures["pairs"][0]
    s = result.settings
    low, high = s.processing.band
    entries: dict[str, Any] = {
        "recording": recording.name,
        "band_Hz": [low, high],
        "mesh_Hz": result.frequencies.virtual.mesh_frequency,
        "shaft_Hz": result.frequencies.condition.speed_rpm / 60.0,
    }
    for name, signal in zip(("measured", "before", "after"), signals, strict=True):
        whole = spectrum(signal)
        shown = (whole.frequencies > (1.0 - MARGIN) * low) & (whole.frequencies < (1.0 + MARGIN) * high)
        entries[name] = {
            "frequency_Hz": whole.frequencies[shown].tolist(),
            "amplitude": whole.amplitudes[shown].tolist(),
        }
    return entries


def _components(components: Any) -> dict[str, Any]:
    return {
        "frequencies_Hz": list(components.frequencies),
        "orders": list(components.orders),
        "relative_errors": list(components.errors),
        "accepted": components.accepted,
    }


def _plain(value: Any) -> Any:
    """Numbers of numpy as Python's, and what is no finite number as null."""
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
