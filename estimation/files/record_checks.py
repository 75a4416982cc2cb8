"""Checks of columns and records: each fault names file, column and row, and the remedy."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from estimation.files.faults import RecordFault, Rows
from estimation.files.record import Record

__all__ = [
    "GRID_TOLERANCE",
    "check_copies",
    "check_finite",
    "check_same_scale",
    "check_time_order",
    "check_values",
    "constant_inputs_once",
    "gap_steps",
    "grid_deviation",
]

GRID_TOLERANCE = 0.1
"""Largest distance of a time stamp from an even grid, as a share of the step, that still counts as even."""
GAP_FACTOR = 5.0
"""A step longer than this many median steps is a gap."""


def check_finite(file: str, column: str, values: np.ndarray, rows: Rows) -> list[RecordFault]:
    """Find values that are missing or infinite."""
    faults = []
    missing, infinite = np.isnan(values), np.isinf(values)
    if missing.all():
        return [RecordFault(f"{file}, column '{column}': every value is missing (NaN or empty): name another column")]
    for mask, what in ((missing, "NaN or empty"), (infinite, "infinite")):
        if mask.any():
            share = 100.0 * float(mask.mean())
            faults.append(
                RecordFault(
                    f"{file}, column '{column}', {rows.say(mask)}: value {what}, {share:.3g} % of the rows: "
                    "repair the file, or leave these rows out with drop_nan = true in [records]"
                )
            )
    return faults


def check_time_order(file: str, column: str, time: np.ndarray, rows: Rows) -> list[RecordFault]:
    """Find time stamps that repeat or run backwards."""
    faults = []
    step = np.diff(time)
    if (step == 0.0).any():
        where = np.append(False, step == 0.0)
        faults.append(
            RecordFault(
                f"{file}, column '{column}', {rows.say(where)}: same time stamp as the row before: remove "
                "them, or keep the first of each with drop_duplicates = true in [records]"
            )
        )
    if (step < 0.0).any():
        where = np.append(False, step < 0.0)
        faults.append(
            RecordFault(
                f"{file}, column '{column}', {rows.say(where)}: time runs backwards: sort the file, or, "
                "if it holds "
                'several trips, name the column that tells them apart with trip = "…" in [records]'
            )
        )
    return faults


def gap_steps(time: np.ndarray, longest: float | None = None) -> np.ndarray:
    """Mark the steps that are gaps.

    Parameters
    ----------
    time : ndarray, shape (n,), s
        Increasing time stamps.
    longest : float, optional, s
        Longest step that is not a gap; default is five median steps.

    Returns
    -------
    ndarray of bool, shape (n - 1,)
        True where the step from this sample to the next is a gap.
    """
    step = np.diff(time)
    if longest is None:
        longest = GAP_FACTOR * float(np.median(step)) if len(step) else np.inf
    return step > longest * (1.0 + 1e-9)


def grid_deviation(time: np.ndarray) -> float:
    """Largest distance of the stamps from their best even grid, as a share of the step (dimensionless)."""
    if len(time) < 3:
        return 0.0
    index = np.arange(len(time)) - (len(time) - 1) / 2.0
    centred = time - time.mean()
    step = float(index @ centred / (index @ index))
    return float(np.max(np.abs(centred - step * index)) / step) if step > 0.0 else np.inf


def _few_levels(values: np.ndarray, most: int = 16) -> bool:
    """Return whether a channel has at most so many different values; a part of it mostly tells."""
    some = values[:: max(1, len(values) // 1000)]
    return len(np.unique(some)) <= most and len(np.unique(values)) <= most


def _clipped(values: np.ndarray) -> tuple[float, np.ndarray] | None:
    """Return the extreme value that the channel keeps in long runs which it enters steeply, and where it does."""
    steps = np.abs(np.diff(values))
    moving = steps[steps > 0.0]
    # A channel with few levels (a switch, a square wave) is at its extremes by nature.
    if len(moving) == 0 or _few_levels(values):
        return None
    usual = float(np.sqrt(np.mean(moving**2)))
    # Where a coarse sensor steps, a motion that turns back reaches its extreme by one step, however slow it is.
    step = float(moving.min())
    coarse = 1.5 * step if np.mean(moving < 1.01 * step) > 0.1 else 0.0
    for extreme in (float(values.max()), float(values.min())):
        at = values == extreme
        edges = np.flatnonzero(np.diff(np.concatenate(([0], at.astype(np.int8), [0]))))
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            # A machine at rest arrives slowly and leaves slowly; a limiter cuts a curve that is still steep.
            entered = steps[start - 1] if start > 0 else 0.0
            left = steps[stop - 1] if stop < len(values) else 0.0
            if stop - start >= 8 and max(entered, left) > max(0.25 * usual, coarse):
                return extreme, at
    return None


def check_values(file: str, column: str, values: np.ndarray, rows: Rows, *, command: bool = False) -> list[RecordFault]:
    """Find channels that are constant or clipped (both warnings); a command has plateaus by design."""
    if len(values) > 1 and np.ptp(values) == 0.0:
        return [
            RecordFault(
                f"{file}, column '{column}': constant at {values[0]:.6g} from {rows.word} "
                f"{int(rows.numbers[0])} to {int(rows.numbers[-1])}: it says nothing about motion; check "
                "the sensor or name another column",
                "warning",
            )
        ]
    if not command and (clipped := _clipped(values)) is not None:
        extreme, where = clipped
        return [
            RecordFault(
                f"{file}, column '{column}', {rows.say(where)}: looks clipped at {extreme:.6g}, "
                f"{100.0 * float(where.mean()):.3g} % of the rows: choose a larger measuring range, or "
                "leave that time out with start and stop in [records]",
                "warning",
            )
        ]
    return []


def check_copies(file: str, signals: Mapping[str, tuple[str, np.ndarray]]) -> list[RecordFault]:
    """Find different columns that hold exactly the same numbers.

    Parameters
    ----------
    file : str
        Name of the file.
    signals : mapping of signal name to (column, values)
    """
    faults = []
    items = list(signals.items())
    for place, (name, (column, values)) in enumerate(items):
        for other, (other_column, other_values) in items[place + 1 :]:
            same = column != other_column and np.array_equal(values, other_values)
            if same and len(values) > 1 and np.ptp(values) > 0.0:
                faults.append(
                    RecordFault(
                        f"{file}, columns '{column}' and '{other_column}': the same numbers in every row, "
                        f"so that '{name}' and '{other}' cannot both be measured: one is a copy; export "
                        "the right channel"
                    )
                )
    return faults


def _range(record: Record, name: str) -> float:
    return float(np.max(np.abs(record.signals[name].values), initial=0.0))


def check_same_scale(records: Sequence[Record], may_be_constant: Collection[str] = ()) -> list[RecordFault]:
    """Find faults that show only between files: swapped columns, other scales or rates, channels not recorded.

    Parameters
    ----------
    records : sequence of Record
        All recordings of a study, with the same signals.
    may_be_constant : collection of str
        Signals that may be constant in every record (model inputs).
    """
    faults: list[RecordFault] = []
    if not records:
        return faults
    first = records[0]
    names = [name for name in first.signals if all(name in record.signals for record in records)]
    for name in names:
        spans = [np.ptp(record.signals[name].values) for record in records]
        level = {float(record.signals[name].values[0]) for record in records}
        if name not in may_be_constant and not any(spans) and len(level) == 1:
            files = ", ".join(dict.fromkeys(record.path.name for record in records))
            faults.append(
                RecordFault(
                    f"{files}, column '{first.signals[name].column}': constant at {level.pop():.6g} in "
                    f"every record: '{name}' was not recorded; name another column or leave this output out"
                )
            )
    for other in records[1:]:
        if other.path == first.path:
            continue
        off = {}
        for name in names:
            a, b = _range(first, name), _range(other, name)
            if a > 0.0 and b > 0.0 and max(a / b, b / a) > 1e3:
                off[name] = b / a
        swapped = [
            (p, q)
            for p in off
            for q in off
            if p < q
            and (off[p] > 1.0) != (off[q] > 1.0)
            and 0.1 < _range(first, p) / _range(other, q) < 10.0
            and 0.1 < _range(first, q) / _range(other, p) < 10.0
        ]
        for p, q in swapped:
            faults.append(
                RecordFault(
                    f"{other.path.name}, columns '{other.signals[p].column}' and "
                    f"'{other.signals[q].column}': look swapped: their scales are those of the other one "
                    f"in {first.path.name}; correct the header"
                )
            )
        for name, ratio in off.items():
            if not any(name in pair for pair in swapped):
                faults.append(
                    RecordFault(
                        f"{other.path.name}, column '{other.signals[name].column}': its largest value is "
                        f"{ratio:.3g} times that in {first.path.name}: check the unit and that the column "
                        "is the same channel",
                        "warning",
                    )
                )
    rates: dict[float, Record] = {}
    for record in records:
        if not any(abs(record.rate / known - 1.0) < 0.01 for known in rates):
            rates[record.rate] = record
    if len(rates) > 1:
        listed = ", ".join(f"{record.name} {rate:.6g} Hz" for rate, record in list(rates.items())[:6])
        faults.append(
            RecordFault(f"the records have different sampling rates ({listed}): each keeps its own", "warning")
        )
    return faults


def constant_inputs_once(records: Sequence[Record], may_be_constant: Collection[str]) -> tuple[Record, ...]:
    """Return the records with one warning for all signals that may be constant and are so in every record.

    A machine that runs at a set speed under a set load would otherwise have one warning for each file and signal; the
    log keeps the values.

    Parameters
    ----------
    records : sequence of Record
    may_be_constant : collection of str
    """
    signals = [r.signals for r in records]
    still = [n for n in may_be_constant if all(n in own and np.ptp(own[n].values) == 0.0 for own in signals)]
    if len(records) < 2 or not still:
        return tuple(records)
    columns = [f"'{signals[0][name].column}'" for name in still]
    text = (
        f"{', '.join(columns)}: constant within each of the {len(records)} recordings: these records show "
        "nothing of how the machine answers when they change"
    )
    warned = []
    for record in records:
        own = [w for w in record.warnings if not any(f"column {c}: constant at" in w for c in columns)]
        warned.append(replace(record, warnings=tuple(own)).warned(text))
    return tuple(warned)
