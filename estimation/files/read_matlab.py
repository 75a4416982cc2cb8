"""The columns of a MATLAB file of any version."""

from __future__ import annotations

import math
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from estimation.files.bounded import check_size
from estimation.files.faults import RecordError
from estimation.files.table import FileTable, column_faults, present_columns, table_from_arrays

__all__ = ["read_matlab"]


def read_matlab(path: Path, columns: list[str], labels: list[str], optional: Collection[str]) -> FileTable:
    """Read columns of a MATLAB file; see `estimation.files.read_table.read_table`."""
    name = path.name
    arrays = load_arrays(path)
    vectors = {key: value for key, value in arrays.items() if value.ndim == 1 and value.size > 1}
    columns = present_columns(columns, arrays, optional)
    wanted = [*columns, *labels]
    faults = [
        f"{name}: '{key}' has the shape {arrays[key].shape} and is not a column of samples"
        for key in wanted
        if key in arrays and key not in vectors
    ]
    faults += column_faults(name, [key for key in wanted if key not in arrays], list(vectors), "variable")
    lengths = {key: len(vectors[key]) for key in wanted if key in vectors}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"'{key}' {length}" for key, length in lengths.items())
        faults.append(
            f"{name}: the variables have different numbers of samples: {listed}: export them on one time base"
        )
    if faults:
        raise RecordError(faults)
    return table_from_arrays(path, list(vectors), columns, labels, lambda key: vectors[key])


def load_arrays(path: Path) -> dict[str, np.ndarray]:
    """Read every array of a MATLAB file; fields of a structure are called ``data.force``.

    Parameters
    ----------
    path : Path
        A ``.mat`` file up to version 7; version 7.3 needs h5py.

    Raises
    ------
    RecordError
        If the file cannot be read.
    """
    with path.open("rb") as stream:
        head = stream.read(520)
    if head.startswith((b"MATLAB 7.3", b"\x89HDF")) or head[512:].startswith(b"\x89HDF"):
        return _load_73(path)
    import scipy.io

    try:
        sizes = [8.0 * math.prod(shape) for _, shape, _ in scipy.io.whosmat(path)]
        check_size(path.name, sum(sizes), path.stat().st_size)
        content = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=True)
    except RecordError:
        raise
    except Exception as error:  # the reader raises many kinds on damaged files
        raise RecordError([f"{path.name}: is not a readable MATLAB file ({error})"]) from error
    arrays: dict[str, np.ndarray] = {}
    for key, value in content.items():
        if not key.startswith("__"):
            _flatten(key, value, arrays)
    return arrays


def _flatten(key: str, value: Any, arrays: dict[str, np.ndarray]) -> None:
    array = np.asarray(value)
    if array.dtype.names:
        if array.ndim == 0:
            for part in array.dtype.names:
                inner = array[part].item() if array[part].dtype == object else array[part]
                _flatten(f"{key}.{part}", inner, arrays)
        return
    arrays[key] = array.squeeze()


def _load_73(path: Path) -> dict[str, np.ndarray]:
    try:
        import h5py
    except ImportError as error:
        raise RecordError(
            [f"{path.name}: is a MATLAB 7.3 (HDF5) file: save it with save(…, '-v7'), or install h5py"]
        ) from error
    arrays: dict[str, np.ndarray] = {}
    sizes: list[float] = []

    def visit(key: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset) and not key.startswith("#"):
            sizes.append(float(node.nbytes))
            check_size(path.name, sum(sizes), path.stat().st_size)
            arrays[key.replace("/", ".")] = np.asarray(node[()]).squeeze()

    try:
        with h5py.File(path, "r") as file:
            file.visititems(visit)
    except OSError as error:
        raise RecordError([f"{path.name}: is not a readable MATLAB 7.3 file ({error})"]) from error
    return arrays
