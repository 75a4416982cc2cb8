"""Figure of one record: measurement with model, residual, and the residual's spectrum, for each output."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from discrepancy.drawing.figure_style import (
    BEFORE,
    FLOOR,
    MEASURED,
    drawing,
    label,
    new_figure,
    noise_band,
    thinned,
    wrapped,
)
from multibody.base.quantity_text import unit_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from estimation.signals.metrics import Agreement

__all__ = ["comparison_figure", "draw_residual_spectrum"]


class ComparedSignal(Protocol):
    """One output of one record, measured and modelled, in its unit."""

    @property
    def record(self) -> str:
        """Name of the record."""

    @property
    def output(self) -> str:
        """Name of the output."""

    @property
    def unit(self) -> str:
        """Unit of the output."""

    @property
    def time(self) -> np.ndarray:
        """Times, shape (n,), s."""

    @property
    def measured(self) -> np.ndarray:
        """Measurement, shape (n,)."""

    @property
    def model(self) -> np.ndarray:
        """Model, shape (n,)."""

    @property
    def residual(self) -> np.ndarray:
        """Measured minus model, shape (n,)."""

    @property
    def noise(self) -> float | None:
        """Noise floor."""

    @property
    def rate(self) -> float:
        """Sampling rate, Hz."""

    @property
    def figures(self) -> Agreement:
        """Figures of agreement."""

    def spectrum(self) -> tuple[np.ndarray, np.ndarray]:
        """Return frequency (Hz) and density (unit²/Hz) of the residual."""


@drawing
def comparison_figure(signals: Sequence[ComparedSignal]) -> Figure:
    """Draw, for each output of a record, measurement with model, residual, and the residual's spectrum."""
    figure, axes = new_figure(len(signals), 3, height=2.4, width=11.0)
    for row, s in zip(axes, signals, strict=True):
        row[0].plot(*thinned(s.time, s.measured), label="measured", **MEASURED)
        row[0].plot(*thinned(s.time, s.model), label="model", **BEFORE)
        row[0].set_title(f"{s.output} on '{s.record}'")
        row[0].set_ylabel(wrapped(label(s.output, s.unit)))
        row[0].legend(loc="best")
        noise_band(row[1], s.noise)
        row[1].plot(*thinned(s.time, s.residual), **BEFORE)
        row[1].set_ylabel(wrapped(label("measured − model", s.unit)))
        row[1].set_title(f"RMS {s.figures.rmse:.3g} {unit_text(s.unit)}")
        for a in row[:2]:
            a.set_xlabel("time [s]")
        draw_residual_spectrum(row[2], s, "residual", BEFORE)
        if s.noise:
            level = s.noise / np.sqrt(0.5 * s.rate)
            row[2].axhline(level, label="noise, if white", **FLOOR)
            row[2].legend(loc="best")
        row[2].set_xlabel("frequency [Hz]")
        row[2].set_ylabel(f"error [{unit_text(s.unit)}/√Hz]")
    return figure


def draw_residual_spectrum(
    axes: Axes, signal: ComparedSignal, name: str, style: dict[str, Any], most: int = 150
) -> None:
    """Draw the amplitude spectrum of a signal's residual."""
    frequency, density = signal.spectrum()
    frequency, density = frequency[1:], np.maximum(density[1:], 1e-300)
    # Lines that lie too close to be seen apart are averaged.
    edges = np.geomspace(frequency[0], frequency[-1] * (1.0 + 1e-9), most + 1)
    at = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, most - 1)
    count = np.bincount(at, minlength=most)
    used = count > 0
    means = [np.bincount(at, weights=x, minlength=most)[used] / count[used] for x in (frequency, density)]
    axes.loglog(means[0], np.sqrt(means[1]), label=name, **style)
