"""The columns of an HDF5 file: datasets in groups."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from estimation.files.bounded import check_size
from estimation.files.faults import RecordError
from estimation.files.nested import add_array, table_from_groups
from estimation.files.optional_library import library
from estimation.files.table import FileTable, TableRequest

__all__ = ["read_hdf5"]

_UNIT_ATTRIBUTES = ("unit", "units", "Unit", "Units")


def read_hdf5(path: Path, request: TableRequest) -> FileTable:
    """Read columns of an HDF5 file; see `estimation.files.read_table.read_table`.

    A column is called by its path, ``motor/force``; the columns of a matrix ``motor/data[0]``, the fields of a table
    ``motor/table/force``.  Units come from an attribute ``unit`` or ``units``.
    """
    h5py = library("h5py", path, "an HDF5 file", "hdf5")
    arrays: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    sizes: list[float] = []

    def visit(key: str, node: Any) -> None:
        if not isinstance(node, h5py.Dataset) or node.dtype.kind == "O" or node.ndim > 2:
            return
        sizes.append(float(node.nbytes))
        check_size(path.name, sum(sizes), path.stat().st_size)
        add_array(arrays, key, np.asarray(node[()]), "/")
        unit = next((node.attrs[a] for a in _UNIT_ATTRIBUTES if a in node.attrs), None)
        if isinstance(unit, bytes):
            unit = unit.decode("utf-8", errors="replace")
        if isinstance(unit, str) and unit:
            units.update({name: unit for name in arrays if name == key or name.startswith(f"{key}[")})

    try:
        with h5py.File(path, "r") as file:
            file.visititems(visit)
    except OSError as error:
        raise RecordError([f"{path.name}: is not a readable HDF5 file ({error}): export it again"]) from error
    return table_from_groups(path, arrays, request, "/", "dataset", units)
