"""The table of a file in which every channel has its own time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from estimation.files.faults import RecordError
from estimation.files.table import FileTable, TableRequest, column_faults, present_columns, table_from_arrays

__all__ = ["table_from_channels"]


def table_from_channels(
    path: Path,
    names: Sequence[str],
    request: TableRequest,
    get: Callable[[str], tuple[np.ndarray, np.ndarray, int | None]],
    units: Mapping[str, str],
    what: str,
) -> FileTable:
    """Return the table of channels with times of their own.

    Parameters
    ----------
    path : Path
    names : sequence of str
        Every channel of the file.
    request : TableRequest
        Its time column is left out where the file has no channel of that name.
    get : callable
        Returns samples, times (s) and the calendar time of time zero (ns since 1970, UTC; None if it is not known) of
        a channel.
    units : mapping of str to str
        Unit of each channel as the file states it.
    what : str
        What the format calls a channel.

    Raises
    ------
    RecordError
        If a channel is missing or holds no samples.
    """
    if request.time not in names:
        request = replace(request, columns=tuple(c for c in request.columns if c != request.time))
    request = present_columns(request, names)
    if faults := column_faults(path.name, request.every, names, what):
        raise RecordError(faults)
    read = {name: get(name) for name in request.every}
    faults = [f"{path.name}: the {what} '{name}' holds no samples" for name, (y, _, _) in read.items() if not len(y)]
    if faults:
        raise RecordError(faults)
    return table_from_arrays(
        path,
        names,
        request,
        lambda name: read[name][0],
        units=units,
        times={name: np.asarray(t, dtype=float) for name, (_, t, _) in read.items()},
        origins={name: origin for name, (_, _, origin) in read.items() if origin is not None},
    )
