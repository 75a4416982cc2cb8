"""A map over threads: compiled loops release the interpreter, so that they run at the same time."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable
from typing import TypeVar

__all__ = ["available_cores", "parallel_map"]

T = TypeVar("T")
R = TypeVar("R")

_thread = threading.local()


def available_cores() -> int:
    """Return how many cores this thread may use: those of the machine, or the share that `parallel_map` gave it."""
    return int(getattr(_thread, "cores", 0)) or os.cpu_count() or 1


def parallel_map(work: Callable[[T], R], items: Iterable[T], *, most: int | None = None) -> list[R]:
    """Call a function with each item, as many at a time as there are cores, and return the results in order.

    A nested call gets its share of the cores, so that there are never more working threads than cores.  The first
    error, in the items' order, is raised when every call that has begun has ended.

    Parameters
    ----------
    work : callable
    items : iterable
    most : int, optional
        Largest number of items at a time; default: `available_cores`.

    Examples
    --------
    >>> parallel_map(abs, [-3, 2, -1])
    [3, 2, 1]
    """
    items = list(items)
    available = available_cores()
    count = min(len(items), available if most is None else min(most, available))
    if count < 2:
        return [work(item) for item in items]
    from concurrent.futures import ThreadPoolExecutor

    share = max(1, available // count)
    with ThreadPoolExecutor(count, initializer=lambda: setattr(_thread, "cores", share)) as pool:
        return list(pool.map(work, items))
