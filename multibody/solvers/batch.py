"""Many integrations side by side, in constant memory, with failures reported one by one.

Threads take runs in small groups, each group through one call of the compiled loop, which holds no interpreter lock.
What that loop cannot finish by itself (a failure, an option that it does not have) is done again the long way, through
`solve_ivp`, so that results and messages are those of single runs.
"""

from __future__ import annotations

import itertools
import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any

import numpy as np

from multibody.base.parallel import Crew, Task
from multibody.solvers.groups import GROUP_BYTES, Group, Item, Run
from multibody.solvers.problem import NativeProblem
from multibody.solvers.run import integrate

__all__ = ["Run", "batch"]

AHEAD = 4  # groups of runs that wait or are worked on, for each thread


def batch(
    runs: Iterable[tuple[NativeProblem, Any]],
    t_span: tuple[float, float],
    t_eval: Any = None,
    workers: int | None = None,
    progress: Callable[[str], Any] | None = None,
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
    progress : callable, optional
        Takes a line of text now and then, such as `multibody.base.progress.ProgressLine`.

    Yields
    ------
    Run
        In the order given.  At most a few results for each thread wait in memory.

    Examples
    --------
    ``for run in batch(((replace(problem, p=p), x0) for p in plan), (0, 6), t_eval): ...``
    """
    count = workers or os.cpu_count() or 1
    group = Group(dict(options, t_span=t_span, t_eval=t_eval))
    waiting: deque[Task[tuple[list[Run], float]]] = deque()
    source: Iterator[Item] = ((i, problem, x0) for i, (problem, x0) in enumerate(runs))
    first = next(source, None)
    if first is None:
        return
    source = itertools.chain([first], source)
    group.look_for_lanes(first[1], 0.0)
    size, spent, failed = group.size(group.bytes_of(first[1])), 0.0, 0
    with Crew(count - 1) as crew:  # this thread works as well
        while True:
            ahead = AHEAD if 4 * size * group.bytes_of(first[1]) <= GROUP_BYTES else AHEAD // 2
            while len(waiting) < ahead * count and (items := list(itertools.islice(source, size))):
                waiting.append(crew.submit(partial(_timed, group), items))
            if not waiting:
                return
            done, pace = waiting.popleft().result()
            spent += pace * len(done)
            group.look_for_lanes(first[1], spent)
            size = group.size(max(run.y.nbytes for run in done), pace)
            for run in done:
                failed += not run.success
                if progress is not None:
                    progress(f"run {run.index + 1}" + (f", {failed} failed" if failed else ""))
                yield run


def _timed(group: Group, items: list[Item]) -> tuple[list[Run], float]:
    begun = time.perf_counter()
    together = group(items)
    done = [together.get(i) or _run(i, problem, x0, group.options) for i, problem, x0 in items]
    return done, (time.perf_counter() - begun) / len(items)


def _run(index: int, problem: NativeProblem, x0: Any, options: dict[str, Any]) -> Run:
    try:
        done = integrate(problem, x0=x0, **options)
    except Exception as error:
        return Run(
            index=index,
            success=False,
            message=f"{type(error).__name__}: {error}",
            t=np.empty(0),
            y=np.empty((problem.size, 0)),
        )
    return Run(index=index, success=bool(done.success), message=str(done.message), t=done.t, y=done.y)
