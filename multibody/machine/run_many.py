"""Many runs on any executor: processes of this machine, threads, or the workers of a cluster."""

from __future__ import annotations

import itertools
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from multibody.base.process_pool import process_pool
from multibody.machine.model import Model, System

__all__ = ["Outcome", "run_many", "simulate_many"]

AHEAD = 4  # runs submitted for each worker, so that none waits for this process
_numbers = itertools.count(1)
_systems: dict[tuple[int, int], System] = {}


@dataclass(frozen=True, eq=False)
class Outcome:
    """The result of one run.

    Parameters
    ----------
    index : int
        Position in the order given.
    value : object
        What the function returned; None after a failure.
    error : str
        Kind and text of the error; empty after a success.
    """

    index: int
    value: Any
    error: str = ""

    @property
    def success(self) -> bool:
        """Whether the run ended without an error."""
        return not self.error


def run_many(
    function: Callable[..., Any],
    items: Iterable[Any],
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    progress: Callable[[str], Any] | None = None,
) -> Iterator[Outcome]:
    """Call a function with every item, each in a worker, and yield the outcomes in the order given.

    A call that fails yields an `Outcome` with its error; the others go on.  Items are taken and outcomes yielded as
    they are needed: a generator of a million items is fine, and only a few results wait in memory.

    Parameters
    ----------
    function : callable
        Of one item.  For other processes it has to be defined at the top of a module.
    items : iterable
    executor : concurrent.futures.Executor, optional
        Where the calls run, such as that of a Dask cluster (``client.get_executor()``); it is not shut down.  Default:
        a pool of processes on this machine.
    workers : int, optional
        Processes of the pool, or the number of workers assumed for the executor; default: the processors here.
    progress : callable, optional
        Called with a line of text now and then, such as `multibody.base.progress.ProgressLine`.

    Examples
    --------
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> with ThreadPoolExecutor(2) as pool:
    ...     for outcome in run_many(lambda x: 1 / x, [1, 0, 4], executor=pool):
    ...         print(outcome.index, outcome.value, outcome.error)
    0 1.0
    1 None ZeroDivisionError: division by zero
    2 0.25
    """
    count = max(1, workers or getattr(executor, "_max_workers", None) or os.cpu_count() or 1)
    with ExitStack() as stack:
        if executor is None:
            executor = stack.enter_context(process_pool(count))
        waiting: deque[tuple[int, Future[Any]]] = deque()
        failed = 0
        try:
            source = enumerate(items)
            while True:
                for index, item in itertools.islice(source, AHEAD * count - len(waiting)):
                    waiting.append((index, executor.submit(_guarded, function, item)))
                if not waiting:
                    return
                outcome = _finished(*waiting.popleft())
                failed += not outcome.success
                if progress is not None:
                    progress(f"run {outcome.index + 1}" + (f", {failed} failed" if failed else ""))
                yield outcome
        finally:
            for _, future in waiting:
                future.cancel()


def _guarded(function: Callable[..., Any], item: Any) -> tuple[Any, str]:
    """Call in the worker; errors are returned as text, because not every error can be pickled."""
    try:
        return function(item), ""
    except Exception as error:
        return None, f"{type(error).__name__}: {error}"


def _finished(index: int, future: Future[Any]) -> Outcome:
    try:
        return Outcome(index, *future.result())
    except Exception as error:  # the worker was lost, or its result could not be pickled
        return Outcome(index, None, f"{type(error).__name__}: {error}")


def simulate_many(
    model: Model,
    runs: Iterable[Mapping[str, Any]],
    keep: Sequence[str] | Callable[..., Any] = (),
    **options: Any,
) -> Iterator[Outcome]:
    """Simulate a model many times, with parameters, inputs or start values that differ from run to run.

    Parameters
    ----------
    model : Model
        Compiled once, here, before the workers start; they find it in the cache.
    runs : iterable of mapping
        Arguments of `multibody.system.simulate.simulate` for each run, such as ``{"until": 6.0, "parameters": {…}}``.
    keep : sequence of str, or callable
        Outputs to return, as an array of shape (nt, len(keep)), or a function of the trajectory at the top of a module,
        whose result is returned.
    options
        Of `run_many`.

    Yields
    ------
    Outcome
        In the order given.

    Examples
    --------
    ``for outcome in simulate_many(Lift.reference(), ({"until": 6.0, "parameters": p} for p in plan), ["F_c"]): …``
    """
    system = model.build()
    for part in (system.rhs_function, system.outputs_function):
        part.check()
    if not callable(keep):
        for name in keep:
            system.unit(name)
    key = (os.getpid(), next(_numbers))
    tasks = ((key, model, dict(run), keep) for run in runs)
    return run_many(_simulated, tasks, **options)


def _simulated(task: tuple[tuple[int, int], Model, dict[str, Any], Any]) -> Any:
    key, model, arguments, keep = task
    if key not in _systems:
        _systems.clear()  # one structure at a time: a worker lives long
        _systems[key] = model.build()
    run = _systems[key].simulate(**arguments)
    if callable(keep):
        return keep(run)
    import numpy as np

    return np.column_stack([run[name] for name in keep]) if len(keep) else run.states
