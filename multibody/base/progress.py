"""Progress: what a long function reports while it works, and the line that shows it."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

from multibody.base.compile_events import on_compile

__all__ = ["Progress", "ProgressLine", "silent"]

#: What a long function calls with a line of text now and then.
Progress = Callable[[str], None]

PATIENCE = 2.0  # s of work before the first line is printed where lines cannot be removed
INTERVAL = 5.0  # s between printed lines of one kind


def silent(text: str) -> None:
    """Ignore a line of progress."""


class ProgressLine(AbstractContextManager["ProgressLine"]):
    """A line that is replaced on a terminal, plain lines elsewhere, or nothing; compilations are reported as well.

    A context manager that removes the line at its end, and a callable that takes its text.  Where lines cannot be
    replaced, those of one kind (the same text before the first colon) are printed every few seconds only.

    Parameters
    ----------
    quiet : bool
        Show nothing.

    Examples
    --------
    >>> with ProgressLine(quiet=True) as progress:
    ...     progress("trip 1 of 8")
    """

    def __init__(self, quiet: bool = False) -> None:
        self.quiet = quiet
        self._status: Any = None
        self._start = time.monotonic()
        self._printed = (float("-inf"), "")  # when, and the kind
        self._unsubscribe: Callable[[], None] | None = None

    def __enter__(self) -> ProgressLine:
        if not self.quiet:
            self._unsubscribe = on_compile(self._compiling)
        return self

    def _compiling(self, name: str, seconds: float | None) -> None:
        if seconds is None:
            self(f"compile {name} (once on this machine)")

    def __call__(self, text: str) -> None:
        """Show what is being done."""
        if self.quiet:
            return
        if sys.stdout.isatty():
            from rich.console import Console
            from rich.text import Text

            if self._status is None:
                self._status = Console(highlight=False).status("")
                self._status.start()
            self._status.update(Text(text))
            return
        now, kind = time.monotonic(), text.partition(":")[0]
        printed, last = self._printed
        if now - self._start > PATIENCE and (kind != last or now - printed > INTERVAL):
            sys.stderr.write(f"{now - self._start:6.1f} s  {text}\n")
            sys.stderr.flush()
            self._printed = (now, kind)

    def __exit__(self, *error: object) -> None:
        if self._unsubscribe is not None:
            self._unsubscribe()
            self._unsubscribe = None
        if self._status is not None:
            self._status.stop()
            self._status = None
