"""How much memory may be used, and large arrays that are kept in a file where they would take more than that."""

from __future__ import annotations

import ctypes
import errno
import os
import tempfile
import threading
import weakref
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from multibody.base.memory_of_process import machine_memory

__all__ = ["ArrayStore", "MemoryLimitError", "give_back", "memory_limit", "scratch_folder"]

#: Share of the machine's memory that may be used where nothing is said: others work on it too.
SHARE = 0.5
#: Share of the limit that kept arrays may take; the rest is for what is worked on, and for the program itself.
KEPT = 0.5
#: Reentrant: the garbage collector may free a store in any thread, also in one that holds the lock.
_lock = threading.RLock()
_held = 0  # bytes of all stores that are in memory


class MemoryLimitError(ValueError):
    """A limit of memory that is no number of gigabytes."""


def memory_limit() -> float:
    """Return how many bytes may be used: ``VTSDT_MEMORY`` in GB (10⁹ bytes), else half of what the machine has.

    Raises
    ------
    MemoryLimitError
        If the environment variable is no positive number.
    """
    said = os.environ.get("VTSDT_MEMORY", "").strip()
    if not said:
        return SHARE * machine_memory()
    try:
        limit = 1e9 * float(said)
    except ValueError:
        limit = np.nan
    if not 0.0 < limit < np.inf:
        raise MemoryLimitError(f"VTSDT_MEMORY is '{said}': give the limit in gigabytes, such as VTSDT_MEMORY=4")
    return limit


def scratch_folder() -> Path:
    """Return where arrays go that are too large to be held: ``VTSDT_SCRATCH``, else a folder that is on a disk.

    The usual folder for temporary files is often in memory itself.
    """
    said = os.environ.get("VTSDT_SCRATCH")
    if said:
        return Path(said).expanduser()
    lasting = Path("/var/tmp")
    return lasting if os.access(lasting, os.W_OK) else Path(tempfile.gettempdir())


def give_back() -> None:
    """Give memory that was freed back to the system, where the C library keeps it (glibc).

    It keeps arrays of up to 32 MB, in the hope that they are asked for again.  A search frees them among arrays that
    stay, and takes others elsewhere.
    """
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


class ArrayStore:
    """Arrays that are put in once and taken out many times, with the same bits and in row order.

    They are held in memory until all stores together hold `KEPT` of `memory_limit`; those that come later go into a
    file that has no name, so that it vanishes with the process, however that ends.  What is held goes with the store.

    Examples
    --------
    >>> store = ArrayStore()
    >>> k = store.put(np.arange(3.0))
    >>> store.get(k)
    array([0., 1., 2.])
    """

    def __init__(self) -> None:
        self._own = _Own()
        self._places: list[np.ndarray | tuple[int, tuple[int, ...], np.dtype[Any]]] = []
        self._lock = threading.Lock()
        self._latest: tuple[int, np.ndarray] | None = None  # what follows is often in the same array
        weakref.finalize(self, self._own.free)

    def put(self, array: np.ndarray) -> int:
        """Keep an array and return its number.

        Raises
        ------
        OSError
            If it has to go into the file and cannot.
        """
        whole = np.ascontiguousarray(array)
        with self._lock:
            if self._own.hold(whole.nbytes):
                # a view would keep all that it is a view of
                self._places.append(whole.copy() if whole.base is not None else whole)
            else:
                self._places.append((self._own.write(whole), whole.shape, whole.dtype))
            return len(self._places) - 1

    def get(self, number: int) -> np.ndarray:
        """Return an array; it must not be changed."""
        place = self._places[number]
        if isinstance(place, np.ndarray):
            return place
        latest = self._latest
        if latest is not None and latest[0] == number:
            return latest[1]
        at, shape, dtype = place
        out = np.empty(shape, dtype)
        with self._lock:
            self._own.read(at, out)
            self._latest = number, out
        return out

    @property
    def nbytes_in_file(self) -> int:
        """Bytes that did not fit into memory."""
        return self._own.end


class _Own:
    """What one store holds in memory, and its file."""

    def __init__(self) -> None:
        self.held, self.end = 0, 0
        self.file: BinaryIO | None = None

    def hold(self, size: int) -> bool:
        global _held
        most = KEPT * memory_limit()
        with _lock:
            if _held + size > most:
                return False
            _held += size
            self.held += size
            return True

    def write(self, array: np.ndarray) -> int:
        at, folder = self.end, scratch_folder()
        try:
            if self.file is None:
                self.file = tempfile.TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115 - closed by `free`
            self.file.seek(at)
            left = array.reshape(-1).view(np.uint8).data
            while len(left):
                left = left[self.file.write(left) :]
        except OSError as error:
            why = "the disk is full" if error.errno in (errno.ENOSPC, errno.EDQUOT) else error.strerror or str(error)
            raise OSError(
                f"{folder}: {array.nbytes / 1e6:.3g} MB more of sensitivities cannot be put there ({why}), and memory "
                f"is limited to {memory_limit() / 1e9:.3g} GB: free some space, name a folder on another disk by "
                "VTSDT_SCRATCH, raise the limit with --memory, or look for fewer effects ([candidates] include)"
            ) from error
        self.end = at + array.nbytes
        return at

    def read(self, at: int, out: np.ndarray) -> None:
        assert self.file is not None
        self.file.seek(at)
        left = out.reshape(-1).view(np.uint8).data
        while len(left):
            count = self.file.readinto(left)  # type: ignore[attr-defined]
            if not count:
                raise OSError(f"{scratch_folder()}: the file of sensitivities there ended early: run it again")
            left = left[count:]

    def free(self) -> None:
        global _held
        with _lock:
            _held -= self.held
            self.held = 0
        if self.file is not None:
            self.file.close()
            self.file = None
