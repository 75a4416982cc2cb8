"""Where the header of a text table stands: below a preamble, above a row of units, above the first row of numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from estimation.files.column_names import is_unit

__all__ = ["Header", "find_header", "is_date", "is_number"]

_NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?|[+-]?inf(inity)?|[+-]?nan", re.IGNORECASE)
_DATE = re.compile(r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}([T ]\s*\d{1,2}:\d{2}.*)?|\d{1,3}:\d{2}(:\d{2}([.,]\d+)?)?")
#: Rows of numbers that must follow a header that stands below a preamble; chosen: a preamble with as many lines
#: ``name, number`` in a row, and as many cells as the table, is rare.
FOLLOWING = 5


def is_number(cell: str) -> bool:
    """Return whether a cell holds a number, with decimal point or comma.

    Examples
    --------
    >>> is_number("-1.5e3"), is_number("2,5"), is_number("n.v.")
    (True, True, False)
    """
    return bool(_NUMBER.fullmatch(cell.strip()))


def is_date(cell: str) -> bool:
    """Return whether a cell holds a date, a time of day or both.

    Examples
    --------
    >>> is_date("2024-03-01T10:00:00.5Z"), is_date("01.03.2024 10:00"), is_date("10:00:00.25"), is_date("1.5")
    (True, True, True, False)
    """
    return bool(_DATE.fullmatch(cell.strip()))


@dataclass(frozen=True)
class Header:
    """The header of a table.

    Attributes
    ----------
    row : int
        Place of the names among the rows that were looked at.
    first : int
        Place of the first row of data.
    units : tuple of str
        One for each name, empty where there is none; no entries where there is no row of units.
    """

    row: int
    first: int
    units: tuple[str, ...] = ()


def find_header(rows: Sequence[Sequence[str]]) -> Header:
    """Find the header among the first rows of a table.

    A header has text in its cells, as many cells as the data below it, and is followed by rows of numbers, perhaps with
    a row of units between.  Where no row is like that the first one is the header.

    Parameters
    ----------
    rows : sequence of sequence of str
        The cells of the first rows, empty rows and comments left out.

    Examples
    --------
    >>> find_header([["Rig 3"], ["t", "F"], ["s", "N"], ["0.0", "1.5"], ["0.1", "1.6"]])
    Header(row=1, first=3, units=('s', 'N'))

    A number that is damaged does not make a unit of its row.

    >>> find_header([["t", "F"], ["0.0", "12:30:00"], ["0.1", "1.6"], ["0.2", "1.7"]])
    Header(row=0, first=1, units=())
    """
    for place in range(len(rows) - 1):
        names = rows[place]
        if not _is_text(names):
            continue
        for first in (place + 2, place + 1):
            if _starts_data(rows, first, len(names)):
                units = rows[place + 1] if first == place + 2 else []
                if first == place + 1 or (len(units) == len(names) and _are_units(units)):
                    return Header(place, first, tuple(unit_text(u) for u in units))
    return Header(0, 1)


def unit_text(cell: str) -> str:
    """Return a unit without its brackets; ``-`` and an empty cell are no unit.

    Examples
    --------
    >>> unit_text("[m/s]"), unit_text("(N)"), unit_text("-")
    ('m/s', 'N', '')
    """
    text = cell.strip().strip("[]()").strip()
    return "" if text in ("-", "–") else text


def _is_text(cells: Sequence[str]) -> bool:
    filled = [cell for cell in cells if cell.strip()]
    return bool(filled) and not any(is_number(cell) or is_date(cell) for cell in filled)


def _are_units(cells: Sequence[str]) -> bool:
    if any(is_number(cell) or is_date(cell) for cell in cells):
        return False
    texts = [unit_text(cell) for cell in cells]
    return any(texts) and all(not text or is_unit(text) for text in texts)


def _starts_data(rows: Sequence[Sequence[str]], first: int, width: int) -> bool:
    below = rows[first : first + FOLLOWING]
    return bool(below) and all(len(row) == width and _is_data(row) for row in below)


def _is_data(cells: Sequence[str]) -> bool:
    filled = [cell for cell in cells if cell.strip()]
    numbers = sum(is_number(cell) or is_date(cell) for cell in filled)
    return bool(filled) and 2 * numbers >= len(filled)
