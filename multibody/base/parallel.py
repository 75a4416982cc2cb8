"""Threads for work that can be done side by side: compiled loops leave the interpreter free for each other."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable
from typing import TypeVar

__all__ = ["cores", "side_by_side"]

T = TypeVar("T")
R = TypeVar("R")

_mine = threading.local()


def cores() -> int:
    """Return how many cores the work in this thread may use: those of the machine, divided among its neighbours."""
    return int(getattr(_mine, "cores", 0)) or os.cpu_count() or 1


def side_by_side(work: Callable[[T], R], items: Iterable[T], *, most: int | None = None) -> list[R]:
    """Return what a function makes of each item, in the items' order; as many at a time as there are cores for.

    Work that goes side by side again inside gets its share of the cores, so that there are never more threads at work
    than cores.  The first error, in the items' order, is raised once all that has begun is through.

    Parameters
    ----------
    work : callable
    items : iterable
    most : int, optional
        Items at a time at most; default `cores`.

    Examples
    --------
    >>> side_by_side(abs, [-3, 2, -1])
    [3, 2, 1]
    """
    items = list(items)
    available = cores()
    count = min(len(items), available if most is None else min(most, available))
    if count < 2:
        return [work(item) for item in items]
    from concurrent.futures import ThreadPoolExecutor

    share = max(1, available // count)
    with ThreadPoolExecutor(count, initializer=lambda: setattr(_mine, "cores", share)) as pool:
        return list(pool.map(work, items))
