"""The columns of a measurement file, by the reader that its ending chooses."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

from estimation.files.faults import RecordError
from estimation.files.read_csv import read_csv
from estimation.files.read_matlab import read_matlab
from estimation.files.read_parquet import read_parquet
from estimation.files.table import FileTable
from multibody.base.spelling import nearest_or_choices

__all__ = ["READERS", "read_table"]

READERS = {".csv": read_csv, ".csv.gz": read_csv, ".parquet": read_parquet, ".mat": read_matlab}
"""Reader of each file ending."""


def read_table(
    path: str | Path, columns: Sequence[str], labels: Sequence[str] = (), optional: Collection[str] = ()
) -> FileTable:
    """Read columns of a file.

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
        siblings = sorted(entry.name for entry in path.parent.iterdir()) if path.parent.is_dir() else []
        hint = nearest_or_choices(name, siblings) if siblings else "; its folder does not exist or is empty"
        raise RecordError([f"{path}: there is no such file{hint}"])
    if path.is_dir():
        raise RecordError([f"{path}: is a folder: name the files in it, such as '{name}/*.csv'"])
    reader = next((reader for ending, reader in READERS.items() if name.lower().endswith(ending)), None)
    if reader is None:
        raise RecordError([f"{name}: unknown kind of file: save it as one of {', '.join(READERS)}"])
    try:
        if path.stat().st_size == 0:
            raise RecordError([f"{name}: the file is empty"])
        return reader(path, list(dict.fromkeys(columns)), list(dict.fromkeys(labels)), optional)
    except OSError as error:
        raise RecordError([f"{name}: cannot be read: {error.strerror or error}"]) from error
