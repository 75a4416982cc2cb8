"""What ``vtsdt open --gear`` shows of an updated stage: spectra with mesh lines and sidebands, and similarities."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

__all__ = ["updating_view"]

SIDEBANDS = 2  # of a mesh line on either side that are marked
LEAST = 1e-5  # amplitude below which a line is noise of the arithmetic: a logarithmic axis has no zero

Entry = dict[str, Any]


def updating_view(folder: str | Path) -> Callable[[Mapping[str, float]], Entry]:
    """Return the view of a folder that ``vtsdt update-gearbox`` wrote.

    Parameters
    ----------
    folder : path
        With ``updating.json``.

    Raises
    ------
    ValueError
        If there is no ``updating.json`` in the folder, it is damaged, or an earlier version wrote it.
    """
    folder = Path(folder)
    file = folder / "updating.json"
    if not file.is_file():
        raise ValueError(f"{folder}: there is no updating.json in this folder: run vtsdt update-gearbox first")
    try:
        update = json.loads(file.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ValueError(f"{file}: this is no result of vtsdt update-gearbox: {error}") from error
    missing = [k for k in ("sentence", "spectra", "conditions", "parameters") if k not in update]
    if missing:
        raise ValueError(f"{file}: the entry '{missing[0]}' is missing: run vtsdt update-gearbox again")
    return lambda at: _view(folder, update)


def _view(folder: Path, found: Entry) -> Entry:
    spectra = found["spectra"]
    mesh, shaft = spectra["mesh_Hz"], spectra["shaft_Hz"]
    frequency = spectra["measured"]["frequency_Hz"]
    marks = []
    for order in range(1, int(frequency[-1] / mesh) + 1) if frequency else ():
        for k in range(-SIDEBANDS, SIDEBANDS + 1):
            at = order * mesh + k * shaft
            if frequency[0] <= at <= frequency[-1]:
                marks.append({"at": at, "name": f"{order} × mesh" if k == 0 else ""})
    words = {"measured": "measured", "before": "model before", "after": "model after"}
    lines = [
        {
            "name": word,
            "style": style,
            "x": spectra[style]["frequency_Hz"],
            "y": [max(v, LEAST) for v in spectra[style]["amplitude"]],
        }
        for style, word in words.items()
    ]
    return {
        "name": f"gear stage ({folder.resolve().name})",
        "sentences": [found["sentence"]],
        "sliders": [],
        "figures": [
            {
                "title": f"{spectra['recording']}: processed signals, with mesh lines and their sidebands",
                "labels": ["frequency [Hz]", "amplitude [–]"],
                "lines": lines,
                "marks": marks,
                "logarithmic": True,
            }
        ],
        "tables": [_similarities(found["conditions"]), _parameters(found["parameters"])],
    }


def _similarities(conditions: list[Entry]) -> Entry:
    heads = [["recording", False], ["load, N·m", True], ["speed, rpm", True], ["before", True], ["after", True]]
    rows = [
        [c["name"], f"{c['load_Nm']:g}", f"{c['matched_rpm']:.1f}", _similarity(c["before"]), _similarity(c["after"])]
        for c in conditions
    ]
    return {"title": "Similarity of model and recording", "heads": heads, "rows": rows}


def _similarity(found: Mapping[str, Any]) -> str:
    value = found["value"]
    return "–" if value is None else f"{value:.3f}"


def _parameters(parameters: Mapping[str, Entry]) -> Entry:
    heads = [["parameter", False], ["unit", False], ["start", True], ["updated", True], ["range", True]]
    rows = [
        [name, q["unit"] or "1", f"{q['start']:.4g}", f"{q['updated']:.4g}", f"{q['min']:.3g} to {q['max']:.3g}"]
        for name, q in parameters.items()
        if q["selected"]
    ]
    return {"title": "Parameters that were updated", "heads": heads, "rows": rows}
