"""What a command shows while it works: a line that moves on a terminal, plain lines elsewhere, or nothing."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any

__all__ = ["Progress"]

PATIENCE = 2.0
"""Seconds of work before anything is said where lines cannot be taken back."""


class Progress:
    """A callable that takes a line of text; a context manager that takes the line away again.

    Parameters
    ----------
    quiet : bool
        Show nothing.

    Examples
    --------
    >>> with Progress(quiet=True) as progress:
    ...     progress("trip 1 of 8")
    """

    def __init__(self, quiet: bool = False) -> None:
        self.quiet = quiet
        self._status: Any = None
        self._begun = time.monotonic()
        self._deaf: Callable[[], None] | None = None

    def __enter__(self) -> Progress:
        if not self.quiet:
            from multibody.base.compile_events import on_compile

            self._deaf = on_compile(self._compiling)
        return self

    def _compiling(self, name: str, seconds: float | None) -> None:
        if seconds is None:
            self(f"compile {name} (once on this machine)")

    def __call__(self, text: str) -> None:
        """Say what is being done."""
        if self.quiet:
            return
        if not sys.stdout.isatty():
            if time.monotonic() - self._begun > PATIENCE:
                sys.stderr.write(f"{time.monotonic() - self._begun:6.1f} s  {text}\n")
                sys.stderr.flush()
            return
        if self._status is None:
            from rich.console import Console

            self._status = Console(highlight=False).status("")
            self._status.start()
        from rich.text import Text

        self._status.update(Text(text))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._deaf is not None:
            self._deaf()
            self._deaf = None
        if self._status is not None:
            self._status.stop()
            self._status = None
