"""The time bases of one file: columns that were sampled together, each group as a table of its own."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from estimation.files.faults import Rows
from estimation.files.record_checks import GRID_TOLERANCE, grid_deviation
from estimation.files.table import FileTable

__all__ = ["OWN_TIME", "tables_by_time"]

OWN_TIME = "time"
"""Name of the time of channels that have their own."""

#: Share of the rows in which a cell must be empty, and of the record over which they must be spread, for a column to be
#: sampled less often than the table has rows; chosen: a sensor that fails or starts late is not meant.
LEAST_MISSING, LEAST_SPREAD = 0.05, 0.5


def tables_by_time(table: FileTable, time: str, signals: Collection[str]) -> list[FileTable]:
    """Return a table for each time base of a file.

    Columns of one table that have values in some of its rows only, evenly spaced, were sampled at a rate of their own:
    they make a table of these rows.  Nothing is filled in.

    Parameters
    ----------
    table : FileTable
    time : str
        Its time column; empty where the channels have their own.
    signals : collection of str
        Columns to keep together with the time.

    Returns
    -------
    list of FileTable
        Each with its time column `time` (`OWN_TIME` where that is empty), in the order of the columns.
    """
    name = time or OWN_TIME
    groups: list[tuple[np.ndarray, list[str]]] = []
    shared = []
    for column in signals:
        if column not in table.numbers:
            continue
        if column not in table.times:
            shared.append(column)
            continue
        base = table.times[column]
        for other, members in groups:
            same_origin = table.origins.get(members[0]) == table.origins.get(column)
            if same_origin and len(other) == len(base) and np.array_equal(other, base):
                members.append(column)
                break
        else:
            groups.append((base, [column]))
    tables = [
        replace(
            table,
            numbers={name: base, **{c: table.numbers[c] for c in members}},
            labels={},
            rows=Rows(np.arange(1, len(base) + 1)),
            units={**table.units, name: "s"},
            times={},
            origins={name: table.origins[members[0]]} if members[0] in table.origins else {},
        )
        for base, members in groups
    ]
    if shared or not groups:
        tables = [*_by_rows(table, name, shared), *tables]
    return tables


def _by_rows(table: FileTable, time: str, columns: list[str]) -> list[FileTable]:
    """Return a table for each set of rows in which columns have values."""
    if time not in table.numbers:
        return [table]
    stamps = table.numbers[time]
    groups: list[tuple[np.ndarray | None, list[str]]] = []
    for column in columns:
        filled = np.isfinite(table.numbers[column])
        own = filled if _is_own_rate(stamps, filled) else None
        for mask, members in groups:
            if (mask is None and own is None) or (mask is not None and own is not None and np.array_equal(mask, own)):
                members.append(column)
                break
        else:
            groups.append((own, [column]))
    if not any(mask is not None for mask, _ in groups):
        return [table]
    tables = []
    for mask, members in groups:
        kept = np.ones(len(stamps), dtype=bool) if mask is None else mask
        rate = [f"{', '.join(members)}: values in {int(kept.sum())} of {len(kept)} rows, taken at these instants"]
        tables.append(
            replace(
                table,
                numbers={time: stamps[kept], **{c: table.numbers[c][kept] for c in members}},
                labels={key: label[kept] for key, label in table.labels.items()},
                rows=table.rows.take(kept),
                log=(*table.log, *(rate if mask is not None else [])),
            )
        )
    return tables


def _is_own_rate(time: np.ndarray, filled: np.ndarray) -> bool:
    """Return whether a column is filled evenly, in some rows only, all over a table."""
    missing = np.flatnonzero(~filled)
    if filled.sum() < 3 or len(missing) < LEAST_MISSING * len(filled):
        return False
    if missing[-1] - missing[0] < LEAST_SPREAD * len(filled):
        return False
    stamps = time[filled]
    if not np.all(np.isfinite(stamps)) or not np.all(np.diff(stamps) > 0.0):
        return False
    return grid_deviation(stamps) <= GRID_TOLERANCE
