"""A hundred different 37-state trips (parameters drawn at random), one after another and on two processors.

The aim is that a hundred take no longer on two processors than fifty one after another. The last entry says what two
processors give to single runs: two threads that share nothing and keep nothing but the last state. Where it is above 1,
they are not two whole ones (they share a core, caches, or the clock that one alone would have). A batch takes less
because each thread takes four runs through the equations at once, with the same results to the last bit.  All by
DormandPrince54 unless the entry says otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
from trips import DURATION, reference_trip

COUNT = 100
OPTIONS = {"rtol": 1e-3, "atol": 1e-6}


def _plan(count: int, tangent: bool = False) -> Iterator[tuple[Any, np.ndarray]]:
    from multibody.system.simulate import native_problem

    given, rng = reference_trip(), np.random.default_rng(1)
    problem = native_problem(given.system, given.system.p, given.table, tangent=tangent)
    for _ in range(count):
        yield replace(problem, p=problem.p * (1.0 + 0.01 * rng.normal(size=problem.p.size))), given.start


def _in_turn(count: int, samples: bool = True, default: bool = False) -> Callable[[], None]:
    from multibody.solvers import Automatic, DormandPrince54, integrate

    method = Automatic if default else DormandPrince54
    times = reference_trip().times if samples else np.array([DURATION])

    def work() -> None:
        for problem, start in _plan(count, tangent=default):
            run = integrate(problem, (0.0, DURATION), start, t_eval=times, method=method, **OPTIONS)
            if not run.success:
                raise RuntimeError(run.message)

    return work


def _batch(count: int, workers: int, default: bool = False) -> Callable[[], None]:
    from multibody.solvers import Automatic, DormandPrince54
    from multibody.solvers.batch import batch

    method = Automatic if default else DormandPrince54
    times = reference_trip().times

    def work() -> None:
        for run in batch(_plan(count, default), (0.0, DURATION), times, workers, method=method, **OPTIONS):
            if not run.success:
                raise RuntimeError(run.message)

    return work


def bench_fifty_in_turn() -> Callable[[], None]:
    """50 trips through solve_ivp, one after another"""
    return _in_turn(COUNT // 2)


def bench_hundred_in_turn() -> Callable[[], None]:
    """100 trips through solve_ivp, one after another"""
    return _in_turn(COUNT)


def bench_hundred_in_one_thread() -> Callable[[], None]:
    """100 trips as a batch on one thread"""
    return _batch(COUNT, 1)


def bench_hundred_at_once() -> Callable[[], None]:
    """100 trips as a batch on two threads"""
    return _batch(COUNT, 2)


def bench_fifty_by_default() -> Callable[[], None]:
    """50 trips through solve_ivp by the default method, one after another"""
    return _in_turn(COUNT // 2, default=True)


def bench_hundred_by_default() -> Callable[[], None]:
    """100 trips as a batch on two threads by the default method"""
    return _batch(COUNT, 2, default=True)


def bench_two_apart() -> Callable[[], None]:
    """two threads of 50 trips each through solve_ivp, only the last state kept"""
    alone = _in_turn(COUNT // 2, samples=False)

    def work() -> None:
        with ThreadPoolExecutor(2) as pool:
            for done in [pool.submit(alone), pool.submit(alone)]:
                done.result()

    return work
