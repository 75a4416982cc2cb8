"""A table: some columns of a measurement file as the file holds them, before units and checks."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from estimation.files.faults import RecordError, Rows
from multibody.base.spelling import nearest_or_choices

__all__ = [
    "NUMBER",
    "FileTable",
    "cells_to_numbers",
    "column_faults",
    "notes_on_names",
    "present_columns",
    "table_from_arrays",
]

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?inf(inity)?", re.IGNORECASE)
_MISSING = {"", "nan", "na", "n/a", "null", "none", "-nan", "+nan", "#n/a"}


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
    """

    path: Path
    names: tuple[str, ...]
    numbers: dict[str, np.ndarray]
    labels: dict[str, np.ndarray]
    rows: Rows
    log: tuple[str, ...] = field(default=())


def present_columns(columns: Sequence[str], names: Collection[str], optional: Collection[str]) -> list[str]:
    """Return the columns without those that are optional and missing."""
    return [column for column in columns if column in names or column not in optional]


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
    elif re.match(r"\d{1,4}[-/.:]\d{1,2}[-/.:T ]", sample):
        remedy = "give time as a number, in seconds since the start"
    elif wrong[0] and not wrong[1:].any():
        remedy = f"if it is a unit, write it into the header, such as '{column} [{sample}]'"
    return values, [f"{name}, column '{column}', {rows.say(wrong)}: '{sample}' is not a number: {remedy}"]


def _as_numbers(name: str, column: str, values: np.ndarray, rows: Rows, log: list[str]) -> tuple[np.ndarray, list[str]]:
    """Convert an array of any type to numbers; text and complex numbers are refused."""
    if values.dtype.kind in "iuf":
        return np.asarray(values, dtype=float), []
    if values.dtype.kind == "b":
        log.append(f"{column}: true/false read as 1/0")
        return np.asarray(values, dtype=float), []
    if values.dtype.kind == "M":
        log.append(f"{column}: dates, read as seconds since the first")
        return (values - values[0]) / np.timedelta64(1, "ns") * 1e-9, []
    if values.dtype.kind == "m":
        return values / np.timedelta64(1, "ns") * 1e-9, []
    if values.dtype.kind in "OU":
        return cells_to_numbers(name, column, ["" if cell is None else str(cell) for cell in values], rows, ".")
    return np.zeros(len(values)), [f"{name}, column '{column}': holds {values.dtype} and not real numbers"]


def table_from_arrays(
    path: Path, names: list[str], columns: list[str], labels: list[str], get: Callable[[str], Any]
) -> FileTable:
    """Return the table of columns that a reader holds as arrays; ``get`` returns the array of a column."""
    arrays = {column: np.asarray(get(column)) for column in [*columns, *labels]}
    count = len(next(iter(arrays.values()))) if arrays else 0
    rows = Rows(np.arange(1, count + 1))
    log: list[str] = notes_on_names(names, [*columns, *labels])
    faults: list[str] = []
    numbers = {}
    for column in columns:
        numbers[column], wrong = _as_numbers(path.name, column, arrays[column], rows, log)
        faults += wrong
    if faults:
        raise RecordError(faults)
    texts = {label: np.array([_label(value) for value in arrays[label].tolist()]) for label in labels}
    return FileTable(path=path, names=tuple(names), numbers=numbers, labels=texts, rows=rows, log=tuple(log))


def _label(value: Any) -> str:
    return f"{value:.12g}" if isinstance(value, float) else str(value)
