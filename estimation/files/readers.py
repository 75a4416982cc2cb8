"""Reading the columns of CSV, Parquet and MATLAB files; :mod:`estimation.files.reading` settles what they mean."""

from __future__ import annotations

import csv
import gzip
import re
import zlib
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from estimation.files.checks import RecordError, Rows
from estimation.files.columns import nearest
from estimation.files.matlab import load_arrays

__all__ = ["FORMATS", "Table", "read_table"]

FORMATS = (".csv", ".csv.gz", ".parquet", ".mat")
"""Endings of files that can be read."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?inf(inity)?", re.IGNORECASE)
_MISSING = {"", "nan", "na", "n/a", "null", "none", "-nan", "+nan", "#n/a"}
_GZIP = b"\x1f\x8b"


@dataclass(frozen=True)
class Table:
    """Some columns of a file as they stand there.

    Attributes
    ----------
    path : Path
    names : tuple of str
        Every column of the file, in its order.
    numbers : dict of str to ndarray, shape (n,)
        The asked columns as floating-point numbers; NaN where a cell is empty.
    labels : dict of str to ndarray of str, shape (n,)
        The asked label columns as text.
    rows : Rows
        Where each sample stands in the file.
    log : tuple of str
        What was noticed or done on the way.
    """

    path: Path
    names: tuple[str, ...]
    numbers: dict[str, np.ndarray]
    labels: dict[str, np.ndarray]
    rows: Rows
    log: tuple[str, ...] = field(default=())


def read_table(
    path: str | Path, columns: Sequence[str], labels: Sequence[str] = (), optional: Collection[str] = ()
) -> Table:
    """Read the asked columns of a file.

    Parameters
    ----------
    path : str or Path
        A ``.csv``, ``.csv.gz``, ``.parquet`` or ``.mat`` file.
    columns : sequence of str
        Columns that hold numbers.
    labels : sequence of str
        Columns that hold labels (trips, segments): numbers or text.
    optional : collection of str
        Columns that the file need not have; those it lacks are left out of ``numbers``.

    Raises
    ------
    RecordError
        If the file cannot be read or lacks a column, or a cell holds text.
    """
    path = Path(path)
    name = path.name
    if not path.exists():
        beside = sorted(each.name for each in path.parent.iterdir()) if path.parent.is_dir() else []
        where = nearest(name, beside) if beside else "; its folder does not exist or is empty"
        raise RecordError([f"{path}: there is no such file{where}"])
    if path.is_dir():
        raise RecordError([f"{path}: is a folder: name the files in it, such as '{name}/*.csv'"])
    lowered = name.lower()
    reader = next(
        (each for ending, each in _READERS.items() if lowered.endswith(ending)),
        None,
    )
    if reader is None:
        raise RecordError([f"{name}: unknown kind of file: save it as one of {', '.join(FORMATS)}"])
    try:
        if path.stat().st_size == 0:
            raise RecordError([f"{name}: the file is empty"])
        return reader(path, list(dict.fromkeys(columns)), list(dict.fromkeys(labels)), optional)
    except OSError as error:
        raise RecordError([f"{name}: cannot be read: {error.strerror or error}"]) from error


def _present(columns: Sequence[str], names: Collection[str], optional: Collection[str]) -> list[str]:
    return [each for each in columns if each in names or each not in optional]


def _missing_columns(
    name: str, wanted: Sequence[str], names: Sequence[str], what: str = "column"
) -> list[str]:
    counts = Counter(names)
    faults = [
        f"{name}: there is no {what} '{each}'{nearest(each, names)}" for each in wanted if each not in counts
    ]
    faults += [
        f"{name}: {counts[each]} {what}s are called '{each}': give each its own name"
        for each in wanted
        if counts[each] > 1
    ]
    return faults


def _notes_on_names(names: Sequence[str], wanted: Sequence[str]) -> list[str]:
    twice = [each for each, count in Counter(names).items() if count > 1 and each and each not in wanted]
    return [f"warning: columns with the same name, not used here: {', '.join(twice)}"] if twice else []


def _cells_to_numbers(
    name: str, column: str, cells: Sequence[str], rows: Rows, decimal: str
) -> tuple[np.ndarray, list[str]]:
    """Numbers from text cell by cell; every cell that is not a number is a fault with its line."""
    values = np.full(len(cells), np.nan)
    wrong = np.zeros(len(cells), dtype=bool)
    for place, cell in enumerate(cells):
        text = cell.strip()
        dotted = text.replace(",", ".") if decimal == "," and "." not in text else text
        if _NUMBER.fullmatch(dotted) and not (decimal == "," and "." in text):
            values[place] = float(dotted)
        elif text.lower() not in _MISSING:
            wrong[place] = True
    if not wrong.any():
        return values, []
    sample = cells[int(np.flatnonzero(wrong)[0])].strip()[:30]
    remedy = "write numbers only, and leave a cell empty where there is no value"
    if decimal == "," and _NUMBER.fullmatch(sample):
        remedy = "the file uses decimal commas elsewhere: use one of the two throughout"
    elif re.fullmatch(r"\d[\d.,]*", sample):
        remedy = "write numbers without thousands separators"
    elif re.match(r"\d{1,4}[-/.:]\d{1,2}[-/.:T ]", sample):
        remedy = "give time as a number, in seconds since the start"
    elif wrong[0] and not wrong[1:].any():
        remedy = f"if it is a unit, write it into the header, such as '{column} [{sample}]'"
    return values, [f"{name}, column '{column}', {rows.say(wrong)}: '{sample}' is not a number: {remedy}"]


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


def _read_csv(path: Path, columns: list[str], labels: list[str], optional: Collection[str]) -> Table:
    name = path.name
    raw = path.read_bytes()
    if raw.startswith(_GZIP):
        try:
            raw = gzip.decompress(raw)
        except (EOFError, gzip.BadGzipFile, zlib.error) as error:
            raise RecordError(
                [f"{name}: the compressed file is damaged or cut off ({error}): copy it again"]
            ) from error
    elif name.lower().endswith(".gz"):
        raise RecordError(
            [f"{name}: is not a gzip file although its name says so: rename it to '{name[:-3]}'"]
        )
    text, log = _decode(name, raw)
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    kept = [place for place, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")]
    if not kept:
        raise RecordError([f"{name}: the file is empty"])
    header, body_at = lines[kept[0]], kept[1:]
    body = [lines[place] for place in body_at]
    delimiter = _delimiter(header, body[:1])
    names = [each.strip() for each in _split(header, delimiter)]
    if all(_NUMBER.fullmatch(each.replace(",", ".")) for each in names):
        raise RecordError(
            [f"{name}, line {kept[0] + 1}: no header, the first line holds numbers: add column names"]
        )
    columns = _present(columns, names, optional)
    faults = _missing_columns(name, [*columns, *labels], names)
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
            f"{name}, {rows.say(wrong)}: {widths[place]} cells where the header has {len(names)} columns: "
            f"{remedy}"
        )
    if faults:
        raise RecordError(faults)
    decimal = "." if delimiter == "," else _decimal(body, delimiter)
    if decimal == ",":
        log.append("decimal commas")
    log += _notes_on_names(names, [*columns, *labels])
    numbers, label_cells, faults = _parse(name, names, columns, labels, body, delimiter, decimal, rows)
    if faults:
        raise RecordError(faults)
    return Table(path, tuple(names), numbers, label_cells, rows, tuple(log))


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
    pattern = re.compile(
        rf"(?:^|{re.escape(delimiter)})\s*\"?[+-]?\d*,\d+(?:[eE][+-]?\d+)?\"?\s*(?:$|{delimiter})"
    )
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
            numbers[column], wrong = _cells_to_numbers(
                name, column, [row[place] for row in cells], rows, decimal
            )
            faults += wrong
    label_cells = {each: np.array([row[names.index(each)].strip() for row in cells]) for each in labels}
    return numbers, label_cells, faults


def _as_numbers(
    name: str, column: str, values: np.ndarray, rows: Rows, log: list[str]
) -> tuple[np.ndarray, list[str]]:
    """Numbers from an array of any type; text and complex numbers are refused."""
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
        return _cells_to_numbers(
            name, column, ["" if each is None else str(each) for each in values], rows, "."
        )
    return np.zeros(len(values)), [f"{name}, column '{column}': holds {values.dtype} and not real numbers"]


def _read_parquet(path: Path, columns: list[str], labels: list[str], optional: Collection[str]) -> Table:
    import pyarrow as pa
    import pyarrow.parquet as pq

    name = path.name
    try:
        file = pq.ParquetFile(path)
        names = list(file.schema_arrow.names)
        columns = _present(columns, names, optional)
        if faults := _missing_columns(name, [*columns, *labels], names):
            raise RecordError(faults)
        table = file.read(columns=[*columns, *labels])
    except (pa.ArrowException, OSError) as error:
        raise RecordError(
            [f"{name}: is not a readable Parquet file ({str(error).splitlines()[0]})"]
        ) from error
    if table.num_rows == 0:
        raise RecordError([f"{name}: there are columns but no rows"])
    return _from_arrays(path, names, columns, labels, lambda each: table[each].to_numpy())


def _from_arrays(path: Path, names: list[str], columns: list[str], labels: list[str], get: Any) -> Table:
    arrays = {each: np.asarray(get(each)) for each in [*columns, *labels]}
    count = len(next(iter(arrays.values()))) if arrays else 0
    rows = Rows(np.arange(1, count + 1))
    log: list[str] = _notes_on_names(names, [*columns, *labels])
    faults: list[str] = []
    numbers = {}
    for column in columns:
        numbers[column], wrong = _as_numbers(path.name, column, arrays[column], rows, log)
        faults += wrong
    if faults:
        raise RecordError(faults)
    texts = {each: np.array([_label(value) for value in arrays[each].tolist()]) for each in labels}
    return Table(path, tuple(names), numbers, texts, rows, tuple(log))


def _label(value: Any) -> str:
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def _read_mat(path: Path, columns: list[str], labels: list[str], optional: Collection[str]) -> Table:
    name = path.name
    found = load_arrays(path)
    vectors = {key: value for key, value in found.items() if value.ndim == 1 and value.size > 1}
    columns = _present(columns, found, optional)
    wanted = [*columns, *labels]
    faults = [
        f"{name}: '{each}' has the shape {found[each].shape} and is not a column of samples"
        for each in wanted
        if each in found and each not in vectors
    ]
    faults += _missing_columns(
        name, [each for each in wanted if each not in found], list(vectors), "variable"
    )
    lengths = {each: len(vectors[each]) for each in wanted if each in vectors}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"'{each}' {length}" for each, length in lengths.items())
        faults.append(
            f"{name}: the variables have different numbers of samples: {told}: export them on one time base"
        )
    if faults:
        raise RecordError(faults)
    return _from_arrays(path, list(vectors), columns, labels, lambda each: vectors[each])


_READERS = {".csv": _read_csv, ".csv.gz": _read_csv, ".parquet": _read_parquet, ".mat": _read_mat}
