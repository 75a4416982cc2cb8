"""A map over threads: compiled loops release the interpreter, so that they run at the same time."""

from __future__ import annotations

import _thread as _thread_module
import os
import threading
from collections.abc import Callable, Iterable
from typing import Any, Generic, TypeVar

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
    return _Shared(work, items, max(1, available // count)).done_by(count)


class _Shared(Generic[T, R]):
    """Items that this thread and others take one after the other.

    A thread that got no memory may never begin, and ``threading.Thread.start``, as an executor calls it, then waits for
    it for ever.  Here only those are waited for that have taken an item, and what nobody takes this thread does itself.

    Parameters
    ----------
    work : callable
    items : list
    cores : int
        That each thread may use.
    """

    def __init__(self, work: Callable[[T], R], items: list[T], cores: int) -> None:
        self.work, self.items, self.cores = work, items, cores
        self.results: list[Any] = [None] * len(items)
        self.errors: list[BaseException | None] = [None] * len(items)
        self.changed = threading.Condition()
        self.next = 0  # item to be taken
        self.busy = 0  # helpers that have taken one

    def done_by(self, count: int) -> list[R]:
        """Return the results of all items, by so many threads at most."""
        for _ in range(count - 1):
            try:
                _thread_module.start_new_thread(self._take, (True,))
            except RuntimeError:  # the system has no memory for a further thread
                break
        try:
            self._take(False)
        finally:
            with self.changed:
                self.next = len(self.items)
                while self.busy:
                    self.changed.wait()
        for error in self.errors:
            if error is not None:
                raise error
        return self.results

    def _next(self, helps: bool) -> int | None:
        with self.changed:
            if self.next == len(self.items):
                return None
            self.next += 1
            self.busy += helps
            return self.next - 1

    def _take(self, helps: bool) -> None:
        before = getattr(_thread, "cores", 0)
        _thread.cores = self.cores
        try:
            while (k := self._next(helps)) is not None:
                try:
                    self.results[k] = self.work(self.items[k])
                except BaseException as error:
                    self.errors[k] = error
                    with self.changed:
                        self.next = len(self.items)
                finally:
                    if helps:
                        with self.changed:
                            self.busy -= 1
                            self.changed.notify()
        finally:
            _thread.cores = before
