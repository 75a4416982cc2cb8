"""What a command of this package shows while it works."""

from __future__ import annotations

import sys
import time
from contextlib import AbstractContextManager
from typing import Any

__all__ = ["Teller"]


class Teller(AbstractContextManager["Teller"]):
    """A line that moves on a terminal, now and then a plain line elsewhere, or nothing.

    Parameters
    ----------
    quiet : bool
        Show nothing.

    Examples
    --------
    >>> with Teller(quiet=True) as tell:
    ...     tell("recording 1 of 6")
    """

    def __init__(self, quiet: bool) -> None:
        self.quiet = quiet
        self._status: Any = None
        self._begun = self._told = time.monotonic()
        self._last = ""

    def __call__(self, text: str) -> None:
        if self.quiet:
            return
        now = time.monotonic()
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.text import Text

            if self._status is None:
                self._status = Console(stderr=True, highlight=False).status("")
                self._status.start()
            self._status.update(Text(f"{now - self._begun:6.1f} s  {text}"))
            return
        # Runs of one kind follow each other fast: one line every few seconds is enough in a log.
        kind = text.partition(":")[0]
        if kind != self._last or now - self._told > 5.0:
            sys.stderr.write(f"{now - self._begun:6.1f} s  {text}\n")
            sys.stderr.flush()
            self._last, self._told = kind, now

    def __exit__(self, *error: object) -> None:
        if self._status is not None:
            self._status.stop()
            self._status = None
