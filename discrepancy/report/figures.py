"""Figures of a study: error by stage, model and measurement, residuals against motion and frequency."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.conclusion.conclusion import Conclusion, Evidence
from discrepancy.drawing.comparison_figure import draw_residual_spectrum
from discrepancy.drawing.figure_style import (
    AFTER,
    BEFORE,
    FLOOR,
    LEGEND,
    MEASURED,
    drawing,
    label,
    new_figure,
    noise_band,
    plain_log,
    thinned,
    wants_log,
    wrapped,
)
from discrepancy.drawing.zoom_data import zoom_figure
from discrepancy.effects.kinds import kinds
from discrepancy.questions.compare import Comparison, SignalComparison
from multibody.base.quantity_text import readable_scale, unit_text

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from discrepancy.stages.residuals_along_motion import ResidualsAlongMotion
    from discrepancy.stages.stage import Stage

__all__ = [
    "falling_error",
    "falling_words",
    "over_time",
    "residual_against",
    "spectra",
    "stage_title",
    "worst_outputs",
    "zoomable",
]

MOST_FALLING = 6  # outputs whose falling error is drawn
MOST_ZOOMABLE = 6  # outputs, so that the page stays below 3 MB
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
    """Draw the error of the worst outputs from stage to stage, on fitted and on held-out records."""
    outputs = worst_outputs(conclusion, MOST_FALLING)
    figure, axes = new_figure(len(outputs), height=2.1 if len(outputs) > 1 else 3.0, sharex=True)
    names = _stage_labels(conclusion.stages)
    styles = {
        "identify": dict(AFTER, marker="o", markersize=6),
        "validate": dict(BEFORE, marker="s", markersize=6),
    }
    for a, output in zip(axes[:, 0], outputs, strict=True):
        per_part = {part: np.array([s.rmse(part).get(output, np.nan) for s in conclusion.stages]) for part in styles}
        noise = conclusion.baseline.noise.get(output) or 0.0
        known = np.concatenate([*per_part.values(), [noise or np.nan]])
        factor, unit = readable_scale(float(np.nanmedian(known)), conclusion.final.system.unit(output))
        for part, style in styles.items():
            values = per_part[part] / factor
            if not np.any(np.isfinite(values)):
                continue
            a.plot(range(len(values)), values, label=PART_WORDS[part], **style)
            if part == conclusion.judged_on:
                for k, v in enumerate(values):
                    a.annotate(f"{v:.3g}", (k, v), (0, 7), textcoords="offset points", ha="center", fontsize=9)
        if noise:
            a.axhline(noise / factor, label="sensor noise", **FLOOR)
        _error_scale(a, known / factor)
        a.set_title(output)
        a.set_ylabel(f"RMS error [{unit or '–'}]")
        a.set_xlim(-0.4, len(names) - 0.6)
        a.set_xticks(range(len(names)), names)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    if words := falling_words(conclusion):
        figure.suptitle(words, fontsize=10)
    return figure


def falling_words(conclusion: Conclusion) -> str:
    """Return which outputs `falling_error` draws; nothing where it draws all."""
    count = len(conclusion.baseline.outputs)
    if count <= MOST_FALLING:
        return ""
    return f"Drawn are the {MOST_FALLING} of {count} outputs with the largest error against the noise."


def _stage_labels(stages: Sequence[Stage]) -> list[str]:
    """Names of the stages where there is room, else the numbers of their effects in the report."""
    if len(stages) <= 4:
        return [textwrap.fill(stage_title(s), 20) for s in stages]
    labels, count = [], 0
    for s in stages:
        count += s.accepted is not None
        labels.append(s.name if s.accepted is None else f"+ effect {count}")
    return [textwrap.fill(n.replace("recalibrated", "recali- brated"), 9) for n in labels]


def _error_scale(axes: Axes, shown: np.ndarray) -> None:
    good = [v for v in shown if np.isfinite(v) and v > 0.0]
    if wants_log(good):
        plain_log(axes, min(good) / 1.6, max(good) * 2.4)
    elif good:
        axes.set_ylim(0.0, 1.3 * max(good))


# ---------------------------------------------------------------- over time


@drawing
def over_time(conclusion: Conclusion, evidence: Evidence, output: str) -> Figure:
    """Draw measurement and model before and after, the residual, and the worst stretch enlarged."""
    first, last = _first_and_last(conclusion, evidence, output)
    figure, axes = new_figure(3, height=2.2)
    top, middle, zoom = axes[:, 0]
    span = _zoom(first)
    t0, t1 = float(first.time[span][0]), float(first.time[span][-1])
    models = [(first, BEFORE, stage_title(conclusion.baseline))]
    if last is not first:
        models.append((last, AFTER, stage_title(conclusion.final)))
    _signals(top, first, models, slice(None))
    _residuals(middle, first, models, slice(None))
    top.set_title(f"{output} on '{first.record}'")
    middle.set_title("residual: measured minus model")
    # Where the error is too small to be seen in the signal, the residual is enlarged.
    seen = float(np.ptp(first.residual[span])) > 0.08 * float(np.ptp(first.measured[span]))
    (_signals if seen else _residuals)(zoom, first, models, span)
    zoom.set_title("the yellow stretch, enlarged" if seen else "the yellow stretch of the residual, enlarged")
    zoom.set_xlabel("time [s]")
    for a in (top, middle):
        a.axvspan(t0, t1, color="#f0e442", alpha=0.35, linewidth=0)
    handles = dict(zip(*reversed(top.get_legend_handles_labels()), strict=True))
    handles |= {k: v for k, v in zip(*reversed(middle.get_legend_handles_labels()), strict=True) if k not in handles}
    _legend_below(figure, handles)
    return figure


def zoomable(conclusion: Conclusion, evidence: Evidence) -> list[dict[str, Any]]:
    """Return the data of the page's zoomable figures: measurement and model of the worst record, for each output."""
    drawn = []
    for output in worst_outputs(conclusion, MOST_ZOOMABLE):
        first, last = _first_and_last(conclusion, evidence, output)
        models = [(stage_title(conclusion.baseline), "before", first.model)]
        if last is not first:
            models.append((stage_title(conclusion.final), "after", last.model))
        span = _zoom(first)
        marks = [(float(first.time[span][0]), float(first.time[span][-1]))]
        drawn.append(zoom_figure(first, models, marks=marks))
    return drawn


def _legend_below(figure: Figure, handles: Mapping[str, Artist]) -> None:
    """Draw a legend below a figure; names that are long, as those of effects are, go on in a second line."""
    names = [wrapped(name, LEGEND) for name in handles]
    figure.legend(handles.values(), names, loc="outside lower center", ncols=2)


_Models = list[tuple[SignalComparison, dict[str, Any], str]]


def _signals(axes: Axes, first: SignalComparison, models: _Models, part: slice) -> None:
    factor, unit = readable_scale(float(np.max(np.abs(first.measured))), first.unit)
    axes.plot(*thinned(first.time[part], first.measured[part] / factor), label="measured", **MEASURED)
    for signal, style, name in models:
        axes.plot(*thinned(signal.time[part], signal.model[part] / factor), label=f"model, {name}", **style)
    axes.set_ylabel(wrapped(f"{first.output} [{unit or '–'}]"))
    axes.set_xlim(float(first.time[part][0]), float(first.time[part][-1]))


def _residuals(axes: Axes, first: SignalComparison, models: _Models, part: slice) -> None:
    factor, unit = readable_scale(float(np.max(np.abs(first.residual))), first.unit)
    noise_band(axes, first.noise / factor if first.noise else None)
    for signal, style, name in models:
        axes.plot(*thinned(signal.time[part], signal.residual[part] / factor), label=f"model, {name}", **style)
    axes.set_ylabel(wrapped(f"measured − model [{unit or '–'}]"))
    axes.set_xlim(float(first.time[part][0]), float(first.time[part][-1]))


def _first_and_last(
    conclusion: Conclusion, evidence: Evidence, output: str
) -> tuple[SignalComparison, SignalComparison]:
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
def residual_against(
    before: ResidualsAlongMotion, after: ResidualsAlongMotion | None, place: str, output: str
) -> Figure:
    """Draw an output's residual against speed and position of a place, before and after."""
    figure, axes = new_figure(2, height=2.7)
    column = before.outputs.index(output)
    factor, unit = readable_scale(float(np.max(np.abs(before.values[:, column]))), before.units[column])
    motion = next((m for m in before.motions if place in (m.name, *m.also)), before.guides()[0])
    units = dict(motion.place.motion_names())
    names = [n for n, _ in motion.place.motion_names()]
    sets: list[tuple[ResidualsAlongMotion, dict[str, Any], str, str]] = [(before, BEFORE, "recalibrated", "s")]
    if after is not None:
        sets.append((after, AFTER, "with what was added", "o"))
    for a, over, name in ((axes[0, 0], "speed", names[1]), (axes[1, 0], "position", names[0])):
        for residuals, style, word, marker in sets:
            m = next((m for m in residuals.motions if motion.name in (m.name, *m.also)), None)
            if m is None:
                continue
            x, e = getattr(m, over), residuals.values[:, column] / factor
            step = max(1, len(x) // 2500)
            a.plot(x[::step], e[::step], ".", color=style["color"], markersize=2.2, alpha=0.28, rasterized=True)
            centre, mean = _binned(x, e)
            a.plot(
                centre,
                mean,
                marker=marker,
                markersize=5,
                markeredgecolor="white",
                markeredgewidth=0.6,
                label=f"mean, {word}",
                color=style["color"],
                linewidth=1.6,
            )
        a.axhline(0.0, color="#000000", linewidth=0.7)
        a.set_xlabel(label(f"{name} of {motion.name}", units[name]))
        a.set_ylabel(wrapped(f"measured − model [{unit or '–'}]"))
    axes[0, 0].set_title(f"{output}: residual against speed")
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
        draw_residual_spectrum(a, first, stage_title(conclusion.baseline), BEFORE)
        if last is not first:
            draw_residual_spectrum(a, last, stage_title(conclusion.final), AFTER)
        _floor_line(a, first, conclusion)
        a.set_title(f"{output} on '{first.record}'")
        a.set_ylabel(f"error [{unit_text(first.unit)}/√Hz]")
    axes[-1, 0].set_xlabel("frequency [Hz]")
    _legend_below(figure, dict(zip(*reversed(axes[0, 0].get_legend_handles_labels()), strict=True)))
    return figure


def _floor_line(axes: Axes, signal: SignalComparison, conclusion: Conclusion) -> None:
    if not signal.noise:
        return
    fit = conclusion.baseline.fits(signal.part)[0]
    cutoff = fit.experiment.preparation.cutoff(float(fit.experiment.record.rate))
    band = min(cutoff or np.inf, 0.5 * signal.rate)
    level = signal.noise / np.sqrt(band)
    axes.plot([float(signal.spectrum()[0][1]), band], [level, level], label="sensor noise", **FLOOR)
    axes.set_ylim(bottom=0.05 * level)
