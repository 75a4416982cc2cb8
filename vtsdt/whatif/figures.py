"""Figures of a what-if study: the rail with the sections above the threshold, energies of the actions, savings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vtsdt.whatif.result import Interval, WhatIf

if TYPE_CHECKING:
    from matplotlib.figure import Figure


__all__ = ["LABELS", "energies", "rail", "savings"]

LABELS = {"original": "as it is", "straightened": "straightened", "lubrication": "lubricated", "both": "both"}
_COLOURS = {"E_c": "#0072B2", "E_cw": "#56B4E9", "E_m": "#009E73"}
_WORDS = {
    "E_c": "lost in the cabin's guides",
    "E_cw": "lost in the counterweight's guides",
    "E_m": "taken up by the machine (negative: given)",
}


def rail(study: WhatIf) -> Figure:
    """Draw the estimated deviation over height, the threshold and the sections above it (Fig. 9, rotated)."""
    from matplotlib.figure import Figure

    table = study.rail
    figure = Figure(figsize=(5.2, 5.6), layout="constrained")
    axis = figure.subplots()
    fine = np.linspace(table.height[0], table.height[-1], 600)
    delta = 1e3 * np.array([table.profile.at(h) for h in fine])
    spread = 1e3 * np.interp(fine, table.height, table.spread)
    if np.any(spread > 0):
        axis.fill_betweenx(
            fine, delta - 1.96 * spread, delta + 1.96 * spread, color="#cfe3f1", label="its 95 % interval"
        )
    axis.plot(delta, fine, color="#0072B2", linewidth=1.6, label="deviation of the right rail")
    axis.axvline(
        1e3 * study.threshold,
        color="black",
        linestyle="--",
        linewidth=1.1,
        label=f"threshold {1e3 * study.threshold:.2f} mm",
    )
    for k, s in enumerate(study.sections):
        axis.axhspan(s.low, s.high, color="#fdf1e7", zorder=0, label="to be straightened" if k == 0 else None)
    axis.set_xlabel("deviation towards the cabin [mm]")
    axis.set_ylabel("height [m]")
    axis.grid(color="#eeeeee")
    axis.legend(fontsize="small", loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=2, frameon=False)
    return figure


def energies(study: WhatIf) -> Figure:
    """Draw energies and efficiency of the actions with their intervals (Fig. 12)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.6, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(2.2, 1.0))
    places = np.arange(len(study.actions))
    width = 0.26
    for k, (name, colour) in enumerate(_COLOURS.items()):
        intervals = [a.figure(name) for a in study.actions]
        values = [i.value for i in intervals]
        left.bar(places + (k - 1) * width, values, width, color=colour, label=_WORDS[name])
        _whiskers(left, places + (k - 1) * width, intervals, 1.0)
    left.set_xticks(places, [LABELS[a.name] for a in study.actions])
    left.set_ylabel("energy of one trip [J]")
    left.legend(fontsize="small", loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=1, frameon=False)
    eta = [a.figure("eta_t") for a in study.actions]
    right.bar(places, [100 * interval.value for interval in eta], 0.6, color="#E69F00")
    _whiskers(right, places, eta, 100.0)
    for place, interval in zip(places, eta, strict=True):
        right.annotate(f"{100 * interval.value:.1f}", (place, 1.0), ha="center", va="bottom", fontsize=8)
    right.set_xticks(places, [LABELS[a.name] for a in study.actions], rotation=30, ha="right")
    right.set_ylabel("efficiency η_t [%]")
    for axis in (left, right):
        axis.grid(axis="y", color="#eeeeee")
        axis.set_axisbelow(True)
    return figure


def savings(study: WhatIf) -> Figure:
    """Draw what each action and each section alone saves on one trip, with intervals."""
    from matplotlib.figure import Figure

    rows = [(f"section {s.low:.2f} to {s.high:.2f} m", s.interval, "#D55E00") for s in study.sections]
    rows += [(LABELS[a.name], study.saving(a.name), "#0072B2") for a in study.actions[1:]]
    figure = Figure(figsize=(6.6, 0.42 * len(rows) + 0.9), layout="constrained")
    axis = figure.subplots()
    places = np.arange(len(rows))
    axis.barh(places, [i.value for _, i, _ in rows], 0.6, color=[c for *_, c in rows])
    for place, (_, i, _) in zip(places, rows, strict=True):
        if np.isfinite(i.low):
            axis.plot([i.low, i.high], [place, place], color="black", linewidth=1.2)
    axis.set_yticks(places, [name for name, *_ in rows])
    axis.invert_yaxis()
    axis.set_xlabel("saved in the guides on one trip [J]; line: 95 % of the draws")
    axis.grid(axis="x", color="#eeeeee")
    axis.set_axisbelow(True)
    return figure


def _whiskers(axis: Any, places: np.ndarray, intervals: Sequence[Interval], factor: float) -> None:
    for place, interval in zip(places, intervals, strict=True):
        if np.isfinite(interval.low):
            axis.plot([place, place], [factor * interval.low, factor * interval.high], color="black", linewidth=1.2)
