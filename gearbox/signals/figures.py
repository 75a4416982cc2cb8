"""Figures of spectra, averages and pairs of signals; colours and labels as in the other reports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from discrepancy.drawing.figure_style import AFTER, BEFORE, MEASURED, drawing, label, new_figure
from gearbox.signals.signal import Signal

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["plot_average", "plot_pair", "plot_spectra", "plot_spectrum"]

Array = NDArray[np.float64]


class Spectrum(Protocol):
    """Amplitudes over frequency, as `gearbox.signals.spectrum.Spectrum` holds them."""

    @property
    def frequencies(self) -> Array: ...
    @property
    def amplitudes(self) -> Array: ...
    @property
    def name(self) -> str: ...
    @property
    def unit(self) -> str: ...


class NamedLines(Protocol):
    """Mesh orders and sidebands in a spectrum, as `gearbox.signals.spectrum.LineTable` holds them."""

    @property
    def mesh_frequency(self) -> float: ...
    @property
    def shafts(self) -> Mapping[str, float]: ...
    @property
    def lines(self) -> Sequence[Any]: ...
    @property
    def mesh(self) -> Sequence[Any]: ...


class Average(Protocol):
    """A synchronous average over the shaft's angle, as `gearbox.signals.orders.SynchronousAverage` holds it."""

    @property
    def angle(self) -> Array: ...
    @property
    def values(self) -> Array: ...
    @property
    def std_error(self) -> float: ...
    @property
    def count(self) -> int: ...
    @property
    def share(self) -> float: ...
    @property
    def unit(self) -> str: ...


_SHAFTS = ("#D55E00", "#009E73", "#CC79A7")
_WIDE = 8.0


@drawing
def plot_spectrum(
    spectrum: Spectrum,
    lines: NamedLines | None = None,
    *,
    band: tuple[float, float] | None = None,
    zoom: int | None = None,
) -> Figure:
    """Amplitude spectrum with mesh orders and sidebands marked.

    Parameters
    ----------
    spectrum : Spectrum
    lines : LineTable, optional
        What is marked: filled where found, hollow where it was looked for and not found.
    band : (float, float), optional, Hz
        Range shown.
    zoom : int, optional
        A mesh order that a second panel shows closely; by default the strongest.
    """
    rows = 1 if lines is None or not lines.mesh else 2
    figure, axes = new_figure(rows, height=2.7, width=_WIDE)
    low, high = band or (0.0, float(spectrum.frequencies[-1]))
    _one(axes[0, 0], spectrum, lines, (low, high), sidebands=rows == 1)
    if rows == 2:
        assert lines is not None
        strongest = max(lines.mesh, key=lambda line: line.amplitude).mesh_order
        centre = (zoom or strongest) * lines.mesh_frequency
        reach = 2.6 * max(lines.shafts.values(), default=0.1 * lines.mesh_frequency)
        _one(axes[1, 0], spectrum, lines, (centre - reach, centre + reach), sidebands=True)
        axes[1, 0].set_title(f"Around {zoom or strongest} × mesh")
        axes[1, 0].set_ylim(top=60.0 * axes[1, 0].get_ylim()[1])
        axes[1, 0].legend(loc="upper right", ncols=2)
    axes[0, 0].set_title(spectrum.name)
    return figure


def _one(
    axes: Any, spectrum: Spectrum, lines: NamedLines | None, band: tuple[float, float], *, sidebands: bool
) -> None:
    shown = (spectrum.frequencies >= band[0]) & (spectrum.frequencies <= band[1])
    f, a = spectrum.frequencies[shown], spectrum.amplitudes[shown]
    top = max(float(a.max(initial=0.0)), 1e-300)
    axes.semilogy(f, np.maximum(a, 1e-5 * top), color="#777777", linewidth=0.8)
    if lines is not None:
        colour = dict(zip(lines.shafts, _SHAFTS, strict=False))
        groups = [("", "mesh", "o", "#0072B2")]
        if sidebands:
            groups += [(s, f"sideband of the {s}", "vs^"[i % 3], colour[s]) for i, s in enumerate(lines.shafts)]
        for shaft, name, marker, tone in groups:
            for detected in (True, False):
                drawn = [x for x in lines.lines if x.shaft == shaft and x.found == detected]
                drawn = [x for x in drawn if band[0] <= x.frequency <= band[1]]
                if not drawn:
                    continue
                axes.plot(
                    [x.frequency for x in drawn],
                    [x.amplitude for x in drawn],
                    marker,
                    color=tone,
                    markerfacecolor=tone if detected else "white",
                    markersize=5,
                    label=name if detected else f"{name}: not found",
                )
                for x in drawn if shaft == "" else ():
                    axes.annotate(
                        f"{x.mesh_order}×",
                        (x.frequency, x.amplitude),
                        xytext=(0, 5),
                        textcoords="offset points",
                        ha="center",
                        fontsize=8,
                        color=tone,
                    )
    positive = a[a > 0.0]
    floor = float(np.quantile(positive, 0.02)) if positive.size else 1e-5 * top
    axes.set_ylim(max(floor, 1e-5 * top) * 0.5, 4.0 * top)
    axes.set_xlim(*band)
    axes.set_xlabel(label("frequency", "Hz"))
    axes.set_ylabel(label("amplitude, peak", spectrum.unit))


@drawing
def plot_spectra(spectra: Sequence[tuple[str, Spectrum]], band: tuple[float, float], mesh: float) -> Figure:
    """Several spectra above each other on one scale of frequency, mesh orders marked by lines."""
    figure, axes = new_figure(len(spectra), height=1.9, width=_WIDE, sharex=True)
    for axis, (name, spectrum) in zip(axes[:, 0], spectra, strict=True):
        shown = (spectrum.frequencies >= band[0]) & (spectrum.frequencies <= band[1])
        a = spectrum.amplitudes[shown]
        axis.semilogy(spectrum.frequencies[shown], np.maximum(a, 1e-5 * a.max()), color="#222222", linewidth=0.8)
        for k in range(1, int(band[1] / mesh) + 1):
            axis.axvline(k * mesh, color="#0072B2", linewidth=0.8, linestyle=":")
        axis.set_title(name)
        axis.set_ylabel(label("amplitude, peak", spectrum.unit))
        axis.set_ylim(max(1e-5 * a.max(), 0.5 * float(np.quantile(a, 0.02))), 3.0 * a.max())
    axes[-1, 0].set_xlabel(label("frequency", "Hz"))
    axes[-1, 0].set_xlim(*band)
    return figure


@drawing
def plot_average(average: Average) -> Figure:
    """A synchronous average over the shaft's angle, with the band of its standard error."""
    figure, axes = new_figure(1, height=2.6, width=_WIDE)
    axis = axes[0, 0]
    axis.plot(average.angle, average.values, color="#0072B2", linewidth=0.9)
    axis.axhspan(
        -2 * average.std_error, 2 * average.std_error, color="#cccccc", alpha=0.6, linewidth=0, label="±2 × std. error"
    )
    axis.set_xlabel("shaft angle [rev]")
    axis.set_ylabel(label("average", average.unit))
    axis.set_title(f"{average.count} periods; {100 * average.share:.1f} % of the energy repeats")
    axis.legend(loc="upper right")
    return figure


@drawing
def plot_pair(
    pairs: Sequence[tuple[str, Signal, Signal, Signal | None]], *, shown: float = 0.02, start: float = 0.1
) -> Figure:
    """Measured and modelled signals over a stretch of time, for several conditions.

    Parameters
    ----------
    pairs : sequence of (title, measured, before, after)
        Signals already aligned; ``after`` may be None.
    shown, start : float, s
        Length and beginning of the stretch.
    """
    figure, axes = new_figure(len(pairs), height=2.0, width=_WIDE, sharex=True)
    for axis, (title, measured, before, after) in zip(axes[:, 0], pairs, strict=True):
        rows = slice(round(start * measured.rate), round((start + shown) * measured.rate))
        t = 1e3 * np.arange(len(measured))[rows] / measured.rate
        axis.plot(t, measured.values[rows], **MEASURED, label="measured")
        axis.plot(t, before.values[rows], **BEFORE, label="model before")
        if after is not None:
            axis.plot(t, after.values[rows], **AFTER, label="model after")
        axis.set_title(title)
        axis.set_ylabel(label("processed signal", measured.unit))
    axes[0, 0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)
    axes[-1, 0].set_xlabel(label("time", "ms"))
    return figure
