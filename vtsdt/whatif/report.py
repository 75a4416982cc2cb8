"""The page for a maintenance planner: where to straighten, what it saves, and how certain that is."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.drawing.page import picture_address, rendered
from multibody.base.cache import digest_of
from multibody.base.result_folder import written_together
from vtsdt.lift.comfort import ComfortError, RideComfort, ride_comfort
from vtsdt.whatif import figures as whatif_figures
from vtsdt.whatif.compare import TABLE_3, TripComparison
from vtsdt.whatif.figures import LABELS
from vtsdt.whatif.result import Interval, WhatIf

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from vtsdt.whatif.settings import Settings
    from vtsdt.whatif.threshold import Threshold

__all__ = ["OWNER", "summary", "write_what_if"]

#: Kind of run that a folder of results belongs to.
OWNER = "what-if study"

_CAPTIONS = {
    "rail": "The estimated rail. The coloured sections are above the threshold.",
    "savings": "Savings in the guides from straightening each section alone, and from each action.",
    "energies": "Energies and efficiency of a trip; lines are 95 % intervals. The efficiency is what masses and "
    "machine receive over what they give.",
    "threshold": "Median and largest deviation of each configuration of the guides, and the energy lost on its trips.",
    "compare": "One trip, measured and simulated, both low-passed at 60 Hz.",
    "comfort": "The measured ride: speed, acceleration and weighted vibration.",
}


def summary(study: WhatIf) -> str:
    """Return in two sentences what to do and how certain the savings are."""
    if not study.sections:
        return (
            f"No part of the rail is above {1e3 * study.threshold:.2f} mm: there is nothing to straighten. "
            f"Lubrication would save {study.saving('lubrication').text()} J on a trip."
        )
    where = " and ".join(_comma([f"{s.low:.2f} to {s.high:.2f} m" for s in study.sections]))
    straight, grease = study.saving("straightened"), study.saving("lubrication")
    share = study.better("lubrication", "straightened")
    comparison = (
        ""
        if not np.isfinite(share)
        else f" Lubrication saves more than straightening in {100 * share:.0f} % of the draws."
    )
    return (
        f"Straighten the rail at {where}: that saves {straight.text()} J on a trip. "
        f"Lubrication saves {grease.text()} J, both together {study.saving('both').text()} J.{comparison}"
    )


def _comma(parts: list[str]) -> list[str]:
    return [", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts


def write_what_if(
    out: Path,
    study: WhatIf,
    settings: Settings,
    *,
    lift: str,
    trips: Sequence[TripComparison] = (),
    threshold: Threshold | None = None,
    notes: Sequence[str] = (),
) -> Path:
    """Write page, figures, JSON and the straightened rail into a folder, together; return the page.

    Raises
    ------
    FolderTaken
        If the folder holds the results of something else, or of another lift.
    OSError
        If something cannot be written; the folder is then as before.
    """
    figures: dict[str, Figure] = {"rail": whatif_figures.rail(study), "energies": whatif_figures.energies(study)}
    figures["savings"] = whatif_figures.savings(study)
    if threshold is not None:
        figures["threshold"] = threshold.plot()
    notes = list(notes)
    rides: list[tuple[RideComfort, RideComfort]] = []
    if trips:
        figures["compare"] = trips[0].plot()
        rides, faults = _rides(trips)
        notes += faults
        if rides:
            figures["comfort"] = rides[0][0].plot()
    pictures = {name: _png(figure) for name, figure in figures.items()}
    content = {
        **study.to_json(),
        "lift": lift,
        "notes": list(notes),
        "threshold": None if threshold is None else threshold.to_json(),
        "trips": [_trip_json(t) for t in trips],
        "comfort": [{"measured": a.to_json(), "model": b.to_json()} for a, b in rides],
        "year": _yearly(study, settings),
    }
    text = json.dumps(content, indent=1, ensure_ascii=False) + "\n"
    with written_together(out, OWNER, lift, digest_of(text)) as draft:
        for name, png in pictures.items():
            (draft / f"{name}.png").write_bytes(png)
        (draft / "what-if.json").write_text(text, encoding="utf-8")
        page = _page(study, settings, lift, trips, rides, threshold, notes, pictures)
        (draft / "report.html").write_text(page, encoding="utf-8")
    return out / "report.html"


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=130, metadata={"Software": None})
    return buffer.getvalue()


def _rides(trips: Sequence[TripComparison]) -> tuple[list[tuple[RideComfort, RideComfort]], list[str]]:
    rides, faults = [], []
    for trip in trips:
        try:
            rides.append(
                (
                    ride_comfort(trip.time, trip.measured["a_c"], name=f"{trip.name}, measured"),
                    ride_comfort(trip.time, trip.model["a_c"], name=f"{trip.name}, model"),
                )
            )
        except ComfortError as error:
            faults.append(f"{trip.name}: ride comfort was not evaluated: {error}")
    return rides, faults


def _trip_json(trip: TripComparison) -> dict[str, Any]:
    return {
        "name": trip.name,
        "metrics": {n: {"rmse": trip.metrics[n][0], "pearson": trip.metrics[n][1], "unit": u} for n, u, *_ in TABLE_3},
        "guide_loss_J": {"measured": trip.loss[0], "model": trip.loss[1]},
    }


def _yearly(study: WhatIf, settings: Settings) -> dict[str, Any] | None:
    if settings.trips_per_day <= 0.0:
        return None
    factor = settings.trips_per_day * 365.0 / 3.6e6
    year: dict[str, Any] = {"unit": "kWh", "trips_per_day": settings.trips_per_day}
    for name in ("straightened", "lubrication", "both"):
        saving = study.saving(name)
        scaled = Interval(*(factor * v for v in (saving.value, saving.low, saving.high)))
        year[name] = {"energy": scaled.to_json()}
        if settings.price > 0.0:
            money = Interval(*(settings.price * v for v in (scaled.value, scaled.low, scaled.high)))
            year[name]["money"] = {**money.to_json(), "unit": settings.currency}
    return year


def _page(
    study: WhatIf,
    settings: Settings,
    lift: str,
    trips: Sequence[TripComparison],
    rides: Sequence[tuple[RideComfort, RideComfort]],
    threshold: Threshold | None,
    notes: Sequence[str],
    pictures: dict[str, bytes],
) -> str:
    year = _yearly(study, settings)
    draws = len(study.drawn)
    return rendered(
        "vtsdt",
        "what_if.html",
        pictures={n: {"source": picture_address(png), "caption": _CAPTIONS[n]} for n, png in pictures.items()},
        lift=lift,
        answer=summary(study),
        notes=list(notes),
        sections=[_section_row(s) for s in study.sections],
        plan=[_plan_row(study, name, year) for name in ("straightened", "lubrication", "both")],
        yearly=year is not None,
        certainty=_certainty(study, year),
        direction=study.direction,
        actions=[LABELS[a.name] for a in study.actions],
        energies=_energy_rows(study),
        draws=draws,
        threshold_text="" if threshold is None else _threshold_text(threshold),
        compared=_compared(trips),
        comfort=_comfort_rows(rides),
        assumed=_assumed(study, settings),
    )


def _section_row(s: Any) -> dict[str, str]:
    spread = f" ± {1e3 * s.spread:.2f}" if s.spread > 0.0 else ""
    text = "> 99 %" if s.probability > 0.99 else f"{100 * s.probability:.0f} %"  # never claims certainty
    probability = text if s.spread > 0.0 else "not known"
    return {
        "where": f"{s.low:.2f} to {s.high:.2f} m",
        "worst": f"{s.worst:.2f} m",
        "deviation": f"{1e3 * s.deviation:.2f}{spread} mm",
        "probability": probability,
        "saving": f"{s.interval.text()} J",
    }


def _plan_row(study: WhatIf, name: str, year: dict[str, Any] | None) -> dict[str, str]:
    row = {
        "name": LABELS[name],
        "saving": f"{study.saving(name).text()} J",
        "gain": f"+{study.gain(name).text(100.0, 1)} points",
        "year": "",
    }
    if year is not None:
        row["year"] = f"{_three_digits(year[name]['energy'])} kWh"
        if "money" in year[name]:
            row["year"] += f", {_three_digits(year[name]['money'])} {year[name]['money']['unit']}"
    return row


def _three_digits(figure: dict[str, Any]) -> str:
    """Return a value of the JSON with its interval in brackets, if it has one."""
    text = f"{figure['value']:.3g}"
    return text if figure["low"] is None else f"{text} ({figure['low']:.3g} to {figure['high']:.3g})"


def _certainty(study: WhatIf, year: dict[str, Any] | None) -> str:
    if not study.drawn:
        return "There were no draws, so no value has an interval."
    varied = ", ".join(f"{name} ± {size}" for name, size in study.uncertainties)
    text = f"In brackets: 95 % of {len(study.drawn)} draws of {varied} and of the error of the rail's estimate."
    if not np.any(study.rail.spread > 0.0):
        text += " The profile has no spread and counts as exact."
    if year is not None:
        text += " A year: all trips equal to this one, and a machine that feeds back all energy that it takes up."
    return text


def _energy_rows(study: WhatIf) -> list[dict[str, Any]]:
    names = {
        "E_c": ("E_c [J]", 1.0),
        "E_cw": ("E_cw [J]", 1.0),
        "E_cb": ("E_cb [J]", 1.0),
        "E_m": ("E_m [J]", 1.0),
        "eta_t": ("η_t [%]", 100.0),
    }
    return [
        {"name": label, "cells": [_cell(a.figure(key), factor) for a in study.actions]}
        for key, (label, factor) in names.items()
    ]


def _cell(figure: Interval, factor: float) -> tuple[str, str]:
    value, _, interval = figure.text(factor).partition(" ")
    return value, interval.strip("()")


def _threshold_text(threshold: Threshold) -> str:
    low, high = (1e3 * v for v in threshold.interval)
    return (
        f"{100 * threshold.fraction:.0f} % of {len(threshold.configurations)} configurations have a median deviation "
        f"of {1e3 * threshold.level:.2f} mm or less (95 % interval {low:.2f} to {high:.2f} mm, by bootstrap over the "
        f"configurations). A millimetre more of median deviation goes with {1e-3 * threshold.slope:.1f} J more on a "
        f"trip (correlation {threshold.correlation:.2f})."
    )


def _compared(trips: Sequence[TripComparison]) -> list[tuple[str, str, str]]:
    if not trips:
        return []
    rows = []
    for name, unit, *_ in TABLE_3:
        rms, rho = (float(np.median([t.metrics[name][k] for t in trips])) for k in (0, 1))
        rows.append((name, f"{rms:.3g} {unit}", f"{rho:.2f}"))
    measured, model = (float(np.median([t.loss[k] for t in trips])) for k in (0, 1))
    return [*rows, ("energy lost in the cabin's guides", f"{measured:.2f} J measured, {model:.2f} J model", "")]


def _comfort_rows(rides: Sequence[tuple[RideComfort, RideComfort]]) -> list[tuple[str, str, str]]:
    if not rides:
        return []
    rows = []
    for k, (name, _, unit) in enumerate(rides[0][0].rows()):
        cells = []
        for side in (0, 1):
            values = np.array([pair[side].rows()[k][1] for pair in rides])
            known = values[np.isfinite(values)]
            cells.append(f"{np.median(known):.3g} {unit}" if known.size else "none")
        rows.append((name, cells[0], cells[1]))
    return rows


def _assumed(study: WhatIf, settings: Settings) -> list[str]:
    return [
        "The cabin's right rail represents all deviations; the left rail and both rails in y count as straight. "
        f"Only it is straightened, to {1e3 * study.threshold:.2f} mm.",
        f"Lubrication multiplies the friction of cabin and counterweight by {study.lubrication:g}.",
        "Friction is μ times the normal force at every shoe (González et al. 2020, Eq. 4); gear losses are neglected.",
        "Percentages refer to nominal values; all actions use the same draws, so savings are differences within a "
        "draw.",
        *(
            []
            if settings.lift
            else ["The lift is the project's own bench; its parameters differ from those of the paper's bench."]
        ),
    ]
