"""Figures of designs, surfaces, sensitivities and searches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .outcome import OptimisationResult
    from .response_surface import ResponseSurface
    from .sampling import Design
    from .sensitivity import MorrisResult, OneAtATimeResult
    from .variance import SobolResult

__all__ = [
    "plot_design",
    "plot_history",
    "plot_morris",
    "plot_one_at_a_time",
    "plot_sobol",
    "plot_surface",
]


def _figure(width: float, height: float) -> Figure:
    # Figure itself rather than pyplot: no window system, nothing kept open by a global list.
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def plot_design(design: Design) -> Figure:
    """Every pair of parameters against each other, in their units."""
    k = len(design.space)
    labels, x = design.space.labels(), design.points
    figure = _figure(2.2 * max(k - 1, 1), 2.2 * max(k - 1, 1))
    if k == 1:
        axes = figure.subplots()
        axes.plot(x[:, 0], np.zeros(len(design)), "|")
        axes.set_xlabel(labels[0])
        axes.set_yticks([])
        return figure
    grid = figure.subplots(k - 1, k - 1, squeeze=False)
    for row in range(k - 1):
        for column in range(k - 1):
            axes = grid[row, column]
            if column > row:
                axes.set_visible(False)
                continue
            axes.plot(x[:, column], x[:, row + 1], ".")
            if row == k - 2:
                axes.set_xlabel(labels[column])
            if column == 0:
                axes.set_ylabel(labels[row + 1])
    return figure


def plot_surface(surface: ResponseSurface) -> Figure:
    """Predicted against simulated, where there are fitted points, and a cut along each parameter."""
    space = surface.space
    k = len(space)
    label = f"{surface.response} [{surface.unit}]" if surface.unit else surface.response
    fitted = surface.train_points is not None and surface.train_responses is not None
    columns = k + int(fitted)
    figure = _figure(3.0 * columns, 3.0)
    axes = figure.subplots(1, columns, squeeze=False)[0]
    centre = np.full(k, 0.5)
    if fitted:
        y = np.asarray(surface.train_responses)
        axes[0].plot(y, surface.predict(np.asarray(surface.train_points)), ".", label="fitted")
        axes[0].plot(y, y - surface.loo_residuals(), "x", label="left out")
        axes[0].axline((float(y.mean()), float(y.mean())), slope=1.0, color="0.6", lw=0.8)
        axes[0].set_xlabel(f"simulated {label}")
        axes[0].set_ylabel("predicted")
        axes[0].legend()
    for i, (axis, name) in enumerate(zip(axes[int(fitted) :], space.labels(), strict=True)):
        t = np.tile(centre, (101, 1))
        t[:, i] = np.linspace(0.0, 1.0, 101)
        x = space.from_unit(t)
        axis.plot(x[:, i], surface.predict(x))
        axis.set_xlabel(name)
        axis.set_title("others at mid-range", fontsize="small")
    axes[int(fitted)].set_ylabel(label)
    return figure


def plot_one_at_a_time(result: OneAtATimeResult) -> Figure:
    """Response over each parameter's scaled range in one axes, so that the curves compare."""
    figure = _figure(5.5, 3.5)
    axes = figure.subplots()
    for name, row in zip(result.space.names, result.responses, strict=True):
        axes.plot(result.levels, row, ".-", label=name)
    axes.set_xlabel("parameter, scaled to its range [-]")
    axes.set_ylabel("response")
    axes.legend()
    return figure


def plot_morris(result: MorrisResult) -> Figure:
    """Spread (curvature and interaction) over mean size of the elementary effects."""
    figure = _figure(4.5, 3.5)
    axes = figure.subplots()
    axes.plot(result.mu_star, result.sigma, "o")
    for name, x, y in zip(result.space.names, result.mu_star, result.sigma, strict=True):
        axes.annotate(name, (x, y), xytext=(4, 4), textcoords="offset points")
    axes.set_xlabel("mean size of effect over the full range")
    axes.set_ylabel("standard deviation of effect")
    return figure


def plot_sobol(result: SobolResult) -> Figure:
    """First and total variance shares with their intervals."""
    figure = _figure(5.0, 3.5)
    axes = figure.subplots()
    place = np.arange(len(result.space))
    pairs = (
        (result.first, result.first_interval, "alone"),
        (result.total, result.total_interval, "with interactions"),
    )
    for offset, (share, interval, label) in zip((-0.2, 0.2), pairs, strict=True):
        error = np.abs(interval.T - share)
        axes.bar(place + offset, share, 0.38, yerr=error, label=label)
    axes.set_xticks(place, result.space.names)
    axes.set_ylabel("share of the response's variance [-]")
    axes.legend()
    return figure


def plot_history(runs: Sequence[OptimisationResult], target: float | None = None) -> Figure:
    """Best value against evaluations; several runs of one method are drawn as their median and range."""
    figure = _figure(5.5, 3.5)
    axes = figure.subplots()
    for method in dict.fromkeys(run.method for run in runs):
        same = [run for run in runs if run.method == method]
        most = max(run.evaluations for run in same)
        at = np.unique(np.geomspace(1, most, 200).astype(int))
        best = np.array([[run.best_after(int(n)) for n in at] for run in same])
        best[~np.isfinite(best)] = np.nan
        line = axes.step(at, np.median(best, axis=0), where="post", label=method)[0]
        if len(same) > 1:
            axes.fill_between(
                at, best.min(axis=0), best.max(axis=0), step="post", alpha=0.2, color=line.get_color()
            )
    if target is not None:
        axes.axhline(target, color="0.5", ls=":", label="target")
    axes.set_xscale("log")
    axes.set_xlabel("evaluations")
    axes.set_ylabel("best value so far")
    axes.legend()
    return figure
