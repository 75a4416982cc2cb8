"""The report of the updating chain: one page that opens offline, with its figures as separate files."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from discrepancy.drawing.page import picture_address, rendered
from gearbox.signals.similarity import LAG_RULES
from gearbox.updating.figures import all_figures
from gearbox.updating.json_file import content
from gearbox.updating.outcome import UpdatingOutcome
from gearbox.updating.settings import OBJECTIVES
from multibody.base.cache import digest_of
from multibody.base.quantity_text import unit_text
from multibody.base.result_folder import written_together

__all__ = ["OWNER", "render", "write"]

#: Kind of run that a folder of results belongs to.
OWNER = "updating"

_DPI = 150

CAPTIONS = {
    "similarity": "Cosine similarity before and after, at the condition used and at those held out (the paper's "
    "Fig. 12). The black line is the highest value that a signal with mesh lines only can reach.",
    "signals": "A stretch of the processed signals, each shifted by the lag of its score and scaled to the "
    "measurement.",
    "spectra": "Spectra of the processed signals at the base condition. What the measurement contains besides the mesh "
    "lines, no parameter of a healthy model can give.",
    "sensitivity": "One parameter moved at a time, the others as they were (Fig. 8). This is a statement about this "
    "model at this point: with another housing another parameter may lead.",
    "surface_study": "Left: R² on the fitted points, with each point left out, and on test points that no fit has seen "
    "(Fig. 9). Right: errors at the test points (Fig. 10). R² on the fitted points alone says little.",
    "surface": "Left: what the surface predicts against what was simulated. Right: cuts through its optimum (star).",
    "search": "Left: the search on the surface. Right: what the candidates gave when they were simulated again; a "
    "diamond is the prediction of the surface.",
    "directions": "How well each direction of the parameters is known. Orange: not identifiable from the recordings; "
    "the values of these parameters are one choice among many.",
}


def write(result: UpdatingOutcome, out: str | Path, subject: str = "") -> list[Path]:
    """Write ``updating.json``, ``report.html`` and the figures as PNG, together; returns what was written.

    Raises
    ------
    FolderTaken
        If the folder holds the results of something else, or of another study.
    OSError
        If something cannot be written; the folder is then as before.
    """
    out = Path(out)
    text = json.dumps(content(result), indent=2, ensure_ascii=False) + "\n"
    names = ["updating.json", "report.html"]
    with written_together(out, OWNER, subject, digest_of(text)) as draft:
        (draft / "updating.json").write_text(text, encoding="utf-8")
        pictures = {}
        for name, figure in all_figures(result).items():
            buffer = io.BytesIO()
            figure.savefig(buffer, format="png", dpi=_DPI, metadata={"Software": None})
            pictures[name] = buffer.getvalue()
            (draft / f"{name}.png").write_bytes(buffer.getvalue())
            names.append(f"{name}.png")
        (draft / "report.html").write_text(render(result, pictures), encoding="utf-8")
    return [out / name for name in names]


def render(result: UpdatingOutcome, pictures: dict[str, bytes]) -> str:
    """Return the page as HTML that needs nothing from outside."""
    shown = {name: {"source": picture_address(png), "caption": CAPTIONS[name]} for name, png in pictures.items()}
    return rendered("gearbox", "updating.html", pictures=shown, **_page_content(result))


def _page_content(result: UpdatingOutcome) -> dict[str, Any]:
    s, f = result.settings, result.frequencies
    start, updated = result.start.similarity, result.updated.similarity
    return {
        "headline": _headline(result),
        "sentence": result.sentence(),
        "improved": result.improved,
        "objective": f"{OBJECTIVES[s.objective]} over all recordings used"
        if s.objective == "amplitudes"
        else f"{OBJECTIVES[s.objective]} at the first recording",
        "processing": s.processing.describe(),
        "rule": f"'{s.rule}': {LAG_RULES[s.rule]}",
        "scores": [(n, score.describe()) for n, score in (("before", start), ("after", updated)) if score is not None],
        "speed": (f.reported_rpm, f.condition.speed_rpm, 100.0 * (f.condition.speed_rpm / f.reported_rpm - 1.0)),
        "components": _components(result),
        "parameters": [
            {
                "name": name,
                "unit": unit_text(row["unit"]) or "–",
                "range": f"{row['lower']:.5g} … {row['upper']:.5g}",
                "start": f"{row['start']:.5g}",
                "updated": f"{row['updated']:.5g}" if row["selected"] else "not selected",
            }
            for name, row in result.parameters().iterrows()
        ],
        "conditions": [
            {
                "name": row["condition"],
                "speed": f"{row['speed [r/min]']:.2f}",
                "load": f"{row['load [N·m]']:.4g}",
                "used": "used" if row["used for updating"] else "held out",
                "before": f"{row['before']:.4f}",
                "after": f"{row['after']:.4f}",
                "bound": f"{row['upper bound']:.4f}",
                "lag": f"{row['lag [ms]']:+.4f}",
            }
            for _, row in result.to_frame().iterrows()
        ],
        "tried": [
            {
                "origin": c.origin,
                "predicted": "–" if not np.isfinite(c.predicted) else f"{c.predicted:.4f}",
                "simulated": "failed" if not np.isfinite(c.simulated) else f"{c.simulated:.4f}",
                "taken": c is result.updated,
            }
            for c in result.tried
        ],
        "selected": ", ".join(result.selected),
        "surface": result.choice,
        "quality": _quality(result),
        "directions": [information.describe() for information in result.directions],
        "notes": result.notes,
        "counts": f"{result.simulations} simulations were made in {result.seconds:.0f} s of computing, "
        f"{result.reused} were taken from an earlier run, {result.failed} failed. At most "
        f"{100 * result.off_mesh:.2g} % of a model signal's RMS was off the mesh lines.",
    }


def _headline(result: UpdatingOutcome) -> str:
    before, after = result.start.simulated, result.updated.simulated
    what = OBJECTIVES[result.settings.objective].capitalize()
    if not result.improved:
        return f"The model stays as it was: nothing better than {before:.3f} was found"
    return f"{what} {before:.3f} → {after:.3f}"


def _components(result: UpdatingOutcome) -> list[dict[str, str]]:
    rows = []
    for whose, components in (("model", result.frequencies.virtual), ("measurement", result.frequencies.measured)):
        for f, k, e in sorted(zip(components.frequencies, components.orders, components.errors, strict=True)):
            rows.append(
                {
                    "whose": whose,
                    "theory": f"{k} × mesh = {k * components.mesh_frequency:.1f} Hz",
                    "found": f"{f:.1f} Hz",
                    "error": f"{100 * e:+.2f} %",
                    "verdict": "within 5 %" if abs(e) <= 0.05 else "off",
                }
            )
    return rows


def _quality(result: UpdatingOutcome) -> list[dict[str, Any]]:
    rows = []
    for _, row in result.choice.study.iterrows():
        taken = int(row["points"]) == result.choice.points and int(row["order"]) == result.choice.order
        numbers = {
            key: "–" if key not in row or not np.isfinite(row[key]) else f"{row[key]:.3f}"
            for key in ("r2", "r2_loo", "test_r2", "test_max_relative_error", "test_mean_relative_error")
        }
        rows.append({"points": str(int(row["points"])), "order": str(int(row["order"])), "taken": taken, **numbers})
    return rows
