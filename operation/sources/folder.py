"""A folder into which files are written: each is offered when it has stopped growing, in the order of their time.

Time differences come from the monotonic clock, so that a jump of the computer's clock neither hides a file nor offers a
half written one.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path

__all__ = ["FolderSource"]

#: Names that programs give to files that are not finished.
UNFINISHED = (".*", "*.tmp", "*.part", "*.partial", "*~", "*.crdownload")


@dataclass
class _Seen:
    size: int
    modified: int
    since: float
    offered: bool = False


@dataclass(kw_only=True)
class FolderSource:
    """New files in a folder and the folders in it.

    Parameters
    ----------
    folder : Path
    patterns : tuple of str
        Of the file names.
    settle : float, s
        How long size and time of a file must stay as they are before it counts as whole.  A file that grows later is
        offered again.
    clock : callable
        Seconds that never go back.
    """

    folder: Path
    patterns: tuple[str, ...] = ("*",)
    settle: float = 2.0
    clock: Callable[[], float] = time.monotonic
    _seen: dict[Path, _Seen] = field(default_factory=dict, repr=False)

    @property
    def all_offered(self) -> bool:
        """Whether every file that was there at the last poll has been offered."""
        return all(seen.offered for seen in self._seen.values())

    def poll(self) -> list[Path]:
        """Return the files that are whole and have not been offered yet, oldest first."""
        now, ready, present = self.clock(), [], set()
        for path in sorted(self.folder.rglob("*")):
            if any(fnmatch(path.name, p) for p in UNFINISHED) or not any(fnmatch(path.name, p) for p in self.patterns):
                continue
            try:
                status = path.stat()
            except OSError:  # gone since it was listed
                continue
            if not path.is_file():
                continue
            present.add(path)
            known = self._seen.get(path)
            if known is None or (known.size, known.modified) != (status.st_size, status.st_mtime_ns):
                known = self._seen[path] = _Seen(status.st_size, status.st_mtime_ns, now)
            if not known.offered and now - known.since >= self.settle:
                known.offered = True
                ready.append((status.st_mtime_ns, str(path), path))
        for path in set(self._seen) - present:
            del self._seen[path]
        return [path for _, _, path in sorted(ready)]
