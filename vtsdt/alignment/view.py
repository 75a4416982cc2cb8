"""What ``vtsdt open --lift`` shows of an estimated alignment: deviation over height, sections to correct, savings."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vtsdt.alignment.sections import sections

__all__ = ["alignment_view"]

Entry = dict[str, Any]
#: Share of an interval below which one of its numbers is the difference of two equal ones.
ROUNDING = 1e-9
PROFILE = ("height_m", "delta_mm", "spread_mm")  # of what-if.json


def alignment_view(folder: str | Path) -> Callable[[Mapping[str, float]], Entry]:
    """Return the view of a folder that ``vtsdt align`` wrote, with the savings of ``vtsdt what-if`` if they are there.

    Parameters
    ----------
    folder : path
        With ``alignment.json``; ``what-if.json`` is looked for in it and in its folder ``what-if``.

    Raises
    ------
    ValueError
        If there is no ``alignment.json`` in the folder, or it is damaged.
    """
    folder = Path(folder)
    file = folder / "alignment.json"
    if not file.is_file():
        raise ValueError(f"{folder}: there is no alignment.json in this folder: run vtsdt align --out {folder} first")
    columns = _read(file, ("height_m", "estimate_mm", "std_mm", "threshold_mm", "trips"))
    savings = next((f for f in (folder / "what-if.json", folder / "what-if" / "what-if.json") if f.is_file()), None)
    saved = _read(savings, ("threshold_mm", "sections", "actions", "profile")) if savings else None
    return lambda at: _view(folder, columns, saved, float(at.get("threshold", columns["threshold_mm"])))


def _read(file: Path, keys: tuple[str, ...]) -> Entry:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ValueError(f"{file}: this is no result of vtsdt: {error}") from error
    missing = [k for k in keys if not isinstance(content, dict) or k not in content]
    if missing:
        raise ValueError(f"{file}: the entry '{missing[0]}' is missing: write it again with this version of vtsdt")
    result: Entry = content
    return result


def _view(folder: Path, found: Entry, saved: Entry | None, threshold: float) -> Entry:
    height, estimate, std = (np.array(found[k], dtype=float) for k in ("height_m", "estimate_mm", "std_mm"))
    bad = sections(height, estimate, threshold, std)
    known = np.isfinite(estimate)
    above = float(np.mean(estimate[known] > threshold)) if known.any() else 0.0
    lines = [_line("each trip", "each", height, np.array(t["delta_mm"], dtype=float)) for t in found["trips"]]
    lines += [
        _line("estimate", "after", height, estimate),
        _line("± 2 standard deviations", "before", height, estimate - 2.0 * std),
        _line("± 2 standard deviations", "before", height, estimate + 2.0 * std),
        _line("threshold", "limit", height[[0, -1]], np.array([threshold, threshold])),
    ]
    count = "No section is" if not bad else f"{len(bad)} section{'s are' if len(bad) > 1 else ' is'}"
    low, high = 0.0, max(1.1 * float(np.nanmax(np.abs(estimate))), 1.2 * found["threshold_mm"])
    rows = []
    for a, b in bad:
        inside = (height >= a) & (height <= b)
        k = int(np.flatnonzero(inside)[np.nanargmax(estimate[inside])])
        rows.append([f"{a:.2f} to {b:.2f} m", f"{estimate[k]:.2f} ± {std[k]:.2f} mm", f"{height[k]:.2f} m"])
    heads = [["height of the cabin", False], ["largest deviation", True], ["at", True]]
    tables = [{"title": f"Above {threshold:.2f} mm", "heads": heads, "rows": rows}] if rows else []
    return {
        "name": f"guide rail ({folder.resolve().name})",
        "sentences": [
            f"{count} above {threshold:.2f} mm: {100 * above:.0f} % of the height that was passed.",
            *found.get("notes", []),
            *_savings_sentences(folder, saved, threshold),
        ],
        "sliders": [
            {
                "name": "threshold",
                "label": "Threshold of the deviation",
                "unit": "mm",
                "low": low,
                "high": high,
                "value": threshold,
            }
        ],
        "figures": [
            {
                "title": "Equivalent deviation of the rail over height",
                "labels": ["height of the cabin [m]", "deviation [mm]"],
                "lines": lines,
                "bands": [list(ab) for ab in bad],
            },
            *_rail_figures(saved),
        ],
        "tables": [*tables, *_savings_tables(saved)],
    }


def _line(name: str, style: str, x: np.ndarray, y: np.ndarray) -> Entry:
    return {"name": name, "style": style, "x": x.tolist(), "y": [float(v) if np.isfinite(v) else None for v in y]}


def _rail_figures(saved: Entry | None) -> list[Entry]:
    """Draw the rail that the savings were computed with: its heights are those of the rail, not of the cabin."""
    if saved is None:
        return []
    height, delta, spread = (np.array(saved["profile"][k], dtype=float) for k in PROFILE)
    level = saved["threshold_mm"]
    lines = [
        _line("deviation", "after", height, delta),
        _line("± 2 standard deviations", "before", height, delta - 2.0 * spread),
        _line("± 2 standard deviations", "before", height, delta + 2.0 * spread),
        _line("threshold of the savings", "limit", height[[0, -1]], np.array([level, level])),
    ]
    return [
        {
            "title": "The rail as the savings below were computed, with the sections that would be straightened",
            "labels": ["height on the rail [m]", "deviation [mm]"],
            "lines": lines,
            "bands": [[s["low_m"], s["high_m"]] for s in saved["sections"]],
        }
    ]


def _savings_sentences(folder: Path, saved: Entry | None, threshold: float) -> list[str]:
    if saved is None:
        profile = folder / "profile.csv"
        command = f"vtsdt what-if --profile {profile} --out {folder / 'what-if'}"
        return [f"What straightening would save: {command}, and then reload this page after starting it again."]
    if abs(saved["threshold_mm"] - threshold) > 0.005:
        return [f"The savings below were computed for a threshold of {saved['threshold_mm']:.2f} mm."]
    return []


def _savings_tables(saved: Entry | None) -> list[Entry]:
    if saved is None:
        return []
    actions = [[name, _interval(a["saving"]), _interval(a["gain"], 100.0)] for name, a in saved["actions"].items()]
    places = [
        [f"{s['low_m']:.2f} to {s['high_m']:.2f} m", f"{s['deviation_mm']:.2f} mm", _interval(s["saving_J"])]
        for s in saved["sections"]
    ]
    heads = [["action", False], ["saved on a trip, J", True], ["gain of efficiency, points", True]]
    tables = [{"title": "What each action would save, with 95 % intervals", "heads": heads, "rows": actions}]
    if places:
        heads = [["section of the rail", False], ["largest deviation", True], ["saved on a trip, J", True]]
        tables.append({"title": "What straightening one section alone would save", "heads": heads, "rows": places})
    return tables


def _interval(value: Mapping[str, float | None], factor: float = 1.0) -> str:
    middle, low, high = (value.get(k) for k in ("value", "low", "high"))
    if middle is None:
        return "–"
    if low is None or high is None:
        return f"{factor * middle:.3g}"
    least = ROUNDING * max(abs(middle), abs(low), abs(high))
    value_text, low_text, high_text = (f"{0.0 if abs(v) < least else factor * v:.3g}" for v in (middle, low, high))
    return f"{value_text} ({low_text} to {high_text})"
