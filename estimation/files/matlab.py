"""The arrays of a MATLAB file, whichever version wrote it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from estimation.files.checks import RecordError

__all__ = ["load_arrays"]


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
        content = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=True)
    except Exception as error:  # the reader raises many kinds on damaged files
        raise RecordError([f"{path.name}: is not a readable MATLAB file ({error})"]) from error
    found: dict[str, np.ndarray] = {}
    for key, value in content.items():
        if not key.startswith("__"):
            _flatten(key, value, found)
    return found


def _flatten(key: str, value: Any, found: dict[str, np.ndarray]) -> None:
    array = np.asarray(value)
    if array.dtype.names:
        if array.ndim == 0:
            for part in array.dtype.names:
                inner = array[part].item() if array[part].dtype == object else array[part]
                _flatten(f"{key}.{part}", inner, found)
        return
    found[key] = array.squeeze()


def _load_73(path: Path) -> dict[str, np.ndarray]:
    try:
        import h5py
    except ImportError as error:
        raise RecordError(
            [f"{path.name}: is a MATLAB 7.3 (HDF5) file: save it with save(…, '-v7'), or install h5py"]
        ) from error
    found: dict[str, np.ndarray] = {}

    def visit(key: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset) and not key.startswith("#"):
            found[key.replace("/", ".")] = np.asarray(node[()]).squeeze()

    try:
        with h5py.File(path, "r") as file:
            file.visititems(visit)
    except OSError as error:
        raise RecordError([f"{path.name}: is not a readable MATLAB 7.3 file ({error})"]) from error
    return found
