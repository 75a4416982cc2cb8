"""A hundred different 37-state trips (parameters drawn at random), one after another and on two processors."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from trips import DURATION, reference_trip

COUNT = 100
OPTIONS = {"rtol": 1e-3, "atol": 1e-6}


def _plan(count: int) -> Iterator[tuple[Any, np.ndarray]]:
    from multibody.simulate import native_problem

    given, rng = reference_trip(), np.random.default_rng(1)
    problem = native_problem(given.system, given.system.p, given.table)
    for _ in range(count):
        yield replace(problem, p=problem.p * (1.0 + 0.01 * rng.normal(size=problem.p.size))), given.start


def _in_turn(count: int) -> Callable[[], None]:
    from multibody.solvers import DormandPrince54, integrate

    times = reference_trip().times

    def work() -> None:
        for problem, start in _plan(count):
            run = integrate(problem, (0.0, DURATION), start, t_eval=times, method=DormandPrince54, **OPTIONS)
            if not run.success:
                raise RuntimeError(run.message)

    return work


def _batch(count: int, workers: int) -> Callable[[], None]:
    from multibody.solvers import DormandPrince54
    from multibody.solvers.batch import batch

    times = reference_trip().times

    def work() -> None:
        for run in batch(_plan(count), (0.0, DURATION), times, workers, method=DormandPrince54, **OPTIONS):
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
