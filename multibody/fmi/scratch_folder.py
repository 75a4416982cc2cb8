"""Temporary folders of units that go with their users, however these end."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Self

__all__ = ["ScratchFolder"]

_PREFIX = "vtsdt_unit_"


class ScratchFolder:
    """A temporary folder, locked as long as a process that has its descriptor lives.

    A process that is killed removes nothing.  What it leaves is removed when the next folder is made: its lock ended
    with it.  Windows has no lock on folders; nothing is removed there that others left.

    Examples
    --------
    >>> with ScratchFolder() as folder:
    ...     written = (folder.path / "model.h").write_text("/* nothing */")
    >>> folder.path.exists()
    False
    """

    def __init__(self) -> None:
        _remove_abandoned()
        # locked under another name, so that nobody takes it for an abandoned one before the lock is there
        new = Path(tempfile.mkdtemp(prefix=f"new_{_PREFIX}"))
        self.descriptor = _locked(new)
        self.path = new.rename(new.with_name(new.name.removeprefix("new_")))

    def remove(self) -> None:
        """Remove the folder; a second time does nothing."""
        shutil.rmtree(self.path, ignore_errors=True)
        if self.descriptor is not None:
            os.close(self.descriptor)
            self.descriptor = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.remove()


def _locked(folder: Path) -> int | None:
    """Return a descriptor that holds the folder's lock, None if another process holds it or there are no locks."""
    if sys.platform == "win32":
        return None
    import fcntl

    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except OSError:  # of another user, or no folder
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def _remove_abandoned() -> None:
    for folder in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"):
        if (descriptor := _locked(folder)) is not None:
            shutil.rmtree(folder, ignore_errors=True)
            os.close(descriptor)
