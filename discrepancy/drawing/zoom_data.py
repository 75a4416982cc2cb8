"""Data of the zoomable figures (``templates/zoom.js``): a stretch of a signal, thinned without losing a peak."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.drawing.figure_style import label
from multibody.base.thinning import extreme_rows_of

if TYPE_CHECKING:
    from discrepancy.drawing.comparison_figure import ComparedSignal

__all__ = ["MOST_LINE_ROWS", "zoom_figure"]

MOST_LINE_ROWS = 1200  # rows of each line: two in a column of pixels on a wide screen


def zoom_figure(
    signal: ComparedSignal,
    models: Sequence[tuple[str, str, np.ndarray]],
    *,
    title: str = "",
    start: float = -np.inf,
    stop: float = np.inf,
    most: int = MOST_LINE_ROWS,
    marks: Sequence[tuple[float, float]] = (),
    numbers: bool = True,
) -> dict[str, Any]:
    """Return the data of a figure: measurement and models over a stretch of time.

    Times are kept from the first one that is shown (``"from"``), so that 32 bits tell samples apart in records of days.

    Parameters
    ----------
    signal : ComparedSignal
        Gives time, measurement, noise and names.
    models : sequence of (str, str, ndarray of shape (n,))
        Name, style (``"before"``, ``"after"`` or ``"predicted"``) and values at the signal's times.
    title : str
        Default: output and record.
    start, stop : float, s
        One sample beyond each is included, so that lines reach the edges.
    most : int
        Rows kept of each line and of each residual.
    marks : sequence of (float, float), s
        Stretches to be marked.
    numbers : bool
        If not, the lines are empty: a figure that nobody sees needs only its names.
    """
    time = signal.time
    low = max(0, int(np.searchsorted(time, start)) - 1)
    high = min(time.size, int(np.searchsorted(time, stop, side="right")) + 1)
    part = slice(low, high if numbers else low)
    measured = signal.measured[part]
    lines = [np.asarray(y[part], dtype=float) for _, _, y in models]
    residuals = [measured - y for y in lines]
    rows = extreme_rows_of([measured, *lines, *residuals], most) if numbers else np.arange(0)
    return {
        "title": title or f"{signal.output} on '{signal.record}'",
        "label": label(signal.output, signal.unit),
        "record": signal.record,
        "output": signal.output,
        "whole": [float(time[0]), float(time[-1])],
        "noise": signal.noise or 0.0,
        "marks": [[float(a), float(b)] for a, b in marks],
        "from": float(time[low]),
        "x": _packed(time[part][rows] - time[low]),
        "measured": _packed(measured[rows]),
        "models": [
            {"name": name, "style": style, "y": _packed(y[rows])}
            for (name, style, _), y in zip(models, lines, strict=True)
        ],
    }


def _packed(values: np.ndarray) -> str:
    """Return numbers as base64 of 32-bit floats, which is half as long as their digits."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode("ascii")
