"""The channels of an MDF file (ASAM), version 3 or 4, each at its own rate."""

from __future__ import annotations

import traceback
from pathlib import Path
from typing import Any

import numpy as np

from estimation.files.faults import RecordError
from estimation.files.optional_library import library
from estimation.files.own_times import table_from_channels
from estimation.files.table import FileTable, TableRequest

__all__ = ["read_mdf"]


def read_mdf(path: Path, request: TableRequest) -> FileTable:
    """Read channels of an MDF file; see `estimation.files.read_table.read_table`.

    A channel whose name occurs in several groups is called ``name@group``, with the group's number.  Channels are read
    one by one: a common table would fill in what was not measured.
    """
    asammdf = library("asammdf", path, "an MDF file", "mdf")
    try:
        file = asammdf.MDF(path, raise_on_multiple_occurrences=False)
    except Exception as error:  # the reader raises many kinds on damaged files
        _let_go(error)
        raise RecordError([f"{path.name}: is not a readable MDF file ({error}): export it again"]) from error
    with file:
        places: dict[str, tuple[int, int]] = {}
        units: dict[str, str] = {}
        for name, occurrences in file.channels_db.items():
            own = [(g, c) for g, c in occurrences if c != file.masters_db.get(g)]
            for g, c in own:
                key = name if len(own) == 1 else f"{name}@{g}"
                places[key] = g, c
                units[key] = str(getattr(file.groups[g].channels[c], "unit", "") or "")
        start = file.header.start_time

        def get(name: str) -> tuple[np.ndarray, np.ndarray, int | None]:
            g, c = places[name]
            signal: Any = file.get(group=g, index=c)
            return signal.samples, signal.timestamps, round(start.timestamp() * 1e6) * 1000

        return table_from_channels(path, list(places), request, get, units, "channel")


def _let_go(error: Exception) -> None:
    """Keep the library from closing a damaged file a second time.

    It has closed the file already, but the object's finaliser tries again and fails in whatever code runs when it is
    collected: an import that is under way breaks.
    """
    for frame, _ in traceback.walk_tb(error.__traceback__):
        opened = frame.f_locals.get("self")
        if opened is not None and hasattr(opened, "_closed"):
            opened._closed = True
