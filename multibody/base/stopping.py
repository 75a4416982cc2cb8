"""Ending a command early and in good order: by Ctrl-C, by SIGTERM, or because its time is up."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

__all__ = ["Stopped", "go_on", "raise_if_stopped", "stoppable"]

_reason = ""


class Stopped(KeyboardInterrupt):
    """Work was ended early; the text says by what.

    Attributes
    ----------
    code : int
        Exit code of a command that ends so: 130 after Ctrl-C, 143 after SIGTERM, 124 where the time was up.
    """

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.code = 143 if "SIGTERM" in reason else 124 if "time limit" in reason else 130


def raise_if_stopped() -> None:
    """Raise `Stopped` where the command is to end; for loops that run in threads, which get no signal."""
    if _reason:
        raise Stopped(_reason)


def go_on() -> None:
    """Let work be done again: that of concluding what is known."""
    global _reason
    _reason = ""


@contextmanager
def stoppable(seconds: float | None = None) -> Iterator[None]:
    """Turn Ctrl-C, SIGTERM and the end of a time limit into `Stopped`, in this thread and in those it works with.

    Outside of a process's main thread it does nothing.

    Parameters
    ----------
    seconds : float, s, optional
        Time limit by the wall clock.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(reason: str) -> Any:
        def handler(number: int, frame: FrameType | None) -> None:
            global _reason
            if _reason:  # a second time: at once
                go_on()
                raise KeyboardInterrupt
            _reason = reason
            raise Stopped(reason)

        return handler

    handlers = {signal.SIGINT: stop("interrupted"), signal.SIGTERM: stop("ended by SIGTERM")}
    timed = seconds is not None and hasattr(signal, "setitimer")
    if timed:
        handlers[signal.SIGALRM] = stop(f"the time limit of {seconds:g} s was reached")
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        if timed and seconds is not None:
            signal.setitimer(signal.ITIMER_REAL, seconds)
        yield
    finally:
        if timed:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler)
        go_on()
