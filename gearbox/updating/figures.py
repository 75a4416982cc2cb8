"""Figures of the updating chain."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.drawing.figure_style import AFTER, BEFORE, MEASURED, drawing, label, new_figure
from gearbox.updating.settings import OBJECTIVES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gearbox.updating.identifiability import Identifiability
    from gearbox.updating.outcome import UpdatingOutcome
    from surrogate import OneAtATimeResult

__all__ = ["all_figures", "conditions", "directions", "search", "sensitivity", "spectra", "surface", "surface_study"]

_WIDE = 8.0
_TONES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
_MARKS = "osv^D<>"


def _objective(result: UpdatingOutcome) -> str:
    return f"{OBJECTIVES[result.settings.objective]} [–]"


@drawing
def sensitivity(result: OneAtATimeResult, what: str = "objective [–]") -> Figure:
    """The objective over each parameter's range, and how far it moves (Fig. 8 of the paper)."""
    figure, axes = new_figure(1, 2, height=3.0, width=_WIDE, width_ratios=(2.0, 1.0))
    left, right = axes[0]
    order = np.argsort(-result.ranges)
    for i, row in enumerate(order):
        tone, mark = _TONES[i % len(_TONES)], _MARKS[i % len(_MARKS)]
        left.plot(
            result.levels,
            result.responses[row],
            f"{mark}-",
            color=tone,
            markersize=4,
            linewidth=1.1,
            label=result.space.names[row],
        )
    left.axhline(result.base_response, color="#777777", linewidth=0.8, linestyle=":")
    left.set_xlabel("parameter, scaled to its range [–]")
    left.set_ylabel(what)
    left.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=min(6, order.size), columnspacing=1.0)
    place = np.arange(order.size)
    right.barh(place, result.ranges[order], color=[_TONES[i % len(_TONES)] for i in range(order.size)])
    right.set_yticks(place, [result.space.names[i] for i in order])
    right.invert_yaxis()
    right.set_xlabel("largest − smallest [–]")
    right.grid(False, axis="y")
    return figure


@drawing
def surface_study(result: UpdatingOutcome) -> Figure:
    """R² on fitted, left-out and test points, and test errors, over sample count and order (Figs. 9 and 10)."""
    study = result.choice.study
    figure, axes = new_figure(1, 2, height=3.6, width=_WIDE)
    left, right = axes[0]
    tones = {2: "#D55E00", 3: "#0072B2", 1: "#009E73"}
    for order in result.settings.surface_orders:
        part, tone = study[study["order"] == order], tones[order]
        left.plot(part["points"], part["r2"], "o-", color=tone, label=f"order {order}: fitted points")
        left.plot(part["points"], part["r2_loo"], "s--", color=tone, markerfacecolor="white", label="each left out")
        left.plot(part["points"], part["test_r2"], "^:", color=tone, label="test points")
        right.plot(part["points"], part["test_max_relative_error"], "o-", color=tone, label=f"order {order}: largest")
        right.plot(
            part["points"], part["test_mean_relative_error"], "s--", color=tone, markerfacecolor="white", label="mean"
        )
    lowest = float(np.nanmin(study[["r2_loo", "test_r2"]].to_numpy(dtype=float)))
    left.set_ylim(max(-1.05, min(lowest, 0.0) - 0.05), 1.03)
    if lowest < -1.05:
        left.text(0.02, 0.02, "values below −1 not shown", transform=left.transAxes, fontsize=8)
    for axis in (left, right):
        axis.set_xlabel("simulations in the design [–]")
        axis.set_xticks(sorted(set(study["points"])))
        axis.legend(fontsize=8, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, columnspacing=1.0)
    left.set_ylabel("R² [–]")
    right.set_ylabel("relative error at test points [–]")
    right.set_ylim(bottom=0.0)
    return figure


@drawing
def surface(result: UpdatingOutcome) -> Figure:
    """The surface against the simulations that it was fitted to, those it has not seen, and its optimum."""
    fitted = result.choice.surface
    figure, axes = new_figure(1, 1 + len(fitted.space), height=2.9, width=_WIDE)
    first = axes[0, 0]
    y = np.asarray(fitted.train_responses)
    first.plot(y, fitted.predict(np.asarray(fitted.train_points)), ".", color="#0072B2", label="fitted")
    first.plot(y, y - fitted.loo_residuals(), "x", color="#D55E00", markersize=4, label="left out")
    best = result.optimum
    if np.isfinite(best.simulated):
        first.plot([best.simulated], [best.predicted], "*", color="#000000", markersize=11, label="optimum")
    first.axline((float(y.mean()), float(y.mean())), slope=1.0, color="#777777", linewidth=0.8)
    first.set_xlabel("simulated [–]")
    first.set_ylabel(f"predicted {_objective(result)}")
    first.legend(fontsize=8)
    centre = fitted.space.to_unit(np.array([[best.values[n] for n in fitted.space.names]]))[0]
    for i, (axis, name) in enumerate(zip(axes[0, 1:], fitted.space.labels(), strict=True)):
        t = np.tile(centre, (101, 1))
        t[:, i] = np.linspace(0.0, 1.0, 101)
        x = fitted.space.from_unit(t)
        axis.plot(x[:, i], fitted.predict(x), color="#0072B2")
        axis.plot([best.values[fitted.space.names[i]]], [best.predicted], "*", color="#000000", markersize=9)
        axis.set_xlabel(name)
        axis.ticklabel_format(axis="x", style="sci", scilimits=(-3, 4))
    limits = [axis.get_ylim() for axis in axes[0, 1:]]
    for axis in axes[0, 1:]:
        axis.set_ylim(min(low for low, _ in limits), max(high for _, high in limits))
    axes[0, 1].set_ylabel("predicted [–]")
    axes[0, 1].set_title("cuts through the optimum", fontsize=9)
    return figure


@drawing
def search(result: UpdatingOutcome) -> Figure:
    """Best value on the surface against evaluations, and what the candidates gave when simulated."""
    figure, axes = new_figure(1, 2, height=2.8, width=_WIDE)
    left, right = axes[0]
    history = result.search.to_frame()
    left.step(history["evaluations"], history["best"], where="post", color="#0072B2", label=result.search.method)
    left.axhline(result.start.simulated, color="#D55E00", linestyle="--", linewidth=1.0, label="before (simulated)")
    left.set_xscale("log")
    left.set_xlabel("evaluations of the surface [–]")
    left.set_ylabel(f"best {_objective(result)}")
    left.legend(fontsize=8)
    place = np.arange(len(result.tried))
    right.barh(place, [c.simulated for c in result.tried], color="#0072B2", label="simulated")
    predicted = [(i, c.predicted) for i, c in enumerate(result.tried) if np.isfinite(c.predicted)]
    right.plot(
        [v for _, v in predicted], [i for i, _ in predicted], "D", color="#D55E00", label="predicted by the surface"
    )
    right.axvline(result.start.simulated, color="#777777", linewidth=0.8, linestyle=":")
    right.set_yticks(place, [_short(c.origin) for c in result.tried], fontsize=8)
    right.invert_yaxis()
    right.set_xlabel(_objective(result))
    right.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.4, 1.22), ncols=2)
    right.grid(False, axis="y")
    return figure


def _short(origin: str) -> str:
    return {
        "the model as it is": "before",
        "the optimum of the surface": "optimum",
        "another hill of the surface": "another hill",
        "the best point of the designs": "best of designs",
    }.get(origin, origin)


@drawing
def conditions(result: UpdatingOutcome) -> Figure:
    """Cosine similarity before and after, with its upper bound, at every condition (Fig. 12)."""
    table = result.to_frame()
    figure, axes = new_figure(1, height=3.0, width=_WIDE)
    axis = axes[0, 0]
    place = np.arange(len(table))
    axis.bar(place - 0.2, table["before"], 0.38, color=BEFORE["color"], label="before")
    axis.bar(place + 0.2, table["after"], 0.38, color=AFTER["color"], label="after")
    for i, bound in enumerate(table["upper bound"]):
        axis.plot(
            [i - 0.42, i + 0.42],
            [bound, bound],
            color="#000000",
            linewidth=1.4,
            label="highest that mesh lines can reach" if i == 0 else None,
        )
    for x, key in ((-0.2, "before"), (0.2, "after")):
        for i, value in enumerate(table[key]):
            axis.annotate(
                f"{value:.3f}",
                (i + x, max(value, 0.0)),
                xytext=(0, -11),
                textcoords="offset points",
                ha="center",
                fontsize=8,
                color="white",
            )
    names = [
        f"{row['condition']}\n{row['speed [r/min]']:.1f} r/min, {row['load [N·m]']:.4g} N·m\n"
        + ("used" if row["used for updating"] else "held out")
        for _, row in table.iterrows()
    ]
    axis.set_xticks(place, names)
    axis.grid(False, axis="x")
    low = float(min(0.0, table[["before", "after"]].min().min()))
    axis.set_ylim(low, 1.18)
    axis.set_ylabel("cosine similarity [–]")
    axis.legend(loc="upper right", ncols=3)
    return figure


@drawing
def spectra(result: UpdatingOutcome) -> Figure:
    """Spectra of the processed signals, measured and modelled, at the base condition."""
    from gearbox.signals.spectrum import spectrum

    recording, measured, before, after = result.pictures["pairs"][0]
    figure, axes = new_figure(1, height=2.8, width=_WIDE)
    axis = axes[0, 0]
    low, high = result.settings.processing.band
    for name, signal, style in (
        ("measured", measured, MEASURED | {"linewidth": 1.4}),
        ("before", before, BEFORE),
        ("after", after, AFTER),
    ):
        whole = spectrum(signal)
        shown = (whole.frequencies > 0.7 * low) & (whole.frequencies < 1.15 * high)
        axis.semilogy(whole.frequencies[shown], np.maximum(whole.amplitudes[shown], 1e-5), **style, label=name)
    axis.set_ylim(1e-4, 5.0)
    axis.set_title(f"{recording.name}: processed signals")
    axis.set_xlabel(label("frequency", "Hz"))
    axis.set_ylabel("amplitude, peak, of the\nnormalised signal [–]")
    axis.legend(loc="upper right", ncols=3)
    return figure


@drawing
def directions(results: tuple[Identifiability, ...]) -> Figure:
    """How well each direction of the parameters is known, for each way of comparing."""
    from gearbox.updating.identifiability import LIMIT

    figure, axes = new_figure(len(results), height=1.75, width=_WIDE)
    for axis, result in zip(axes[:, 0], results, strict=True):
        place = np.arange(result.std.size)
        size = np.clip(result.std, 1e-4, 10.0)
        tones = ["#0072B2" if s < LIMIT else "#D55E00" for s in result.std]
        axis.barh(place, size, color=tones)
        axis.set_xscale("log")
        axis.set_xlim(1e-4, 10.0)
        axis.axvline(LIMIT, color="#777777", linestyle=":", linewidth=1.1)
        axis.set_yticks(place, [result.words(i) for i in range(result.std.size)], fontsize=8)
        axis.invert_yaxis()
        axis.set_title(result.what, fontsize=9)
        axis.grid(False, axis="y")
    axes[-1, 0].set_xlabel("standard deviation along the direction [share of the ranges]; right of the line: not known")
    return figure


def all_figures(result: UpdatingOutcome) -> dict[str, Any]:
    """Every figure of the report by name."""
    from gearbox.signals.figures import plot_pair

    drawn: dict[str, Any] = {}
    if result.to_frame().size:
        drawn["similarity"] = conditions(result)
    if result.pictures.get("pairs"):
        rows = [(f"{r.name} ({r.condition.load_Nm:.4g} N·m)", m, b, a) for r, m, b, a in result.pictures["pairs"]]
        drawn["signals"] = plot_pair(rows)
        drawn["spectra"] = spectra(result)
    drawn["sensitivity"] = sensitivity(result.sensitivity, _objective(result))
    drawn["surface_study"] = surface_study(result)
    drawn["surface"] = surface(result)
    drawn["search"] = search(result)
    if result.directions:
        drawn["directions"] = directions(result.directions)
    return drawn
