"""Calls by several threads: compiled loops release the interpreter, so that they run at the same time."""

from __future__ import annotations

import _thread as _thread_module
import os
import threading
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

__all__ = ["Crew", "Task", "available_cores", "parallel_map"]

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
    with Crew(count - 1, max(1, available // count), give_up=True) as crew:
        tasks = [crew.submit(work, item) for item in items]
        crew.work_off()
    for task in tasks:
        if task.error is not None:
            raise task.error
    return [task.value for task in tasks]


@dataclass(eq=False, kw_only=True)
class Task(Generic[R]):
    """A call that a `Crew` was asked for, and what came of it."""

    crew: Crew
    work: Callable[[], R]
    begun: bool = False
    done: bool = False
    value: Any = None
    error: BaseException | None = None

    def result(self) -> R:
        """Return the value, or raise the error; a call that no thread has begun is made by this one."""
        if self.crew.takes(self):
            self.crew.make(self)
        with self.crew.changed:
            while not self.done:
                self.crew.changed.wait()
        if self.error is not None:
            raise self.error
        value: R = self.value
        return value


class Crew:
    """This thread and helpers, which make calls in the order in which they were asked for.

    A thread that got no memory may never begin, and ``threading.Thread.start``, as an executor calls it, then waits for
    it for ever.  Here only those are waited for that have begun a call, and what nobody begins this thread does itself.
    Leaving the ``with`` block drops calls that have not begun, and waits for those that have.

    Parameters
    ----------
    helpers : int
        Threads beside this one; begun as there is work for them.
    cores : int
        That each call may use.
    give_up : bool
        Drop what has not begun when a call fails.
    """

    def __init__(self, helpers: int, cores: int = 1, *, give_up: bool = False) -> None:
        self.helpers, self.cores, self.give_up = helpers, cores, give_up
        self.changed = threading.Condition()
        self._waiting: deque[Task[Any]] = deque()
        self._busy = 0  # helpers that make a call
        self._closed = False

    def __enter__(self) -> Crew:
        return self

    def __exit__(self, *failure: object) -> None:
        with self.changed:
            self._closed = True
            self._waiting.clear()
            self.changed.notify_all()
            while self._busy:
                self.changed.wait()

    def submit(self, work: Callable[[T], R], item: T) -> Task[R]:
        """Ask for a call."""
        task = Task(crew=self, work=lambda: work(item))
        with self.changed:
            if self._closed:
                return task
            self._waiting.append(task)
            self.changed.notify_all()
        if self.helpers > 0:
            self.helpers -= 1
            try:
                _thread_module.start_new_thread(self._help, ())
            except RuntimeError:  # the system has no memory for a further thread
                self.helpers = 0
        return task

    def work_off(self) -> None:
        """Make all calls that have not begun, beside the helpers, and wait for those that have."""
        while (task := self._next(helps=False)) is not None:
            self.make(task)
        with self.changed:
            while self._busy:
                self.changed.wait()

    def takes(self, task: Task[Any]) -> bool:
        """Tell whether a call has not begun, and is this thread's from now on."""
        with self.changed:
            if task.begun:
                return False
            task.begun = True
            if task in self._waiting:
                self._waiting.remove(task)
            return True

    def make(self, task: Task[Any]) -> None:
        """Make a call that was taken."""
        before = getattr(_thread, "cores", 0)
        _thread.cores = self.cores
        try:
            task.value = task.work()
        except BaseException as error:
            task.error = error
            if self.give_up:
                with self.changed:
                    self._waiting.clear()
        finally:
            _thread.cores = before
            with self.changed:
                task.done = True
                self.changed.notify_all()

    def _next(self, *, helps: bool) -> Task[Any] | None:
        """Return the next call; None where there is none left, for a helper at the end alone."""
        with self.changed:
            while helps and not self._waiting and not self._closed:
                self.changed.wait()
            if not self._waiting:
                return None
            task = self._waiting.popleft()
            task.begun = True
            self._busy += helps
            return task

    def _help(self) -> None:
        while (task := self._next(helps=True)) is not None:
            try:
                self.make(task)
            finally:
                with self.changed:
                    self._busy -= 1
                    self.changed.notify_all()
