"""What ``vtsdt align`` writes: one page that opens offline, its figures, JSON, and the rail for ``vtsdt what-if``."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.drawing.page import picture_address, rendered
from multibody.base.cache import digest_of
from multibody.base.result_folder import written_together
from vtsdt.alignment.result import Alignment
from vtsdt.alignment.trips import Trip
from vtsdt.files.parameters import LiftParameters

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["OWNER", "plot_trips", "write"]

#: Kind of run that a folder of results belongs to.
OWNER = "alignment"

_CAPTIONS = {
    "alignment": "Equivalent deviation over height: every trip, the interquartile range, the median, and the estimate "
    "from all pairs of trips, which has a smaller error. The coloured sections are above the threshold.",
    "rail": "The rail that has this equivalent deviation. A cabin with two levels of shoes sees the mean of two "
    "heights, so the rail itself is less certain; it is the input of vtsdt what-if.",
    "trips": "The measurements, low-passed: rope tension, height, and acceleration without its offset.",
}


def write(alignment: Alignment, out: Path, parameters: LiftParameters, trips: Sequence[Trip]) -> Path:
    """Write page, figures, JSON and profile into a folder, together; return the page.

    Raises
    ------
    FolderTaken
        If the folder holds the results of something else, or of another lift.
    OSError
        If something cannot be written; the folder is then as before.
    """
    text = json.dumps(alignment.to_json(), indent=1) + "\n"
    with written_together(out, OWNER, parameters.name, digest_of(text)) as draft:
        (draft / "alignment.json").write_text(text, encoding="utf-8")
        _write_profile(alignment, draft / "profile.csv")
        _write_page(alignment, draft, parameters, trips)
    return out / "report.html"


def _write_page(alignment: Alignment, out: Path, parameters: LiftParameters, trips: Sequence[Trip]) -> None:
    import matplotlib.pyplot as plt

    figures = {"alignment": alignment.plot(), "rail": alignment.plot_rail(), "trips": plot_trips(trips)}
    sources = {}
    for name, figure in figures.items():
        png = _png(figure)
        (out / f"{name}.png").write_bytes(png)
        sources[name] = {"source": picture_address(png), "caption": _CAPTIONS[name]}
        plt.close(figure)
    text = rendered(
        "vtsdt",
        "alignment.html",
        name=parameters.name,
        sentences=alignment.sentences(),
        pictures=sources,
        headline=_headline(alignment),
        trips=_trip_rows(alignment, trips),
        sections=_section_rows(alignment),
        threshold=f"{1e3 * alignment.threshold:.2g}",
        tuning=alignment.tuning,
        observability=_observability(alignment),
        notes=alignment.notes,
        loose=f"{1e3 * alignment.loose:.2g}",
        per_newton=f"{1e3 / alignment.slope:.2f}",
    )
    (out / "report.html").write_text(text, encoding="utf-8")


def _headline(alignment: Alignment) -> str:
    count = len(alignment.sections)
    if not count:
        return f"No section is above {1e3 * alignment.threshold:.2g} mm"
    return f"{count} section{'s are' if count > 1 else ' is'} above {1e3 * alignment.threshold:.2g} mm"


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=150, metadata={"Software": None})
    return buffer.getvalue()


def _write_profile(alignment: Alignment, path: Path) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["height_m", "delta_mm", "spread_mm"])
        for height, delta, spread in zip(*alignment.rail, strict=True):
            writer.writerow([f"{height:.6g}", f"{1e3 * delta:.6g}", f"{1e3 * spread:.6g}"])


def _section_rows(alignment: Alignment) -> list[dict[str, str]]:
    return [
        {
            "range": f"{s.low:.2f} to {s.high:.2f} m",
            "largest": f"{1e3 * s.largest:.2f} mm",
            "at": f"{s.at:.2f} m",
            "excess": f"{1e3 * (s.largest - alignment.threshold):.2f} mm",
            "share": f"{s.share:.0%}",
            "confidence": _percent(s.confidence),
        }
        for s in alignment.sections
    ]


def _percent(probability: float) -> str:
    """Return a probability as text that does not claim certainty."""
    if not np.isfinite(probability):
        return "not known from one trip"
    return "> 99 %" if probability > 0.99 else f"{100 * probability:.0f} %"


def _trip_rows(alignment: Alignment, trips: Sequence[Trip]) -> list[dict[str, str]]:
    rows = []
    for trip, curve in zip(trips, alignment.curves, strict=True):
        known = np.isfinite(curve) & np.isfinite(alignment.estimate)
        difference = curve[known] - alignment.estimate[known]
        rows.append(
            {
                "name": trip.name,
                "direction": "up" if trip.direction > 0 else "down",
                "range": f"{round(trip.height.min(), 2) + 0.0:.2f} to {trip.height.max():.2f} m",
                "payload": f"{trip.payload:.3g} kg",
                "offset": f"{trip.offset:+.3f} m/s²",
                "median": f"{1e3 * np.median(curve[known]):.2f} mm" if known.any() else "none",
                "difference": f"{1e3 * np.sqrt(np.mean(difference**2)):.2f} mm" if known.any() else "none",
            }
        )
    return rows


def _observability(alignment: Alignment) -> dict[str, Any] | None:
    observed = alignment.observability
    if observed is None:
        return None
    rows = []
    for name in observed.names:
        middle, last = observed.std[name]
        unit, factor = _display_unit(name)
        rows.append(
            {
                "name": name,
                "middle": f"{factor * middle:.3g} {unit}",
                "last": f"{factor * last:.3g} {unit}",
                "bounded": "yes" if observed.bounded(name) else "no",
            }
        )
    return {"sentences": observed.sentences(), "rows": rows}


def _display_unit(name: str) -> tuple[str, float]:
    last = name.rpartition(".")[2]
    if last.startswith("v_"):
        return "mm/s", 1e3
    if last.startswith("w_"):
        return "mrad/s", 1e3
    return ("mrad", 1e3) if last in ("roll", "pitch", "yaw") else ("mm", 1e3)


def plot_trips(trips: Sequence[Trip]) -> Figure:
    """Draw tension, height and acceleration of trips over time; returns the figure."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(3, 1, sharex=True, figsize=(8, 5.5), layout="constrained")
    rows = (("tension", "tension [N]"), ("height", "height [m]"), ("acceleration", "acceleration [m/s²]"))
    for axis, (name, title) in zip(axes, rows, strict=True):
        for direction, colour in ((1, "tab:blue"), (-1, "tab:green")):
            chosen = [t for t in trips if t.direction == direction]
            for k, trip in enumerate(chosen):
                label = ("up" if direction > 0 else "down") if k == 0 and name == "height" else None
                axis.plot(trip.time, getattr(trip, name), color=colour, linewidth=0.5, label=label)
        axis.set_ylabel(title)
        axis.grid(alpha=0.3)
    axes[1].legend(fontsize="small")
    axes[-1].set_xlabel("time [s]")
    return figure
