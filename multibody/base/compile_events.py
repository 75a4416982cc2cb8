"""Word of compilations, which can take seconds and happen once on a machine."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from functools import lru_cache
from typing import Any

__all__ = ["listen_to_numba", "on_compile", "tell"]

_log = logging.getLogger("multibody.compile.native")
_listeners: list[Callable[[str, float | None], None]] = []


def on_compile(callback: Callable[[str, float | None], None]) -> Callable[[], None]:
    """Call ``callback(name, seconds)`` around every compilation that the cache could not save.

    ``seconds`` is None when it begins and the time taken when it ends.  Returns a function that ends the
    subscription.
    """
    _listeners.append(callback)
    return lambda: _listeners.remove(callback)


def tell(name: str, seconds: float | None) -> None:
    """Tell log and listeners that a compilation begins (None) or how long it took, in s."""
    if seconds is None:
        _log.info("compiling %s (once on this machine)", name)
    else:
        _log.info("compiled %s in %.1f s", name, seconds)
    for listener in list(_listeners):
        listener(name, seconds)


@lru_cache(maxsize=1)
def listen_to_numba() -> None:
    """Hear of the compilation of drivers, which numba starts by itself at their first call."""
    from numba.core import event

    class Listener(event.Listener):
        def __init__(self) -> None:
            self.open: list[tuple[str, float]] = []

        def on_start(self, event: Any) -> None:
            function = event.data["dispatcher"].py_func
            self.open.append((function.__name__, time.perf_counter()))
            if len(self.open) == 1 and (function.__module__ or "").startswith("vtsdt_native_"):
                tell(function.__name__, None)

        def on_end(self, event: Any) -> None:
            name, begun = self.open.pop()
            module = event.data["dispatcher"].py_func.__module__ or ""
            if not self.open and module.startswith("vtsdt_native_"):
                tell(name, time.perf_counter() - begun)

    event.register("numba:compile", Listener())
