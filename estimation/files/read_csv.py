"""The columns of a CSV file, compressed or not, with any of the usual delimiters, encodings and decimal marks."""

from __future__ import annotations

import csv
import re
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from estimation.files.bounded import check_size, unpacked_gzip
from estimation.files.faults import RecordError, Rows
from estimation.files.table import NUMBER, FileTable, cells_to_numbers, column_faults, notes_on_names, present_columns

__all__ = ["read_csv"]

_GZIP = b"\x1f\x8b"


def _decode(name: str, raw: bytes) -> tuple[str, list[str]]:
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        try:
            return raw.decode("utf-16"), ["read as UTF-16"]
        except UnicodeDecodeError as error:
            raise RecordError([f"{name}: is not readable as UTF-16 text: save it as UTF-8"]) from error
    if b"\x00" in raw[:65536]:
        raise RecordError([f"{name}: holds binary data and not text: export it as CSV"])
    try:
        return raw.decode("utf-8-sig"), []
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace"), ["not UTF-8: read as Windows-1252"]


def read_csv(path: Path, columns: list[str], labels: list[str], optional: Collection[str]) -> FileTable:
    """Read columns of a CSV file; see `estimation.files.read_table.read_table`."""
    name = path.name
    check_size(name, path.stat().st_size, path.stat().st_size, text=True)
    raw = path.read_bytes()
    if raw.startswith(_GZIP):
        raw = unpacked_gzip(path, raw)
    elif name.lower().endswith(".gz"):
        raise RecordError([f"{name}: is not a gzip file although its name says so: rename it to '{name[:-3]}'"])
    text, log = _decode(name, raw)
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    kept = [place for place, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")]
    if not kept:
        raise RecordError([f"{name}: the file is empty"])
    header, body_at = lines[kept[0]], kept[1:]
    body = [lines[place] for place in body_at]
    delimiter = _delimiter(header, body[:1])
    names = [cell.strip() for cell in _split(header, delimiter)]
    if all(NUMBER.fullmatch(cell.replace(",", ".")) for cell in names):
        raise RecordError([f"{name}, line {kept[0] + 1}: no header, the first line holds numbers: add column names"])
    columns = present_columns(columns, names, optional)
    faults = column_faults(name, [*columns, *labels], names)
    if faults and (len(names) == 1 or names[0].lower() == "sep="):
        faults.append(
            f"{name}, line {kept[0] + 1}: '{header[:40]}' does not look like a header: "
            "separate columns by comma, semicolon or tab, and put # before lines that stand above the header"
        )
        raise RecordError(faults)
    rows = Rows(np.array(body_at, dtype=np.int64) + 1, "line")
    if not body:
        faults.append(f"{name}: there is a header but no data below it")
        raise RecordError(faults)
    widths = _widths(body, delimiter)
    if (wrong := widths != len(names)).any():
        place = int(np.flatnonzero(wrong)[0])
        remedy = "the last line is incomplete: remove it" if place == len(body) - 1 else "repair these lines"
        if delimiter == "," and widths[place] == 2 * len(names):
            remedy = "with decimal commas, separate columns by semicolons"
        faults.append(
            f"{name}, {rows.say(wrong)}: {widths[place]} cells where the header has {len(names)} columns: {remedy}"
        )
    if faults:
        raise RecordError(faults)
    decimal = "." if delimiter == "," else _decimal(body, delimiter)
    if decimal == ",":
        log.append("decimal commas")
    log += notes_on_names(names, [*columns, *labels])
    numbers, label_cells, faults = _parse(name, names, columns, labels, body, delimiter, decimal, rows)
    if faults:
        raise RecordError(faults)
    return FileTable(path=path, names=tuple(names), numbers=numbers, labels=label_cells, rows=rows, log=tuple(log))


def _delimiter(header: str, first: Sequence[str]) -> str:
    bare = re.sub(r'"[^"]*"', "", header)
    for delimiter in (";", "\t", ","):
        count = bare.count(delimiter)
        below = [re.sub(r'"[^"]*"', "", line).count(delimiter) for line in first]
        # A semicolon inside one name of a comma-separated file does not appear in the data.
        if count and (delimiter == "," or not below or below[0] == count or bare.count(",") == 0):
            return delimiter
    return ","


def _split(line: str, delimiter: str) -> list[str]:
    if '"' in line:
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    return line.split(delimiter)


def _widths(body: Sequence[str], delimiter: str) -> np.ndarray:
    return np.array(
        [len(_split(line, delimiter)) if '"' in line else line.count(delimiter) + 1 for line in body],
        dtype=np.int64,
    )


def _decimal(body: Sequence[str], delimiter: str) -> str:
    pattern = re.compile(rf"(?:^|{re.escape(delimiter)})\s*\"?[+-]?\d*,\d+(?:[eE][+-]?\d+)?\"?\s*(?:$|{delimiter})")
    return "," if any(pattern.search(line) for line in body) else "."


def _parse(
    name: str,
    names: list[str],
    columns: list[str],
    labels: list[str],
    body: list[str],
    delimiter: str,
    decimal: str,
    rows: Rows,
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], list[str]]:
    places = [names.index(column) for column in columns]
    plain = decimal == "." and not any('"' in line for line in body)
    numbers: dict[str, np.ndarray] = {}
    if plain and columns:
        try:
            block = np.loadtxt(body, delimiter=delimiter, usecols=places, comments=None, ndmin=2, dtype=float)
            numbers = {column: np.ascontiguousarray(block[:, k]) for k, column in enumerate(columns)}
        except ValueError:
            pass  # some cell is empty or text: read cell by cell, so that it can be named
    if len(numbers) == len(columns) and not labels:
        return numbers, {}, []
    cells = [_split(line, delimiter) for line in body]
    faults: list[str] = []
    for column, place in zip(columns, places, strict=True):
        if column not in numbers:
            numbers[column], wrong = cells_to_numbers(name, column, [row[place] for row in cells], rows, decimal)
            faults += wrong
    label_cells = {label: np.array([row[names.index(label)].strip() for row in cells]) for label in labels}
    return numbers, label_cells, faults
