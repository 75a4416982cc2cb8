"""The columns of a worksheet."""

from __future__ import annotations

import datetime
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from estimation.files.bounded import check_size
from estimation.files.faults import RecordError, Rows
from estimation.files.header import find_header
from estimation.files.optional_library import library
from estimation.files.table import FileTable, TableRequest, column_faults, present_columns, table_from_arrays

__all__ = ["read_excel"]


def read_excel(path: Path, request: TableRequest) -> FileTable:
    """Read columns of the first worksheet that has data; see `estimation.files.read_table.read_table`."""
    openpyxl = library("openpyxl", path, "an Excel file", "excel")
    name = path.name
    try:
        with zipfile.ZipFile(path) as packed:
            check_size(name, sum(part.file_size for part in packed.infolist()), path.stat().st_size, text=True)
        book = openpyxl.load_workbook(path, read_only=True, data_only=True)
        sheets = {sheet.title: [list(row) for row in sheet.iter_rows(values_only=True)] for sheet in book.worksheets}
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
        raise RecordError([f"{name}: is not a readable Excel file ({error}): export it again"]) from error
    sheets = {title: rows for title, rows in sheets.items() if any(_filled(row) for row in rows)}
    if not sheets:
        raise RecordError([f"{name}: no worksheet holds data"])
    title, cells = next(iter(sheets.items()))
    places = [k for k, row in enumerate(cells) if k >= request.skip_rows and _filled(row)]
    if not places:
        raise RecordError([f"{name}: nothing stands below the {request.skip_rows} rows that skip_rows leaves out"])
    width = 1 + max(k for place in places for k, cell in enumerate(cells[place]) if cell is not None)
    table = [[*cells[place], *[None] * width][:width] for place in places]
    header = find_header([_trimmed([_text(cell) for cell in row], width) for row in table[:200]])
    names = tuple(_text(cell).strip() for cell in table[header.row])
    log = [f"worksheet '{title}'"] if len(sheets) > 1 else []
    units = {n: u for n, u in zip(names, header.units, strict=False) if u}
    request = present_columns(request, names)
    faults = column_faults(name, request.every, names)
    body = table[header.first :]
    if request.every and not body:
        faults.append(f"{name}: there is a header but no data below it: export the recording again")
    if faults:
        raise RecordError(faults)
    rows = Rows(np.array(places[header.first :], dtype=np.int64) + 1)
    columns = {c: _column([row[names.index(c)] for row in body]) for c in request.every}
    return table_from_arrays(
        path, tuple(n for n in names if n), request, lambda c: columns[c], rows=rows, log=log, units=units
    )


def _filled(row: list[Any]) -> bool:
    return any(cell is not None and str(cell).strip() for cell in row)


def _trimmed(cells: list[str], width: int) -> list[str]:
    """Leave out the empty cells at the end of a short row, as in a preamble."""
    while cells and not cells[-1].strip():
        cells = cells[:-1]
    return [*cells, *[""] * (width - len(cells))] if 2 * len(cells) > width else cells


def _text(cell: Any) -> str:
    return "" if cell is None else str(cell)


def _column(cells: list[Any]) -> np.ndarray:
    """Return cells as numbers or dates where all are, else as text."""
    if all(cell is None or (isinstance(cell, int | float) and not isinstance(cell, bool)) for cell in cells):
        return np.array([np.nan if cell is None else cell for cell in cells], dtype=float)
    if all(cell is None or isinstance(cell, datetime.datetime) for cell in cells):
        return np.array([np.datetime64("NaT") if cell is None else cell for cell in cells], dtype="datetime64[us]")
    return np.array([_text(cell) for cell in cells], dtype=object)
