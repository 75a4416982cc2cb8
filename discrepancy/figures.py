"""The figures of a study: falling error, model beside measurement, residuals against speed, position and frequency."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.compare import Comparison, SignalComparison
from discrepancy.kinds import kinds
from discrepancy.plotting import (
    AFTER, BEFORE, FLOOR, MEASURED, drawing, label, new_figure, noise_band, thinned, unit_text, wants_log,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from discrepancy.diagnosis import Conclusion, Evidence
    from discrepancy.residuals import Residuals
    from discrepancy.stage import Stage

__all__ = [
    "comparison_figure", "falling_error", "over_time", "residual_against", "spectra", "stage_title", "worst_outputs",
]

PART_WORDS = {"identify": "records used for fitting", "validate": "records held out"}


def stage_title(stage: Stage) -> str:
    """Return a stage's name in words: ``"as given"``, ``"recalibrated"``, ``"+ dry friction at guide"``."""
    if stage.accepted is None:
        return stage.name
    effect = stage.accepted.effect
    known = kinds().get(effect.kind)
    return f"+ {known.text.title if known else effect.kind} at {effect.where}"


def worst_outputs(conclusion: Conclusion, most: int = 3) -> list[str]:
    """Return the outputs in the order of the recalibrated error over the noise, at most so many."""
    stage, part = conclusion.baseline, conclusion.judged_on
    rmse = stage.rmse(part)

    def size(name: str) -> float:
        noise = stage.noise.get(name) or 0.0
        column = stage.outputs.index(name)
        spread = np.std(np.concatenate([f.experiment.measured[:, column] for f in stage.fits(part)]))
        return rmse[name] / (noise or float(spread) or 1.0)

    return sorted(rmse, key=size, reverse=True)[:most]


# ---------------------------------------------------------------- falling error


@drawing
def falling_error(conclusion: Conclusion) -> Figure:
    """Draw the error of every output from stage to stage, on fitted and on held-out records."""
    outputs = worst_outputs(conclusion, 6)
    figure, axes = new_figure(len(outputs), height=2.1 if len(outputs) > 1 else 3.0, sharex=True)
    names = [textwrap.fill(stage_title(s), 20) for s in conclusion.stages]
    styles = {"identify": dict(AFTER, marker="o", markersize=6), "validate": dict(BEFORE, marker="s", markersize=6)}
    for a, output in zip(axes[:, 0], outputs, strict=True):
        shown: list[float] = []
        for part, style in styles.items():
            values = [s.rmse(part).get(output, np.nan) for s in conclusion.stages]
            if not np.any(np.isfinite(values)):
                continue
            a.plot(range(len(values)), values, label=PART_WORDS[part], **style)
            shown += values
            if part == conclusion.judged_on:
                for k, v in enumerate(values):
                    a.annotate(f"{v:.3g}", (k, v), (0, 7), textcoords="offset points", ha="center", fontsize=9)
        noise = conclusion.baseline.noise.get(output)
        if noise:
            a.axhline(noise, label="noise of the sensor", **FLOOR)
            shown.append(noise)
        _error_scale(a, shown)
        a.set_title(output)
        a.set_ylabel(label("RMS error", conclusion.final.system.unit(output)))
        a.set_xlim(-0.4, len(names) - 0.6)
        a.set_xticks(range(len(names)), names)
    axes[0, 0].legend(loc="upper right" if len(conclusion.stages) > 1 else "best")
    return figure


def _error_scale(axes: Axes, shown: Sequence[float]) -> None:
    good = [v for v in shown if np.isfinite(v) and v > 0.0]
    if wants_log(good):
        axes.set_yscale("log")
        axes.set_ylim(min(good) / 1.6, max(good) * 2.2)
        axes.grid(True, which="minor", axis="y", alpha=0.4)
    elif good:
        axes.set_ylim(0.0, 1.3 * max(good))


# ---------------------------------------------------------------- over time


@drawing
def over_time(conclusion: Conclusion, evidence: Evidence, output: str) -> Figure:
    """Draw measurement and model before and after, the residuals, and a closer look where the error was largest."""
    first, last = _first_and_last(conclusion, evidence, output)
    figure, axes = new_figure(3, height=2.15)
    top, middle, zoom = axes[:, 0]
    unit = first.unit
    same = last is first
    before, after = stage_title(conclusion.baseline), stage_title(conclusion.final)
    span = _zoom(first)
    for a, part in ((top, slice(None)), (zoom, span)):
        t = first.time[part]
        a.plot(*thinned(t, first.measured[part]), label="measured", **MEASURED)
        a.plot(*thinned(t, first.model[part]), label=f"model, {before}", **BEFORE)
        if not same:
            a.plot(*thinned(t, last.model[part]), label=f"model, {after}", **AFTER)
        a.set_ylabel(label(output, unit))
        a.set_xlim(float(t[0]), float(t[-1]))
    noise_band(middle, first.noise)
    middle.plot(*thinned(first.time, first.residual), label=before, **BEFORE)
    if not same:
        middle.plot(*thinned(last.time, last.residual), label=after, **AFTER)
    middle.set_ylabel(label("measured − model", unit))
    middle.set_xlim(float(first.time[0]), float(first.time[-1]))
    t0, t1 = float(first.time[span][0]), float(first.time[span][-1])
    for a in (top, middle):
        a.axvspan(t0, t1, color="#f0e442", alpha=0.35, linewidth=0)
    top.set_title(f"{output} on '{first.record}' ({PART_WORDS[first.part]})")
    middle.set_title("what is left: measured minus model")
    zoom.set_title("closer look where the error was largest (yellow above)")
    zoom.set_xlabel("time [s]")
    for a in (top, middle):
        _headroom(a)
        a.legend(loc="upper center", ncols=3 if a is middle else 1 + (not same), fontsize=8.5)
    return figure


def _headroom(axes: Axes, share: float = 0.38) -> None:
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + share * (high - low))


def _first_and_last(conclusion: Conclusion, evidence: Evidence, output: str) -> tuple[SignalComparison, SignalComparison]:
    part = conclusion.judged_on
    baseline = evidence.comparisons[conclusion.stages.index(conclusion.baseline)]
    final: Comparison = evidence.comparisons[-1]
    first = max(baseline.of(part, output=output), key=lambda s: s.figures.rmse)
    return first, final.of(part, first.record, output)[0] if final is not baseline else first


def _zoom(signal: SignalComparison, share: float = 0.12) -> slice:
    """Stretch of the record around the time where the error is largest over a while, not at one sample."""
    n = len(signal.time)
    width = max(10, int(share * n))
    energy = np.convolve(signal.residual**2, np.ones(max(3, width // 6)), mode="same")
    centre = int(np.argmax(energy))
    first = int(np.clip(centre - width // 2, 0, max(0, n - width)))
    return slice(first, min(n, first + width))


# ---------------------------------------------------------------- against motion


@drawing
def residual_against(before: Residuals, after: Residuals | None, place: str, output: str) -> Figure:
    """Draw an output's residual against speed and position of a place, with the mean in bins, before and after."""
    figure, axes = new_figure(2, height=2.7)
    column = before.outputs.index(output)
    unit = before.units[column]
    motion = next((m for m in before.motions if place in (m.name, *m.also)), before.guides()[0])
    units = dict(motion.place.motion_names())
    names = [n for n, _ in motion.place.motion_names()]
    sets: list[tuple[Residuals, dict[str, Any], str, str]] = [(before, BEFORE, "recalibrated", "s")]
    if after is not None:
        sets.append((after, AFTER, "with what was added", "o"))
    for a, over, name in ((axes[0, 0], "speed", names[1]), (axes[1, 0], "position", names[0])):
        for facts, style, word, marker in sets:
            m = next((m for m in facts.motions if motion.name in (m.name, *m.also)), None)
            if m is None:
                continue
            x, e = getattr(m, over), facts.values[:, column]
            step = max(1, len(x) // 2500)
            a.plot(x[::step], e[::step], ".", color=style["color"], markersize=2.2, alpha=0.28, rasterized=True)
            centre, mean = _binned(x, e)
            a.plot(centre, mean, marker=marker, markersize=5, markeredgecolor="white", markeredgewidth=0.6,
                   label=f"mean, {word}", color=style["color"], linewidth=1.6)
        a.axhline(0.0, color="#000000", linewidth=0.7)
        a.set_xlabel(label(f"{name} of {motion.name}", units[name]))
        a.set_ylabel(label("measured − model", unit))
    axes[0, 0].set_title(f"{output}: what the model misses, against speed")
    axes[1, 0].set_title("against position")
    axes[0, 0].legend(loc="best")
    return figure


def _binned(x: np.ndarray, e: np.ndarray, count: int = 24) -> tuple[np.ndarray, np.ndarray]:
    edges = np.linspace(x.min(), x.max(), count + 1)
    k = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, count - 1)
    size = np.bincount(k, minlength=count)
    mean = np.bincount(k, weights=e, minlength=count) / np.maximum(size, 1)
    return 0.5 * (edges[1:] + edges[:-1])[size >= 5], mean[size >= 5]


# ---------------------------------------------------------------- spectra


@drawing
def spectra(conclusion: Conclusion, evidence: Evidence, outputs: Sequence[str]) -> Figure:
    """Draw the residual's amplitude spectrum before and after against the noise floor."""
    figure, axes = new_figure(len(outputs), height=2.4, sharex=True)
    for a, output in zip(axes[:, 0], outputs, strict=True):
        first, last = _first_and_last(conclusion, evidence, output)
        _spectrum(a, first, stage_title(conclusion.baseline), BEFORE)
        if last is not first:
            _spectrum(a, last, stage_title(conclusion.final), AFTER)
        _floor_line(a, first, conclusion)
        a.set_title(f"{output} on '{first.record}'")
        a.set_ylabel(f"error [{unit_text(first.unit)}/√Hz]")
    axes[-1, 0].set_xlabel("frequency [Hz]")
    axes[0, 0].legend(loc="best")
    return figure


def _spectrum(axes: Axes, signal: SignalComparison, name: str, style: dict[str, Any]) -> None:
    frequency, density = signal.spectrum()
    axes.loglog(frequency[1:], np.sqrt(np.maximum(density[1:], 1e-300)), label=name, **style)


def _floor_line(axes: Axes, signal: SignalComparison, conclusion: Conclusion) -> None:
    if not signal.noise:
        return
    fit = conclusion.baseline.fits(signal.part)[0]
    cutoff = fit.experiment.preparation.cutoff(float(fit.experiment.record.rate))
    band = min(cutoff or np.inf, 0.5 * signal.rate)
    level = signal.noise / np.sqrt(band)
    axes.plot([signal.rate / len(signal.time), band], [level, level], label="noise of the sensor", **FLOOR)
    axes.set_ylim(bottom=0.05 * level)


# ---------------------------------------------------------------- one comparison


@drawing
def comparison_figure(signals: Sequence[SignalComparison]) -> Figure:
    """Draw, for each output of a record, measurement with model, residual, and the residual's spectrum."""
    figure, axes = new_figure(len(signals), 3, height=2.4, width=11.0)
    for row, s in zip(axes, signals, strict=True):
        row[0].plot(*thinned(s.time, s.measured), label="measured", **MEASURED)
        row[0].plot(*thinned(s.time, s.model), label="model", **BEFORE)
        row[0].set_title(f"{s.output} on '{s.record}'")
        row[0].set_ylabel(label(s.output, s.unit))
        row[0].legend(loc="best")
        noise_band(row[1], s.noise)
        row[1].plot(*thinned(s.time, s.residual), **BEFORE)
        row[1].set_ylabel(label("measured − model", s.unit))
        row[1].set_title(f"RMS {s.figures.rmse:.3g} {unit_text(s.unit)}")
        for a in row[:2]:
            a.set_xlabel("time [s]")
        _spectrum(row[2], s, "residual", BEFORE)
        if s.noise:
            level = s.noise / np.sqrt(0.5 * s.rate)
            row[2].axhline(level, label="noise, if white", **FLOOR)
            row[2].legend(loc="best")
        row[2].set_xlabel("frequency [Hz]")
        row[2].set_ylabel(f"error [{unit_text(s.unit)}/√Hz]")
    return figure
