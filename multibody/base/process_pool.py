"""A pool of processes, all of which end with the one that made it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from concurrent.futures import ProcessPoolExecutor

__all__ = ["process_pool"]


def process_pool(count: int, *, tasks: int | None = None) -> ProcessPoolExecutor:
    """Return a pool of so many new processes, which do not outlive this one, however it ends.

    They are started anew: a fork of a process whose threads draw progress or hold locks of compiled code may hang.

    Parameters
    ----------
    count : int
    tasks : int, optional
        After which a process is replaced by a new one, which begins with empty memory.
    """
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(count, context, _die_with_parent, (os.getpid(),), max_tasks_per_child=tasks)


def _die_with_parent(parent: int) -> None:
    """Let this process end when its parent does, also where the parent is killed; for the start of worker processes.

    On Linux the kernel sees to it; elsewhere a thread looks every second.

    Parameters
    ----------
    parent : int
        Process id of the parent.
    """
    if sys.platform == "linux":
        import ctypes

        parent_death_signal = 1  # PR_SET_PDEATHSIG of prctl(2)
        ctypes.CDLL(None, use_errno=True).prctl(parent_death_signal, signal.SIGKILL)
        if os.getppid() != parent:  # it ended before
            os._exit(1)
        return

    def watch() -> None:
        while os.getppid() == parent:
            threading.Event().wait(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
