"""The workbench's figures of a record over time: what is drawn of each output, and where the model fails worst."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from discrepancy.drawing.zoom_data import MOST_LINE_ROWS, zoom_figure
from discrepancy.questions.compare import Comparison
from discrepancy.report.figures import stage_title
from discrepancy.stages.stage import Stage
from discrepancy.study.candidates import Prediction

__all__ = ["record_figures", "rows_for"]

STRETCHES = 24  # of a record, of which the worst are marked
COLUMNS = (100, 4000)  # of pixels that a page may ask for at the least and at the most


def rows_for(columns: int | None) -> int:
    """Return how many rows of a line fill a width: two in a column of pixels, so that its extremes are drawn.

    Parameters
    ----------
    columns : int or None
        Pixels across; None where they are not known.
    """
    return MOST_LINE_ROWS if columns is None else 2 * min(max(columns, COLUMNS[0]), COLUMNS[1]) + 2


def record_figures(
    latest: Stage,
    compared: Comparison,
    other: Stage,
    before: Comparison,
    *,
    record: str = "",
    start: float = -np.inf,
    stop: float = np.inf,
    prediction: Prediction | None = None,
    changed: np.ndarray | None = None,
    outputs: Collection[str] | None = None,
    columns: int | None = None,
    names: tuple[str, str] | None = None,
) -> list[dict[str, Any]]:
    """Return the figures of a record: measurement, a stage to compare with, the latest stage, and what is expected.

    Parameters
    ----------
    latest, other : Stage
    compared, before : Comparison
        Of these stages.
    record : str
        Default: the first.
    start, stop : float, s
        The visible stretch.
    prediction : Prediction, optional
        Of a candidate; drawn on identification records.
    changed : ndarray, shape (n, n_outputs), optional
        The latest model with other values of its parameters.
    outputs : collection of str, optional
        Those whose numbers are wanted; the figures of the others have empty lines.  Default: all.
    columns : int, optional
        Pixels across a figure.
    names : (str, str), optional
        Of ``other`` and ``latest``; default: their titles.
    """
    lines = names or (stage_title(other), stage_title(latest))
    shown = compared.of(record=record or None) or compared.of()
    shown = [s for s in shown if s.record == shown[0].record]
    record = shown[0].record
    old = {s.output: s for s in before.of(record=record)}
    figures = []
    for column, signal in enumerate(shown):
        models = []
        if other is not latest and signal.output in old and old[signal.output].model.size == signal.time.size:
            models.append((lines[0], "before", old[signal.output].model))
        models.append((lines[1], "after", signal.model))
        if prediction is not None and record in prediction.records:
            k, c = prediction.records.index(record), prediction.outputs.index(signal.output)
            fall = prediction.before[k][:, c] - prediction.after[k][:, c]
            expected = signal.model + np.interp(signal.time, prediction.times[k], fall)
            models.append((f"predicted with {prediction.name}", "predicted", expected))
        if changed is not None:
            models.append(("with the values of the sliders", "predicted", changed[:, column]))
        figures.append(
            zoom_figure(
                signal,
                models,
                title=signal.output,
                start=start,
                stop=stop,
                most=rows_for(columns),
                marks=_worst(signal.time, signal.residual),
                numbers=outputs is None or signal.output in outputs,
            )
        )
    return figures


def _worst(time: np.ndarray, residual: np.ndarray) -> list[tuple[float, float]]:
    """Return the stretches where a model fails worst: those with most of the error."""
    edges = np.linspace(0, time.size, STRETCHES + 1).astype(int)
    energy = np.add.reduceat(residual**2, edges[:-1])
    limit = 3.0 * float(np.median(energy))
    chosen = [k for k in np.argsort(-energy)[:3] if energy[k] > limit]
    return [(float(time[edges[k]]), float(time[min(edges[k + 1], time.size - 1)])) for k in chosen]
