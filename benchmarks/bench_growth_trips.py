"""Growth with the number of trips: batches of different 17-state trips on one thread."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from trips import DURATION, trip


def _batch(count: int) -> Callable[[], None]:
    from multibody.solvers import DormandPrince54
    from multibody.solvers.batch import batch
    from multibody.system.simulate import native_problem

    given = trip("one_dimensional")
    problem = native_problem(given.system, given.system.p, given.table)
    factors = 1.0 + 0.01 * np.random.default_rng(1).normal(size=(count, problem.p.size))

    def work() -> None:
        runs = ((replace(problem, p=problem.p * f), given.start) for f in factors)
        for run in batch(runs, (0.0, DURATION), given.times, 1, method=DormandPrince54):
            if not run.success:
                raise RuntimeError(run.message)

    return work


def bench_10() -> Callable[[], None]:
    """10 trips"""
    return _batch(10)


def bench_20() -> Callable[[], None]:
    """20 trips"""
    return _batch(20)


def bench_40() -> Callable[[], None]:
    """40 trips"""
    return _batch(40)


def bench_80() -> Callable[[], None]:
    """80 trips"""
    return _batch(80)
