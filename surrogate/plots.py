"""Figures of designs, surfaces, sensitivities and searches, from names and arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from surrogate.space import DesignSpace

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "plot_design",
    "plot_history",
    "plot_morris",
    "plot_one_at_a_time",
    "plot_sobol",
    "plot_surface",
]

Array = NDArray[np.float64]


class SearchRun(Protocol):
    """What a history needs of the run of an optimiser."""

    @property
    def method(self) -> str:
        """Which method searched."""
        ...

    @property
    def evaluations(self) -> int:
        """Calls of the function."""
        ...

    def best_after(self, evaluations: int) -> float:
        """Return the best value within so many evaluations."""
        ...


def _figure(width: float, height: float) -> Figure:
    # Figure itself rather than pyplot: no window system, nothing kept open by a global list.
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def plot_design(space: DesignSpace, x: Array) -> Figure:
    """Draw every pair of parameters against each other; points x, shape (n, k), in the parameters' units."""
    k = len(space)
    labels = space.labels()
    figure = _figure(2.2 * max(k - 1, 1), 2.2 * max(k - 1, 1))
    if k == 1:
        axes = figure.subplots()
        axes.plot(x[:, 0], np.zeros(len(x)), "|")
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


def plot_surface(
    space: DesignSpace,
    predict: Callable[[Array], Array],
    label: str,
    fitted: tuple[Array, Array, Array] | None = None,
) -> Figure:
    """Draw a cut along each parameter and, where there are fitted points, predicted against simulated responses.

    Parameters
    ----------
    space : DesignSpace
        The parameters.
    predict : callable
        Takes points, shape (n, k), in the parameters' units and returns responses, shape (n,).
    label : str
        Name of the response, with its unit.
    fitted : tuple of three ndarray of shape (n,), optional
        Responses of the fitted points, their predictions, and their predictions with each point left out.
    """
    k = len(space)
    before = 0 if fitted is None else 1
    figure = _figure(3.0 * (k + before), 3.0)
    axes = figure.subplots(1, k + before, squeeze=False)[0]
    centre = np.full(k, 0.5)
    if fitted is not None:
        responses, predictions, left_out = fitted
        axes[0].plot(responses, predictions, ".", label="fitted")
        axes[0].plot(responses, left_out, "x", label="left out")
        mean = float(responses.mean())
        axes[0].axline((mean, mean), slope=1.0, color="0.6", lw=0.8)
        axes[0].set_xlabel(f"simulated {label}")
        axes[0].set_ylabel("predicted")
        axes[0].legend()
    for i, (axis, name) in enumerate(zip(axes[before:], space.labels(), strict=True)):
        t = np.tile(centre, (101, 1))
        t[:, i] = np.linspace(0.0, 1.0, 101)
        x = space.from_unit(t)
        axis.plot(x[:, i], predict(x))
        axis.set_xlabel(name)
        axis.set_title("others at mid-range", fontsize="small")
    axes[before].set_ylabel(label)
    return figure


def plot_one_at_a_time(names: Sequence[str], levels: Array, responses: Array) -> Figure:
    """Draw the responses, shape (k, m), over each parameter's scaled range in one axes."""
    figure = _figure(5.5, 3.5)
    axes = figure.subplots()
    for name, row in zip(names, responses, strict=True):
        axes.plot(levels, row, ".-", label=name)
    axes.set_xlabel("parameter, scaled to its range [-]")
    axes.set_ylabel("response")
    axes.legend()
    return figure


def plot_morris(names: Sequence[str], mu_star: Array, sigma: Array) -> Figure:
    """Draw the spread (curvature and interaction) over the mean size of the elementary effects, each shape (k,)."""
    figure = _figure(4.5, 3.5)
    axes = figure.subplots()
    axes.plot(mu_star, sigma, "o")
    for name, x, y in zip(names, mu_star, sigma, strict=True):
        axes.annotate(name, (x, y), xytext=(4, 4), textcoords="offset points")
    axes.set_xlabel("mean size of effect over the full range")
    axes.set_ylabel("standard deviation of effect")
    return figure


def plot_sobol(names: Sequence[str], first: tuple[Array, Array], total: tuple[Array, Array]) -> Figure:
    """Draw first and total variance shares, each shape (k,) with its intervals of shape (k, 2)."""
    figure = _figure(5.0, 3.5)
    axes = figure.subplots()
    place = np.arange(len(names))
    pairs = ((*first, "alone"), (*total, "with interactions"))
    for offset, (share, interval, label) in zip((-0.2, 0.2), pairs, strict=True):
        error = np.abs(interval.T - share)
        axes.bar(place + offset, share, 0.38, yerr=error, label=label)
    axes.set_xticks(place, names)
    axes.set_ylabel("share of the response's variance [-]")
    axes.legend()
    return figure


def plot_history(runs: Sequence[SearchRun], target: float | None = None) -> Figure:
    """Draw the best value against evaluations; several runs of one method as their median and range."""
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
            axes.fill_between(at, best.min(axis=0), best.max(axis=0), step="post", alpha=0.2, color=line.get_color())
    if target is not None:
        axes.axhline(target, color="0.5", ls=":", label="target")
    axes.set_xscale("log")
    axes.set_xlabel("evaluations")
    axes.set_ylabel("best value so far")
    axes.legend()
    return figure
