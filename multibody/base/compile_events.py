"""Word of compilations, which can take seconds and happen once on a machine."""

from __future__ import annotations

import logging
from collections.abc import Callable

__all__ = ["on_compile", "tell"]

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
