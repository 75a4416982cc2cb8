"""Figures about effects: scores of the candidates, shifts of the parameters, curve of an unknown force."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discrepancy.drawing.figure_style import AFTER, BEFORE, drawing, label, new_figure
from discrepancy.effects.kinds import kinds
from discrepancy.report.figures import stage_title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from discrepancy.conclusion.conclusion import Conclusion
    from discrepancy.questions.unknown_force import UnknownCurve
    from discrepancy.statistics.scan_result import ScanResult

__all__ = ["candidate_scores", "parameter_shifts", "unknown_curve"]


def _short(kind: str) -> str:
    """Kind in words, without brackets."""
    known = kinds().get(kind)
    return known.text.title.partition(" (more")[0] if known else kind


@drawing
def candidate_scores(scan: ScanResult, most: int = 14, title: str = "") -> Figure:
    """Draw the size of each candidate in standard errors, with the critical size at which it is significant."""
    rows = sorted(scan.rows, key=lambda r: -r.score / r.inflation)[:most]
    from matplotlib.ticker import FuncFormatter, NullFormatter

    figure, axes = new_figure(1, height=1.0 + 0.3 * max(len(rows), 2))
    a = axes[0, 0]
    score = np.sqrt([max(r.score / r.inflation, 0.0) for r in rows])
    critical = np.array([r.critical_ratio for r in rows])
    significant = np.array([r.p_value < scan.level for r in rows], dtype=bool)
    y = np.arange(len(rows))[::-1]
    for chosen, colour, hatch, word in (
        (significant, AFTER["color"], "", "significant"),
        (~significant, "#bbbbbb", "////", "not significant"),
    ):
        if chosen.any():
            a.barh(
                y[chosen],
                score[chosen],
                color=colour,
                hatch=hatch,
                edgecolor="white",
                height=0.72,
                label=word,
            )
    a.plot(
        critical,
        y,
        linestyle="none",
        marker="|",
        markersize=14,
        markeredgewidth=2.2,
        color=BEFORE["color"],
        label="critical size",
    )
    a.set_yticks(y, [f"{_short(r.kind)}, {r.where}" for r in rows], fontsize=8.5)
    if len(rows) and float(score.max()) > 8.0 * float(np.nanmax(critical)):
        a.set_xscale("log")
        a.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
        a.xaxis.set_minor_formatter(NullFormatter())
        a.set_xlim(left=0.4 * float(np.nanmin(critical)))
    for tick, row in zip(a.get_yticklabels(), rows, strict=True):
        if scan.best is not None and row.name == scan.best.name:
            tick.set_fontweight("bold")
    a.set_xlabel("size of the effect in standard errors", loc="right")  # beside long names the axis is narrower
    a.grid(False, axis="y")
    if title:
        figure.suptitle(title, fontsize=10.5, fontweight="bold")
    figure.legend(*a.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def parameter_shifts(conclusion: Conclusion) -> Figure | None:
    """Draw how far calibration moved each parameter, in standard deviations of its prior.

    None where no parameter had a prior standard deviation.
    """
    wanted = [p for p in conclusion.baseline.identify.parameters if np.isfinite(p.std) and p.std > 0.0]
    return _parameter_shifts(conclusion, [p.name for p in wanted]) if wanted else None


@drawing
def _parameter_shifts(conclusion: Conclusion, names: list[str]) -> Figure:
    figure, axes = new_figure(1, height=1.6 + 0.45 * len(names))
    a = axes[0, 0]
    y = np.arange(len(names))[::-1].astype(float)
    a.axvspan(-1.0, 1.0, color="#dddddd", linewidth=0, label="prior (±1 standard deviation)")
    a.axvline(0.0, color="#000000", linewidth=0.8)
    stages = [(conclusion.baseline, BEFORE, "s", 0.14)]
    if conclusion.final is not conclusion.baseline:
        stages.append((conclusion.final, AFTER, "o", -0.14))
    for stage, style, marker, up in stages:
        calibration = stage.identify
        prior = {p.name: p for p in calibration.parameters}
        own = [n for n in names if n in prior]
        x = [(calibration[n] - prior[n].value) / prior[n].std for n in own]
        std = {n: calibration.std_of(n) for n in own}
        bar = [min(std[n] / prior[n].std, 1e3) if np.isfinite(std[n]) else 0.0 for n in own]
        rows = [y[names.index(n)] + up for n in own]
        a.errorbar(
            x,
            rows,
            xerr=bar,
            linestyle="none",
            marker=marker,
            color=style["color"],
            capsize=3,
            markersize=6,
            label=stage_title(stage),
        )
    a.set_yticks(y, names)
    a.set_ylim(-0.6, len(names) - 0.4)
    a.set_xlabel("shift from the value given, in prior standard deviations")
    a.grid(False, axis="y")
    figure.legend(*a.get_legend_handles_labels(), loc="outside lower center", ncols=1)
    return figure


@drawing
def unknown_curve(curve: UnknownCurve) -> Figure:
    """Draw an unknown force over its argument, with a band of two standard deviations."""
    figure, axes = new_figure(1, height=3.0)
    a = axes[0, 0]
    std = np.where(np.isfinite(curve.std), curve.std, 0.0)
    a.fill_between(
        curve.x,
        curve.force - 2.0 * std,
        curve.force + 2.0 * std,
        color=AFTER["color"],
        alpha=0.2,
        linewidth=0,
        label="±2 standard deviations",
    )
    a.plot(curve.x, curve.force, marker="o", markersize=5, label="estimated force", **AFTER)
    a.axhline(0.0, color="#000000", linewidth=0.7)
    over = "position" if curve.regressor == "friction" else curve.regressor
    a.set_xlabel(label(over, curve.regressor_unit))
    a.set_ylabel(label("friction level" if curve.regressor == "friction" else "force", curve.unit))
    a.set_title(f"unidentified force at {curve.where}")
    a.legend(loc="best")
    return figure
