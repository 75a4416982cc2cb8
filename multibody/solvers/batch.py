"""Many integrations side by side, in constant memory, with failures reported one by one."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from multibody.solvers.problem import NativeProblem
from multibody.solvers.run import integrate

__all__ = ["Run", "batch"]


@dataclass(frozen=True, eq=False)
class Run:
    """One integration of a batch.

    Parameters
    ----------
    index : int
        Place in the order given.
    success : bool
    message : str
        Why it ended; in case of failure the time and the state.
    t : ndarray, shape (nt,), s
        Times reached.
    y : ndarray, shape (size, nt)
    """

    index: int
    success: bool
    message: str
    t: np.ndarray
    y: np.ndarray


def _run(index: int, problem: NativeProblem, x0: Any, options: dict[str, Any]) -> Run:
    try:
        done = integrate(problem, x0=x0, **options)
    except Exception as error:
        return Run(index, False, f"{type(error).__name__}: {error}", np.empty(0), np.empty((problem.size, 0)))
    return Run(index, bool(done.success), str(done.message), done.t, done.y)


def batch(
    runs: Iterable[tuple[NativeProblem, Any]],
    t_span: tuple[float, float],
    t_eval: Any = None,
    workers: int | None = None,
    **options: Any,
) -> Iterator[Run]:
    """Integrate many problems by threads, which the compiled loops do not hold up.

    Parameters
    ----------
    runs : iterable of (NativeProblem, x0)
        Drawn as they are needed: a generator of a million is fine.
    t_span, t_eval, options
        As for `integrate`.
    workers : int, optional
        Threads; as many as processors without it.

    Yields
    ------
    Run
        In the order given.  At most a few results for each thread wait in memory.

    Examples
    --------
    ``for run in batch(((replace(problem, p=p), x0) for p in plan), (0, 6), t_eval): ...``
    """
    count = workers or os.cpu_count() or 1
    settings = dict(options, t_span=t_span, t_eval=t_eval)
    waiting: deque[Future[Run]] = deque()
    with ThreadPoolExecutor(count) as pool:
        try:
            for index, (problem, x0) in enumerate(runs):
                waiting.append(pool.submit(_run, index, problem, x0, settings))
                if len(waiting) >= 4 * count:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()
