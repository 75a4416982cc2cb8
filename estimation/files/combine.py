"""One record from parts that were sampled on different time bases: files of several loggers, or groups of one file.

The record has the grid of the fastest part.  Outputs of the others keep their samples at their own instants, where the
model is compared with them; inputs are interpolated onto the grid.  No sample inside the time that the parts have in
common is left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from estimation.files.faults import RecordError
from estimation.files.record import OwnSamples, Record, RecordedSignal
from estimation.files.record_checks import GRID_TOLERANCE, grid_deviation

__all__ = ["combine"]

LEAST_COMMON = 16
"""Samples of the fastest part that the parts must have in common."""


def combine(
    parts: Sequence[Record], name: str, driven: Mapping[str, str], offsets: Mapping[str, float] | None = None
) -> Record:
    """Return one record from parts with time bases of their own.

    Parameters
    ----------
    parts : sequence of Record
    name : str
        Of the record.
    driven : mapping of str to {"linear", "hold"}
        Signals that drive a model, and what they do between samples.  All others are compared with a model.
    offsets : mapping of str to float, s
        File name to what is added to its time.

    Raises
    ------
    RecordError
        If the parts have no time in common, or only some state the calendar time.
    """
    offsets = offsets or {}
    times = _common_clock(parts, name, offsets)
    fastest = _fastest(parts, driven)
    begin, end = max(t[0] for t in times), min(t[-1] for t in times)
    grid = _grid(times[fastest])
    slack = 1e-6 * (grid[1] - grid[0])
    grid = grid[(grid >= begin - slack) & (grid <= end + slack)]
    if len(grid) < LEAST_COMMON:
        spans = "; ".join(
            f"{p.path.name} ({', '.join(s.column for s in p.signals.values())}) from {t[0]:.6g} to {t[-1]:.6g} s"
            for p, t in zip(parts, times, strict=True)
        )
        raise RecordError(
            [
                f"{name}: its parts have no time in common: {spans}: check that they belong together, their time "
                'zones, and their clocks with [clocks] "file" = { offset = … } (s)'
            ]
        )
    log = list(dict.fromkeys(line for part in parts for line in part.log))
    signals: dict[str, RecordedSignal] = {}
    for part, time in zip(parts, times, strict=True):
        on_grid = grid_deviation(time) <= GRID_TOLERANCE and _same_instants(time, grid)
        inside = (time >= begin - slack) & (time <= end + slack)
        lost = int((~inside).sum())
        listed = ", ".join(s.column for s in part.signals.values())
        if lost:
            log.append(f"{listed}: {lost} of {len(time)} samples lie outside the time that all parts have in common")
        if not on_grid and (compared := [s.column for k, s in part.signals.items() if k not in driven]):
            rate = 1.0 / float(np.median(np.diff(time)))
            log.append(f"{', '.join(compared)}: compared at its own instants, about {rate:.4g} Hz")
        for key, signal in part.signals.items():
            if on_grid:
                signals[key] = replace(signal, values=signal.values[np.searchsorted(time, grid - 0.5 * _step(grid))])
            elif key in driven:
                signals[key] = replace(signal, values=_input_on(grid, time, signal.values, driven[key]))
            else:
                own = OwnSamples(time[inside], signal.values[inside])
                signals[key] = replace(signal, values=own.values[own.nearest(grid)], own=own)
    warnings = tuple(dict.fromkeys(line for part in parts for line in part.warnings))
    first = parts[fastest]
    return Record(
        name=name,
        path=parts[0].path,
        time=grid,
        signals=signals,
        log=tuple(log),
        warnings=warnings,
        origin=first.origin,
    )


def _step(grid: np.ndarray) -> float:
    return float(grid[-1] - grid[0]) / (len(grid) - 1)


def _common_clock(parts: Sequence[Record], name: str, offsets: Mapping[str, float]) -> list[np.ndarray]:
    """Return the times of all parts on one clock."""
    dated = [part.origin is not None for part in parts]
    if any(dated) and not all(dated):
        undated = sorted({p.path.name for p, d in zip(parts, dated, strict=True) if not d} - set(offsets))
        if undated:
            raise RecordError(
                [
                    f"{name}: {', '.join(undated)} states no calendar time and another part does: say when it began "
                    f'after the others with [clocks] "{undated[0]}" = {{ offset = … }} (s)'
                ]
            )
    origin = min((part.origin for part in parts if part.origin is not None), default=0)
    shifts = [0.0 if part.origin is None else (part.origin - origin) * 1e-9 for part in parts]
    # Files that all state a calendar time begin together at zero; times of one file stay as they are.
    return [
        np.asarray(part.time) + shift + offsets.get(part.path.name, 0.0)
        for part, shift in zip(parts, shifts, strict=True)
    ]


def _fastest(parts: Sequence[Record], driven: Mapping[str, str]) -> int:
    """Return the part with the highest rate; of equal ones that with the most outputs."""
    outputs = [sum(key not in driven for key in part.signals) for part in parts]
    return max(range(len(parts)), key=lambda k: (round(float(parts[k].rate), 6), outputs[k]))


def _grid(time: np.ndarray) -> np.ndarray:
    """Return the time stamps, or an even grid of the same number where they jitter."""
    if grid_deviation(time) <= GRID_TOLERANCE:
        return time
    count = round(float(time[-1] - time[0]) / float(np.median(np.diff(time)))) + 1
    return np.linspace(time[0], time[-1], count)


def _same_instants(time: np.ndarray, grid: np.ndarray) -> bool:
    """Return whether the grid's instants are among some times."""
    step = _step(grid)
    place = np.searchsorted(time, grid - 0.5 * step).clip(0, len(time) - 1)
    return bool(np.all(np.abs(time[place] - grid) <= 1e-3 * step))


def _input_on(grid: np.ndarray, time: np.ndarray, values: np.ndarray, interpolation: str) -> np.ndarray:
    if interpolation == "hold":
        return values[np.searchsorted(time, grid + 1e-9 * _step(grid), side="right").clip(1) - 1]
    return np.interp(grid, time, values)
