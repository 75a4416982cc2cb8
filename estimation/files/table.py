"""A table: some columns of a measurement file as the file holds them, before units and checks."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from estimation.files.dates import dates_from_text, seconds_since_first
from estimation.files.faults import RecordError, Rows
from estimation.files.header import is_date
from multibody.base.spelling import nearest_or_choices

__all__ = [
    "NUMBER",
    "FileTable",
    "TableRequest",
    "column_faults",
    "present_columns",
    "table_from_arrays",
]

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?inf(inity)?", re.IGNORECASE)
_MISSING = {"", "nan", "na", "n/a", "null", "none", "-nan", "+nan", "#n/a"}


@dataclass(frozen=True, kw_only=True)
class TableRequest:
    """What is asked of a file.

    Attributes
    ----------
    columns : tuple of str
        Columns that hold numbers.  Without any, a reader returns the names and units of the file and nothing else.
    labels : tuple of str
        Columns that hold labels (trips, segments): numbers or text.
    optional : frozenset of str
        Columns that the file need not have; those it lacks are left out of ``numbers``.
    skip_rows : int
        Lines above the header of a text file or sheet, where its place is not recognised.
    time_format : str, optional
        How dates are written, such as ``"%d/%m/%Y %H:%M:%S"``.
    time_zone : str, optional
        Of dates that state none.
    time : str
        The time column; empty where the file's own time of each channel is meant.  A file whose channels have times of
        their own need not have it.
    """

    columns: tuple[str, ...] = ()
    labels: tuple[str, ...] = ()
    optional: frozenset[str] = frozenset()
    skip_rows: int = 0
    time_format: str | None = None
    time_zone: str | None = None
    time: str = ""

    @property
    def every(self) -> tuple[str, ...]:
        """Columns and labels."""
        return (*self.columns, *self.labels)


@dataclass(frozen=True, kw_only=True)
class FileTable:
    """Some columns of a file, with the numbers of the file.

    Attributes
    ----------
    path : Path
    names : tuple of str
        Every column of the file, in its order.
    numbers : dict of str to ndarray, shape (n,)
        The requested columns as floating-point numbers; NaN where a cell is empty.
    labels : dict of str to ndarray of str, shape (n,)
        The requested label columns as text.
    rows : Rows
        Line or row of each sample in the file.
    log : tuple of str
        What was assumed while reading.
    units : dict of str to str
        Unit of a column where the file states it beside the name (a row of units, an attribute).
    times : dict of str to ndarray, s
        Time of each sample of a column that has its own time base; such columns may differ in length.
    origins : dict of str to int
        Calendar time at which the seconds of a column of dates, or of a column's own time base, begin: ns since
        1970, UTC.
    """

    path: Path
    names: tuple[str, ...]
    numbers: dict[str, np.ndarray]
    labels: dict[str, np.ndarray]
    rows: Rows
    log: tuple[str, ...] = field(default=())
    units: dict[str, str] = field(default_factory=dict)
    times: dict[str, np.ndarray] = field(default_factory=dict)
    origins: dict[str, int] = field(default_factory=dict)


def present_columns(request: TableRequest, names: Collection[str]) -> TableRequest:
    """Return the request without the columns that are optional and missing."""
    kept = tuple(column for column in request.columns if column in names or column not in request.optional)
    return replace(request, columns=kept)


def column_faults(name: str, wanted: Sequence[str], names: Sequence[str], what: str = "column") -> list[str]:
    """Return a fault for each column that is missing or named more than once; the nearest name is the remedy."""
    counts = Counter(names)
    faults = [
        f"{name}: there is no {what} '{key}'{nearest_or_choices(key, names)}" for key in wanted if key not in counts
    ]
    faults += [
        f"{name}: {counts[key]} {what}s are called '{key}': give each its own name" for key in wanted if counts[key] > 1
    ]
    return faults


def notes_on_names(names: Sequence[str], wanted: Sequence[str]) -> list[str]:
    """Return a warning for the log where columns that are not used share a name."""
    twice = [key for key, count in Counter(names).items() if count > 1 and key and key not in wanted]
    return [f"warning: columns with the same name, not used here: {', '.join(twice)}"] if twice else []


def cells_to_numbers(
    name: str, column: str, cells: Sequence[str], rows: Rows, decimal: str
) -> tuple[np.ndarray, list[str]]:
    """Convert text to numbers cell by cell; the cells that are not numbers make one fault with their lines."""
    values = np.full(len(cells), np.nan)
    wrong = np.zeros(len(cells), dtype=bool)
    for place, cell in enumerate(cells):
        text = cell.strip()
        dotted = text.replace(",", ".") if decimal == "," and "." not in text else text
        if NUMBER.fullmatch(dotted) and not (decimal == "," and "." in text):
            values[place] = float(dotted)
        elif text.lower() not in _MISSING:
            wrong[place] = True
    if not wrong.any():
        return values, []
    sample = cells[int(np.flatnonzero(wrong)[0])].strip()[:30]
    remedy = "write numbers only, and leave a cell empty where there is no value"
    if decimal == "," and NUMBER.fullmatch(sample):
        remedy = "the file uses decimal commas elsewhere: use one of the two throughout"
    elif re.fullmatch(r"\d[\d.,]*", sample):
        remedy = "write numbers without thousands separators"
    elif is_date(sample):
        remedy = "give time as a number in every row, or as a date in every row"
    elif wrong[0] and not wrong[1:].any():
        remedy = f"if it is a unit, write it into the header, such as '{column} [{sample}]'"
    return values, [f"{name}, column '{column}', {rows.say(wrong)}: '{sample}' is not a number: {remedy}"]


@dataclass(kw_only=True)
class _Numbers:
    """Columns turned into numbers one after the other, with what was assumed and what was wrong."""

    name: str
    request: TableRequest
    log: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    origins: dict[str, int] = field(default_factory=dict)

    def of(self, column: str, values: np.ndarray, rows: Rows, decimal: str = ".") -> np.ndarray:
        """Return an array of any type as numbers; text and complex numbers are faults."""
        if values.dtype.kind in "iuf":
            return np.asarray(values, dtype=float)
        if values.dtype.kind == "b":
            self.log.append(f"{column}: true/false read as 1/0")
            return np.asarray(values, dtype=float)
        if values.dtype.kind == "M":
            dates = seconds_since_first(column, values)
            self.log += dates.log
            self.origins[column] = dates.origin or 0
            return dates.seconds
        if values.dtype.kind == "m":
            return values / np.timedelta64(1, "ns") * 1e-9
        if values.dtype.kind in "OU":
            return self.of_cells(column, ["" if cell is None else str(cell) for cell in values], rows, decimal)
        self.faults.append(f"{self.name}, column '{column}': holds {values.dtype} and not real numbers")
        return np.zeros(len(values))

    def of_cells(self, column: str, cells: Sequence[str], rows: Rows, decimal: str) -> np.ndarray:
        """Return cells of text as numbers: dates as seconds since the first."""
        first = next((cell for cell in cells if cell.strip().lower() not in _MISSING), "")
        if is_date(first) and not NUMBER.fullmatch(first.strip()):
            request = self.request
            dates, wrong = dates_from_text(self.name, column, cells, rows, request.time_format, request.time_zone)
            self.log += dates.log
            if dates.origin is not None:
                self.origins[column] = dates.origin
            self.faults += wrong
            return dates.seconds
        numbers, wrong = cells_to_numbers(self.name, column, cells, rows, decimal)
        self.faults += wrong
        return numbers


def table_from_arrays(
    path: Path,
    names: Sequence[str],
    request: TableRequest,
    get: Callable[[str], Any],
    *,
    rows: Rows | None = None,
    decimal: str = ".",
    log: Sequence[str] = (),
    units: Mapping[str, str] | None = None,
    times: Mapping[str, np.ndarray] | None = None,
    origins: Mapping[str, int] | None = None,
) -> FileTable:
    """Return the table of columns that a reader holds as arrays.

    Parameters
    ----------
    path : Path
    names : sequence of str
        Every column of the file.
    request : TableRequest
        Its columns are in the file: `present_columns` leaves out those that need not be.
    get : callable
        Returns the array of a column: numbers, dates or text.
    rows : Rows, optional
        Default: rows 1, 2, …
    decimal : {".", ","}
        Of cells that are text.
    log, units, times, origins
        As in `FileTable`; ``units`` and ``times`` may name more columns than were asked for.

    Raises
    ------
    RecordError
        Where a cell is not a number.
    """
    arrays = {column: np.asarray(get(column)) for column in request.every}
    count = max((len(array) for array in arrays.values()), default=0)
    rows = rows or Rows(np.arange(1, count + 1))
    notes = [*log, *notes_on_names(names, request.every)]
    read = _Numbers(name=path.name, request=request, log=notes)
    numbers = {c: read.of(c, arrays[c], rows.take(slice(0, len(arrays[c]))), decimal) for c in request.columns}
    if read.faults:
        raise RecordError(read.faults)
    texts = {label: np.array([_label(value) for value in arrays[label].tolist()]) for label in request.labels}
    return FileTable(
        path=path,
        names=tuple(names),
        numbers=numbers,
        labels=texts,
        rows=rows,
        log=tuple(read.log),
        units={c: unit for c, unit in (units or {}).items() if unit},
        times={c: base for c, base in (times or {}).items() if c in numbers},
        origins={**read.origins, **(origins or {})},
    )


def _label(value: Any) -> str:
    return f"{value:.12g}" if isinstance(value, float) else str(value).strip()
