"""What the workbench's views show of a finished stage: lists of numbers and sentences for the page."""

from __future__ import annotations

from typing import Any

import numpy as np

from discrepancy.evidence.standstill import STANDSTILL
from discrepancy.questions.compare import Comparison
from discrepancy.questions.locate import locate
from discrepancy.stages.force_estimate import load_at
from discrepancy.stages.residuals_along_motion import PlaceMotion, ResidualsAlongMotion, residuals_along_motion
from discrepancy.stages.stage import Stage
from estimation.signals.metrics import coherence, frequency_response
from multibody.base.quantity_text import unit_text
from multibody.machine.model import Model

__all__ = ["against_motion", "by_record", "machine", "spectra", "where"]

MOST_POINTS = 1500  # of a cloud of residuals: more do not show on a screen
BINS = 24  # of the mean of a cloud

Entry = dict[str, Any]


def machine(model: Model) -> Entry:
    """Return the graph of a model: its components and their connections."""
    nodes = [{"name": n, "type": type(c).__name__} for n, c in model.components.items()]
    edges = []
    for ends in model.connections:
        owners = list(dict.fromkeys(str(e).partition(".")[0] for e in ends))
        edges += [[owners[0], other] for other in owners[1:]]
    return {"nodes": nodes, "edges": edges}


def where(stage: Stage) -> list[Entry]:
    """Return in sentences where a stage's model fails."""
    located = locate(stage).to_dict()
    headings = {
        "signals": "In which signal",
        "regimes": "When",
        "dependence": "Along what",
        "frequencies": "At which frequencies",
        "connections": "At which connection",
    }
    return [
        {"heading": heading, "sentences": [e["sentence"] for e in located[name][:6]]}
        for name, heading in headings.items()
        if located[name]
    ]


def by_record(comparison: Comparison, other: Comparison | None = None) -> list[Entry]:
    """Return the error by record and output, and that of another stage as ``before`` (None where it has none)."""
    before = {(s.record, s.output): s.figures.rmse for s in other} if other is not None else {}
    return [
        {
            "record": s.record,
            "part": s.part,
            "output": s.output,
            "unit": unit_text(s.unit),
            "rmse": s.figures.rmse,
            "before": before.get((s.record, s.output)),
            "nrmse": s.figures.nrmse,
            "over_noise": s.over_noise,
        }
        for s in comparison
    ]


# -------------------------------------------------------------------- over motion


def against_motion(stage: Stage, output: str) -> Entry:
    """Return the residual of an output over speed, position, acceleration and load of every connection that moves.

    Returns
    -------
    dict
        ``clouds``, each with ``place``, ``over``, ``unit``, ``x``, ``y``, ``direction`` (of each point: 1, -1 or 0 at
        rest) and ``means`` (of a direction: ``x`` and ``y`` in bins); and ``regimes``, the root mean square by
        ``place`` and ``regime`` with its ``share`` of the time.

    Raises
    ------
    KeyError
        If there is no such output.
    """
    residuals = stage.once(("residuals along motion",), lambda: residuals_along_motion(stage))
    if output not in residuals.outputs:
        raise KeyError(f"there is no output '{output}': take one of {', '.join(residuals.outputs)}")
    e = residuals.values[:, residuals.outputs.index(output)]
    clouds, regimes = [], []
    for motion in residuals.motions:
        direction = _direction(motion)
        clouds += [
            {"place": motion.name, "over": over, "unit": unit, **_cloud(x, e, direction)}
            for over, unit, x in _regressors(stage, residuals, motion)
        ]
        for sign, words in ((1, "forwards"), (-1, "backwards"), (0, "at rest")):
            rows = direction == sign
            if np.any(rows):
                rms, share = float(np.sqrt(np.mean(e[rows] ** 2))), float(np.mean(rows))
                regimes.append({"place": motion.name, "regime": words, "rms": rms, "share": share})
    return {"unit": unit_text(stage.system.unit(output)), "clouds": clouds, "regimes": regimes}


def _direction(motion: PlaceMotion) -> np.ndarray:
    moving = np.abs(motion.speed) > STANDSTILL * float(np.max(np.abs(motion.speed)))
    direction: np.ndarray = np.where(moving, np.sign(motion.speed), 0.0).astype(int)
    return direction


def _regressors(
    stage: Stage, residuals: ResidualsAlongMotion, motion: PlaceMotion
) -> list[tuple[str, str, np.ndarray]]:
    turns = motion.place.domain == "rotation"
    unit = "rad" if turns else "m"
    regressors = [
        ("speed", f"{unit}/s", motion.speed),
        ("position", unit, motion.position),
        ("acceleration", f"{unit}/s²", motion.acceleration),
    ]
    if load := load_at(stage, motion.place):
        values = _along_records(residuals, load)
        if np.ptp(values) > 0.0:
            regressors.append(("load", "N·m" if turns else "N", values))
    return regressors


def _along_records(residuals: ResidualsAlongMotion, name: str) -> np.ndarray:
    """Return an output of the model at the samples that were compared, all records one after another."""
    linearised = residuals.linearised
    calibration = residuals.stage.identify
    parts = []
    for i, fit in enumerate(calibration.fits):
        run = linearised.nominal_outputs(i)[name]
        parts.append(fit.experiment.preparation.apply(np.asarray(linearised.experiments[i].record.time), run)[1])
    return np.concatenate(parts)


def _cloud(x: np.ndarray, y: np.ndarray, direction: np.ndarray) -> Entry:
    step = max(1, y.size // MOST_POINTS)
    means = {}
    for sign in (1, -1):
        rows = direction == sign
        if np.count_nonzero(rows) >= 2 * BINS:
            means[str(sign)] = _binned(x[rows], y[rows])
    thin = slice(None, None, step)
    return {"x": x[thin].tolist(), "y": y[thin].tolist(), "direction": direction[thin].tolist(), "means": means}


def _binned(x: np.ndarray, y: np.ndarray) -> Entry:
    """Return the mean of y in bins of x that hold equally many points."""
    order = np.argsort(x)
    parts = [p for p in np.array_split(order, BINS) if p.size]
    return {"x": [float(np.mean(x[p])) for p in parts], "y": [float(np.mean(y[p])) for p in parts]}


# -------------------------------------------------------------------- over frequency


def spectra(stage: Stage, comparison: Comparison, record: str = "") -> list[Entry]:
    """Return of each output of a record: spectra, coherence with the model, and responses from every input.

    Returns
    -------
    list of dict
        ``output``, ``unit``, ``frequency`` (Hz), amplitude densities ``measured``, ``model``, ``residual``,
        ``coherence``, and ``responses``: ``input``, ``unit``, ``measured``, ``model`` (magnitudes) and ``coherence`` of
        the input with the measured output.
    """
    shown = comparison.of(record=record or None)
    entries = []
    for s in (s for s in shown if s.record == shown[0].record):
        frequency, residual = s.spectrum()
        measured, model = s.spectrum("measured")[1], s.spectrum("model")[1]
        amplitudes = [np.sqrt(np.maximum(d[1:], 1e-300)).tolist() for d in (measured, model, residual)]
        entries.append(
            {
                "output": s.output,
                "unit": unit_text(s.unit),
                "record": s.record,
                "frequency": frequency[1:].tolist(),
                "coherence": s.coherence()[1][1:].tolist(),
                **dict(zip(("measured", "model", "residual"), amplitudes, strict=True)),
                "responses": _responses(stage, s.record, s.output, s.time, s.measured, s.model, s.rate),
            }
        )
    return entries


def _responses(
    stage: Stage, record: str, output: str, time: np.ndarray, measured: np.ndarray, model: np.ndarray, rate: float
) -> list[Entry]:
    fits = [f for part in ("identify", "validate") for f in stage.fits(part) if f.experiment.name == record]
    if not fits:
        return []
    experiment = fits[0].experiment
    responses = []
    for name in experiment.inputs:
        given = experiment.record.signals[name]
        when, u = experiment.preparation.apply(np.asarray(experiment.record.time), np.asarray(given.values))
        u = np.interp(time, when, u)
        if not np.ptp(u) > 0.0:
            continue
        one, other = (frequency_response(u, y, rate)[1][1:] for y in (measured, model))
        responses.append(
            {
                "input": name,
                "unit": f"{unit_text(stage.system.unit(output)) or '1'} / {unit_text(given.unit) or '1'}",
                "measured": np.abs(one).tolist(),
                "model": np.abs(other).tolist(),
                "coherence": coherence(u, measured, rate)[1][1:].tolist(),
            }
        )
    return responses
