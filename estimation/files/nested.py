"""Columns from files that nest arrays in groups or structures: each group may have a time of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from estimation.files.dates import seconds_since_first
from estimation.files.faults import RecordError
from estimation.files.table import FileTable, TableRequest, column_faults, present_columns, table_from_arrays

__all__ = ["add_array", "table_from_groups"]


def add_array(arrays: dict[str, np.ndarray], key: str, values: np.ndarray, separator: str) -> None:
    """Add an array under its name; the fields of a table, and the columns of a matrix, become columns.

    Parameters
    ----------
    arrays : dict of str to ndarray
        Is added to.
    key : str
    values : ndarray
        Of any shape; of structures, or of numbers.
    separator : str
        Between the names of groups and of what is in them.
    """
    if values.dtype.names:
        for part in values.dtype.names:
            add_array(arrays, f"{key}{separator}{part}", values[part], separator)
        return
    values = values.squeeze()
    arrays[key] = values
    if values.ndim == 2 and min(values.shape) > 0:
        # more samples than channels: the longer side is time
        table = values if values.shape[0] >= values.shape[1] else values.T
        for k in range(table.shape[1]):
            arrays[f"{key}[{k}]"] = table[:, k]


def table_from_groups(
    path: Path,
    arrays: Mapping[str, np.ndarray],
    request: TableRequest,
    separator: str,
    what: str,
    units: Mapping[str, str] | None = None,
) -> FileTable:
    """Return the table of columns that stand in groups.

    The time of a column is the array of the time column's name in its own group, or in one around it.

    Parameters
    ----------
    path : Path
    arrays : mapping of str to ndarray
        By full name.
    request : TableRequest
    separator : str
        Between the names of groups.
    what : str
        What the format calls an array.
    units : mapping of str to str, optional

    Raises
    ------
    RecordError
        If a column is missing or is no vector, or columns without a time of their own differ in length.
    """
    name = path.name
    vectors = {key: value for key, value in arrays.items() if value.ndim == 1 and value.size > 1}
    times = {}
    for column in request.every:
        if column in vectors and column != request.time and request.time:
            base = _time_of(column, request.time, vectors, separator)
            if base and base != request.time:
                times[column] = base
    if times and request.time not in vectors:  # every group has its own time
        request = replace(request, columns=tuple(c for c in request.columns if c != request.time))
    request = present_columns(request, arrays)
    faults = [
        f"{name}: '{key}' has the shape {arrays[key].shape} and is not a column of samples"
        for key in request.every
        if key in arrays and key not in vectors
    ]
    faults += column_faults(name, [key for key in request.every if key not in arrays], list(vectors), what)
    lengths = {key: len(vectors[key]) for key in request.every if key in vectors and key not in times}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"'{key}' {length}" for key, length in lengths.items())
        faults.append(
            f"{name}: the {what}s have different numbers of samples: {listed}: export them on one time base, or put "
            f"those of each time base into a group with its own '{request.time or 'time'}'"
        )
    faults += [
        f"{name}: '{key}' has {len(vectors[key])} samples and its time '{base}' {len(vectors[base])}"
        for key, base in times.items()
        if key in vectors and len(vectors[key]) != len(vectors[base])
    ]
    if faults:
        raise RecordError(faults)
    bases, origins, log = {}, {}, []
    for key, base in times.items():
        stamps = vectors[base]
        if stamps.dtype.kind == "M":
            dates = seconds_since_first(base, stamps)
            bases[key], origins[key] = dates.seconds, dates.origin or 0
            log += [line for line in dates.log if line not in log]
        else:
            bases[key] = np.asarray(stamps, dtype=float)
    return table_from_arrays(
        path, list(vectors), request, lambda key: vectors[key], log=log, units=units, times=bases, origins=origins
    )


def _time_of(column: str, time: str, vectors: Mapping[str, np.ndarray], separator: str) -> str:
    """Return the full name of the nearest time array, looking from the column's group outwards; empty if none."""
    group = column.split(separator)[:-1]
    while True:
        name = separator.join([*group, time])
        if name in vectors:
            return name
        if not group:
            return ""
        group = group[:-1]
