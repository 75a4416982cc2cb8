"""The state of a running filter as a file: everything that the next sample needs, to the last bit."""

from __future__ import annotations

import io
import json
import os
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from estimation.filters.errors import FilterError
from multibody.base.json_file import naming

__all__ = ["OnlineState"]

#: Version of the file; a file of another version is refused.
VERSION = 1
_ARRAYS = ("state", "covariance", "inputs", "jacobian", "balance")
_SCALARS = ("time", "taken", "late", "refused", "log_likelihood")


@dataclass(frozen=True, eq=False, kw_only=True)
class OnlineState:
    """A running filter between two samples.

    Parameters
    ----------
    fingerprint : str
        Of model, parameters, noise and settings: a filter resumes only what it would have computed itself.
    names : tuple of str
        Of the states.
    time : float, s
        Of the last sample.
    taken : int
        Samples filtered so far.
    state : ndarray, shape (n,)
    covariance : ndarray, shape (n, ld)
        Or its square root, as the filter carries it.
    inputs : ndarray, shape (n_u,)
        At the last sample.
    jacobian : ndarray, shape (n ld,)
        Of the last sample, where the filter linearises once for each instant.
    balance : ndarray, shape (n,)
        Sizes that balance the Jacobian.
    log_likelihood : float
    late, refused : int
        Late readings that came too late, and readings that the gate kept out.
    """

    fingerprint: str
    names: tuple[str, ...]
    time: float
    taken: int
    state: np.ndarray
    covariance: np.ndarray
    inputs: np.ndarray
    jacobian: np.ndarray
    balance: np.ndarray
    log_likelihood: float = 0.0
    late: int = 0
    refused: int = 0

    def save(self, path: str | Path) -> Path:
        """Write the state in one move (``.npz`` without objects) and return the path.

        Neither a reader nor a power cut sees half of it: the draft is flushed to the disk before it takes the name.
        """
        path = Path(path)
        content: dict[str, Any] = {name: getattr(self, name) for name in (*_ARRAYS, *_SCALARS)}
        content["meta"] = np.array(
            json.dumps({"version": VERSION, "fingerprint": self.fingerprint, "names": list(self.names)})
        )
        packed = io.BytesIO()
        np.savez(packed, **content)
        with naming(path):
            handle, draft = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".tmp")
            try:
                with os.fdopen(handle, "wb") as stream:
                    stream.write(packed.getvalue())
                    stream.flush()
                    os.fsync(stream.fileno())
                os.replace(draft, path)
            finally:
                Path(draft).unlink(missing_ok=True)
        return path

    @classmethod
    def load(cls, path: str | Path) -> OnlineState:
        """Read a state.

        Raises
        ------
        FilterError
            If the file is none, or of another version.
        """
        path = Path(path)
        try:
            with np.load(path, allow_pickle=False) as content:
                meta = json.loads(str(content["meta"]))
                arrays: dict[str, Any] = {name: np.array(content[name], dtype=float) for name in _ARRAYS}
                scalars: dict[str, Any] = {name: content[name].item() for name in _SCALARS}
                names, fingerprint, version = tuple(meta["names"]), str(meta["fingerprint"]), meta["version"]
        except (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
            raise FilterError(
                str(path), [f"is no saved state of a filter ({error}): start the filter anew, or name another file"]
            ) from error
        if version != VERSION:
            raise FilterError(
                str(path), [f"was saved by version {version}, this is version {VERSION}: start the filter anew"]
            )
        values = {"time": scalars["time"], **{name: arrays[name] for name in ("state", "covariance", "inputs")}}
        if broken := [name for name, value in values.items() if not np.all(np.isfinite(value))]:
            raise FilterError(
                str(path), [f"has values that are not finite ({', '.join(broken)}): start the filter anew"]
            )
        return cls(fingerprint=fingerprint, names=names, **arrays, **scalars)
