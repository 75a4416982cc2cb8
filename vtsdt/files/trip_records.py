"""Reading trips for commands that take recordings alone: what to do is said without the keys of a study file."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from estimation.files.faults import RecordError
from estimation.files.read_records import read_records
from estimation.files.record import Record

__all__ = ["read_without_study"]


def read_without_study(paths: list[str | Path], **options: Any) -> tuple[Record, ...]:
    """Return the records of some files; arguments as of `estimation.files.read_records.read_records`.

    Raises
    ------
    RecordError
        With every fault of every file.
    """
    try:
        return read_records(paths, **options)
    except RecordError as error:
        raise RecordError([_without_keys(fault) for fault in error.faults]) from error


def _without_keys(fault: str) -> str:
    """Return a fault whose remedy is no key of a study file.

    Examples
    --------
    >>> _without_keys("a.csv, lines 3, 4: a gap: repair the file, or leave it out with drop_nan = true in [records]")
    'a.csv, lines 3, 4: a gap: repair the file'
    >>> _without_keys("a.csv: no time: say so with time_format in [records]")
    'a.csv: no time: repair the recording'
    """
    if "[records]" not in fault:
        return fault
    parts = [part for part in re.split(r", or |; ", fault) if "[records]" not in part]
    if parts and ": " in parts[-1] and len(parts[-1].split(": ")) > 2:
        return ", or ".join(parts)
    head = fault.rsplit(": ", 1)[0]
    return f"{head}: repair the recording"
