"""The columns of a measurement file, by the reader that its ending chooses."""

from __future__ import annotations

from pathlib import Path

from estimation.files.faults import RecordError
from estimation.files.read_csv import read_csv
from estimation.files.read_excel import read_excel
from estimation.files.read_hdf5 import read_hdf5
from estimation.files.read_matlab import read_matlab
from estimation.files.read_mcap import read_bag, read_mcap
from estimation.files.read_mdf import read_mdf
from estimation.files.read_parquet import read_parquet
from estimation.files.read_tdms import read_tdms
from estimation.files.read_uff import read_uff
from estimation.files.table import FileTable, TableRequest
from multibody.base.missing_file import why_no_file

__all__ = ["OWN_TIMES", "READERS", "read_table"]

READERS = {
    ".csv": read_csv,
    ".csv.gz": read_csv,
    ".txt": read_csv,
    ".tsv": read_csv,
    ".parquet": read_parquet,
    ".mat": read_matlab,
    ".h5": read_hdf5,
    ".hdf5": read_hdf5,
    ".xlsx": read_excel,
    ".mf4": read_mdf,
    ".mdf": read_mdf,
    ".tdms": read_tdms,
    ".uff": read_uff,
    ".unv": read_uff,
    ".mcap": read_mcap,
    ".bag": read_bag,
}
"""Reader of each file ending."""

OWN_TIMES = (".mf4", ".mdf", ".tdms", ".uff", ".unv", ".mcap", ".bag")
"""Endings of files whose channels have times of their own: no time column need be named."""


def read_table(path: str | Path, request: TableRequest) -> FileTable:
    """Read columns of a file.

    Parameters
    ----------
    path : str or Path
        A file with one of the endings in `READERS`.
    request : TableRequest
        What is asked of it.

    Raises
    ------
    RecordError
        If the file cannot be read or lacks a column, or a cell holds text.
    """
    path = Path(path)
    name = path.name
    if why := why_no_file(path):
        raise RecordError([f"{path}: {why}"])
    reader = next((reader for ending, reader in READERS.items() if name.lower().endswith(ending)), None)
    if reader is None:
        raise RecordError([f"{name}: unknown kind of file: save it as one of {', '.join(READERS)}"])
    try:
        if path.stat().st_size == 0:
            raise RecordError([f"{name}: the file is empty: export the recording again"])
        return reader(path, request)
    except OSError as error:
        raise RecordError([f"{name}: cannot be read: {error.strerror or error}"]) from error
