"""The columns of a text table, compressed or not, with any of the usual delimiters, encodings and decimal marks.

Regular files are parsed by pyarrow, in blocks and by several threads.  A file that it refuses is read line by line, so
that the lines at fault can be named.
"""

from __future__ import annotations

import csv
import mmap
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from estimation.files.bounded import check_size, unpacked_gzip
from estimation.files.faults import RecordError, Rows
from estimation.files.header import Header, find_header, is_number
from estimation.files.table import (
    NUMBER,
    FileTable,
    TableRequest,
    column_faults,
    present_columns,
    table_from_arrays,
)

__all__ = ["read_csv"]

_GZIP = b"\x1f\x8b"
#: Bytes in which header, delimiter and decimal mark are looked for.
SAMPLE = 1 << 16
_EMPTY = ["", "nan", "NaN", "NAN", "na", "NA", "n/a", "N/A", "null", "NULL", "none", "None", "-nan", "+nan", "#N/A"]


@dataclass(frozen=True, kw_only=True)
class _Layout:
    """How a text table is written.

    Attributes
    ----------
    names, units : tuple of str
    header, first : int
        Line of the header and of the first row of data, counted from 0 in the file.
    delimiter, decimal : str
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    header: int
    first: int
    delimiter: str
    decimal: str


def read_csv(path: Path, request: TableRequest) -> FileTable:
    """Read columns of a text table; see `estimation.files.read_table.read_table`."""
    name = path.name
    raw = _content(path)
    sample, log = _decode(name, raw[:SAMPLE], len(raw) > SAMPLE)
    layout = _layout(name, sample.split("\n"), request)
    request = present_columns(request, layout.names)
    if layout.decimal == ",":
        log.append("decimal commas")
    if layout.first > layout.header + 1:
        log.append(f"units from line {layout.header + 2}")
    units = {n: u for n, u in zip(layout.names, layout.units, strict=False) if u}
    if not request.every:
        return FileTable(path=path, names=layout.names, numbers={}, labels={}, rows=Rows(np.zeros(0)), units=units)
    faults = column_faults(name, request.every, layout.names)
    if not faults and len(set(layout.names)) == len(layout.names) and "read as UTF-16" not in log:
        arrays = _fast(name, raw, layout, request)
        if arrays is not None:
            rows = Rows(np.arange(layout.first + 1, layout.first + 1 + len(arrays[request.every[0]])), "line")
            return table_from_arrays(path, layout.names, request, lambda c: arrays[c], rows=rows, log=log, units=units)
    check_size(name, len(raw), len(raw), text=True)
    text, _ = _decode(name, bytes(raw), False)
    return _by_lines(path, text, layout, request, faults, log, units)


def _content(path: Path) -> Any:
    """Return the bytes of a file, decompressed; those of a plain file stay on the disk until they are read."""
    name = path.name
    with path.open("rb") as stream:
        raw = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
    if raw[:2] == _GZIP:
        return unpacked_gzip(path, bytes(raw))
    if name.lower().endswith(".gz"):
        raise RecordError([f"{name}: is not a gzip file although its name says so: rename it to '{name[:-3]}'"])
    return raw


def _decode(name: str, raw: bytes, cut: bool) -> tuple[str, list[str]]:
    """Return text with ``\\n`` at the ends of lines; ``cut`` where it is only the beginning of a file."""
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        try:
            text, log = raw[: len(raw) // 2 * 2].decode("utf-16"), ["read as UTF-16"]
        except UnicodeDecodeError as error:
            raise RecordError([f"{name}: is not readable as UTF-16 text: save it as UTF-8"]) from error
    elif b"\x00" in raw[:SAMPLE]:
        raise RecordError([f"{name}: holds binary data and not text: export it as CSV"])
    else:
        try:
            text, log = raw.decode("utf-8-sig"), []
        except UnicodeDecodeError as error:
            if cut and error.start > len(raw) - 4:  # a letter of several bytes at the end of the sample
                text, log = raw[: error.start].decode("utf-8-sig"), []
            else:
                text, log = raw.decode("cp1252", errors="replace"), ["not UTF-8: read as Windows-1252"]
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    if cut:
        text = text[: text.rfind("\n") + 1] or text
    return text, log


def _kept(lines: Sequence[str]) -> list[int]:
    """Return the places of lines that are neither empty nor comments."""
    return [place for place, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")]


def _layout(name: str, lines: Sequence[str], request: TableRequest) -> _Layout:
    kept = [place for place in _kept(lines) if place >= request.skip_rows]
    if not kept:
        above = f" below the {request.skip_rows} lines that skip_rows leaves out" if request.skip_rows else ""
        raise RecordError([f"{name}: the file is empty{above}: export the recording again"])
    if re.fullmatch(r"sep=.", lines[kept[0]].strip()):
        kept = kept[1:]
    top = [lines[place] for place in kept]
    middle = len(top) // 2
    best: tuple[str, Header] | None = None
    by_header, by_data = _delimiter(top[0], top[1:2]), _delimiter(top[middle], top[middle + 1 : middle + 2])
    for delimiter in dict.fromkeys((by_header, by_data)):
        cells = [_split(line, delimiter) for line in top[:200]]
        header = find_header(cells) if len(cells[middle if middle < 200 else -1]) > 1 else Header(0, 1)
        if best is None or (best[1] == Header(0, 1) and header.row > 0):
            best = delimiter, header
    assert best is not None
    delimiter, header = best
    names = tuple(cell.strip() for cell in _split(top[header.row], delimiter))
    if all(NUMBER.fullmatch(cell.replace(",", ".")) for cell in names):
        skipped = f", or lower skip_rows in [records], which is {request.skip_rows}" if request.skip_rows else ""
        raise RecordError(
            [f"{name}, line {kept[header.row] + 1}: no header, the first line holds numbers: add column names{skipped}"]
        )
    decimal = "." if delimiter == "," else _decimal(top[header.first :], delimiter)
    first = kept[header.first] if header.first < len(kept) else len(lines)
    return _Layout(
        names=names, units=header.units, header=kept[header.row], first=first, delimiter=delimiter, decimal=decimal
    )


def _fast(name: str, raw: Any, layout: _Layout, request: TableRequest) -> dict[str, np.ndarray] | None:
    """Parse a regular file; None where it is not regular."""
    import pyarrow as pa
    import pyarrow.csv as pc

    body = _offset(raw, layout.first)
    if body >= len(raw) or b"\r" in raw[:SAMPLE].replace(b"\r\n", b""):
        return None
    end = len(raw)
    while end > body and raw[end - 1 : end] in (b"\n", b"\r"):
        end -= 1
    if raw.find(b"\n\n", body, end) >= 0 or raw.find(b"\n\r\n", body, end) >= 0:
        return None  # lines without anything are no rows, and the lines below them keep their numbers
    line = raw[body : body + SAMPLE].split(b"\n", 1)[0].decode("latin-1")
    cells = dict(zip(layout.names, _split(line.strip(), layout.delimiter), strict=False))
    texts = {*request.labels, *(c for c in request.columns if cells.get(c, "").strip() and not is_number(cells[c]))}
    kinds: dict[str, Any] = {c: pa.string() if c in texts else pa.float64() for c in request.every}
    # a cell takes at least a digit and a delimiter in the file, and 8 bytes as a number
    check_size(name, len(raw) * min(1.0, len(request.every) / len(layout.names)) * 4.0, len(raw))
    try:
        table = pc.read_csv(
            pa.BufferReader(pa.py_buffer(raw).slice(body, end - body)),
            read_options=pc.ReadOptions(column_names=list(layout.names), block_size=1 << 22),
            parse_options=pc.ParseOptions(delimiter=layout.delimiter, ignore_empty_lines=False),
            convert_options=pc.ConvertOptions(
                include_columns=list(request.every),
                column_types=kinds,
                null_values=_EMPTY,
                decimal_point=layout.decimal,
                strings_can_be_null=True,
                quoted_strings_can_be_null=True,
            ),
        )
    except (pa.ArrowException, ValueError):
        return None
    arrays = {}
    for c in request.every:
        column = table.column(c)
        if c in texts:
            arrays[c] = np.array(["" if cell is None else cell.strip() for cell in column.to_pylist()])
        else:
            arrays[c] = column.to_numpy()
    return arrays


def _offset(raw: Any, line: int) -> int:
    """Return where a line begins."""
    place = 0
    for _ in range(line):
        place = raw.find(b"\n", place) + 1
        if place == 0:
            return len(raw)
    return place


def _by_lines(
    path: Path,
    text: str,
    layout: _Layout,
    request: TableRequest,
    faults: list[str],
    log: list[str],
    units: dict[str, str],
) -> FileTable:
    """Read a table line by line, and name the lines at fault."""
    name, names, delimiter = path.name, layout.names, layout.delimiter
    lines = text.split("\n")
    body_at = [place for place in _kept(lines) if place >= layout.first]
    body = [lines[place] for place in body_at]
    if faults and (len(names) == 1 or names[0].lower() == "sep="):
        faults.append(
            f"{name}, line {layout.header + 1}: '{lines[layout.header][:40]}' does not look like a header: "
            "separate columns by comma, semicolon or tab, and leave out the lines above the header with skip_rows = … "
            "in [records] or by a # before each"
        )
        raise RecordError(faults)
    rows = Rows(np.array(body_at, dtype=np.int64) + 1, "line")
    if not body:
        faults.append(f"{name}: there is a header but no data below it: export the recording again")
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
    if decimal == "," and "decimal commas" not in log:
        log = [*log, "decimal commas"]
    columns = list(zip(*(_split(line, delimiter) for line in body), strict=True))
    cells = {c: np.array(columns[names.index(c)], dtype=object) for c in request.every}
    return table_from_arrays(path, names, request, lambda c: cells[c], rows=rows, decimal=decimal, log=log, units=units)


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
