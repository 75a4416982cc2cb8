"""A hundred different 37-state trips (parameters drawn at random), one after another and on all processors."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from trips import DURATION, reference_trip

COUNT = 100


def _plan(count: int) -> Iterator[tuple[Any, np.ndarray]]:
    from multibody.simulate import native_problem

    given, rng = reference_trip(), np.random.default_rng(1)
    problem = native_problem(given.system, given.system.p, given.table)
    for _ in range(count):
        yield replace(problem, p=problem.p * (1.0 + 0.01 * rng.normal(size=problem.p.size))), given.start


def _batch(count: int, workers: int) -> Callable[[], None]:
    from multibody.solvers import DormandPrince54
    from multibody.solvers.batch import batch

    times = reference_trip().times

    def work() -> None:
        options = dict(method=DormandPrince54, rtol=1e-3, atol=1e-6)
        for run in batch(_plan(count), (0.0, DURATION), times, workers, **options):
            if not run.success:
                raise RuntimeError(run.message)

    return work


def bench_fifty_in_turn() -> Callable[[], None]:
    """50 trips one after another"""
    return _batch(COUNT // 2, 1)


def bench_hundred_in_turn() -> Callable[[], None]:
    """100 trips one after another"""
    return _batch(COUNT, 1)


def bench_hundred_at_once() -> Callable[[], None]:
    """100 trips on two threads"""
    return _batch(COUNT, 2)
