"""The columns of a MATLAB file of any version."""

from __future__ import annotations

import math
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from estimation.files.bounded import check_size
from estimation.files.faults import RecordError
from estimation.files.nested import add_array, table_from_groups
from estimation.files.optional_library import library
from estimation.files.table import FileTable, TableRequest

__all__ = ["read_matlab"]

_COMPRESSED = 15  # type of a packed element in the MAT-file format, level 5


def read_matlab(path: Path, request: TableRequest) -> FileTable:
    """Read columns of a MATLAB file; see `estimation.files.read_table.read_table`.

    Fields of a structure and variables of a table are called ``data.force``.
    """
    arrays: dict[str, np.ndarray] = {}
    for key, value in _content(path).items():
        if not key.startswith("__"):
            _flatten(key, value, arrays)
    return table_from_groups(path, arrays, request, ".", "variable")


def _content(path: Path) -> dict[str, Any]:
    with path.open("rb") as stream:
        head = stream.read(520)
    hdf = head.startswith((b"MATLAB 7.3", b"\x89HDF")) or head[512:].startswith(b"\x89HDF")
    if not hdf:
        import scipy.io

        try:
            check_size(path.name, _size(path), path.stat().st_size)
            content = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=True)
        except RecordError:
            raise
        except Exception as error:  # the reader raises many kinds on damaged files
            raise RecordError([f"{path.name}: is not a readable MATLAB file ({error}): export it again"]) from error
        if not any(_is_object(value) for value in content.values()):
            return dict(content)
    if hdf:
        _check_hdf(path)
    matio = library("matio", path, "a MATLAB 7.3 file, or one with tables", "matlab")
    try:
        content = matio.load_from_mat(str(path))
    except Exception as error:
        raise RecordError([f"{path.name}: is not a readable MATLAB 7.3 file ({error}): export it again"]) from error
    return dict(content)


def _size(path: Path) -> float:
    """Return how many bytes the variables of a file up to version 7 take."""
    import scipy.io

    try:
        return float(sum(8.0 * math.prod(shape) for _, shape, _ in scipy.io.whosmat(path)))
    except TypeError:  # tables and other objects state no shape: what the packed variables unpack to
        size, raw = 0, path.read_bytes()
        place = 128
        while place + 8 <= len(raw):
            kind, length = struct.unpack("<II" if raw[126:128] == b"IM" else ">II", raw[place : place + 8])
            part = raw[place + 8 : place + 8 + length]
            if kind == _COMPRESSED:
                stream = zlib.decompressobj()
                while part and not stream.eof:
                    size += len(stream.decompress(part, 1 << 20))
                    part = stream.unconsumed_tail
                    check_size(path.name, size, len(raw))
            place += 8 + length
        return float(size)


def _check_hdf(path: Path) -> None:
    """Refuse a file whose datasets would not fit in memory."""
    h5py = library("h5py", path, "a MATLAB 7.3 file", "matlab")
    sizes: list[float] = []

    def visit(_: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset):
            sizes.append(float(node.nbytes))
            check_size(path.name, sum(sizes), path.stat().st_size)

    try:
        with h5py.File(path, "r") as file:
            file.visititems(visit)
    except OSError as error:
        raise RecordError([f"{path.name}: is not a readable MATLAB 7.3 file ({error}): export it again"]) from error


def _is_object(value: Any) -> bool:
    """Return whether a variable is a table or another object of a class."""
    kind = getattr(value, "dtype", None)
    return type(value).__name__ == "MatlabOpaque" or bool(kind is not None and kind.names == ("s0", "s1", "s2", "arr"))


def _flatten(key: str, value: Any, arrays: dict[str, np.ndarray]) -> None:
    if hasattr(value, "columns") and hasattr(value, "index"):  # a table or a timetable, as a DataFrame
        for name in value.columns:
            _flatten(f"{key}.{name}", value[name].to_numpy(), arrays)
        if value.index.dtype.kind in "mM":
            arrays[f"{key}.{value.index.name or 'Time'}"] = value.index.to_numpy()
        return
    if isinstance(value, dict):
        for part, inner in value.items():
            _flatten(f"{key}.{part}", inner, arrays)
        return
    array = np.asarray(value)
    if array.dtype.names:
        array = array.squeeze()
        if array.ndim == 0:
            for part in array.dtype.names or ():
                inner = array[part].item() if array[part].dtype == object else array[part]
                _flatten(f"{key}.{part}", inner, arrays)
        return
    if array.dtype.kind in "biufmMcUS" or (array.dtype.kind == "O" and array.ndim == 1):
        add_array(arrays, key, array, ".")
