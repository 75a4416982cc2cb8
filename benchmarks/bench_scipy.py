"""The 37-state trip by `System.simulate`, default tolerances, by SciPy's methods, and what SciPy itself takes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from trips import DURATION, reference_trip


def _trip(method: str) -> Callable[[], None]:
    given = reference_trip()

    def work() -> None:
        given.system.simulate(DURATION, inputs=given.inputs, initial=given.start, times=given.times, method=method)

    return work


def _nothing(method: str) -> Callable[[], None]:
    """SciPy's own work: as many steps and samples, with a function that does nothing."""
    from scipy.integrate import solve_ivp

    given = reference_trip()
    n = len(given.start)
    zero, matrix = np.zeros(n), np.zeros((n, n))
    options = {"jac": lambda t, x: matrix} if method in ("Radau", "BDF", "LSODA") else {}

    def work() -> None:
        solve_ivp(
            lambda t, x: zero, (0.0, DURATION), given.start, method=method, t_eval=given.times, max_step=1e-3, **options
        )

    return work


def bench_default() -> Callable[[], None]:
    """the default method"""
    return _trip("auto")


def bench_rk23() -> Callable[[], None]:
    """RK23"""
    return _trip("RK23")


def bench_rk45() -> Callable[[], None]:
    """RK45"""
    return _trip("RK45")


def bench_dop853() -> Callable[[], None]:
    """DOP853"""
    return _trip("DOP853")


def bench_lsoda() -> Callable[[], None]:
    """LSODA"""
    return _trip("LSODA")


def bench_bdf() -> Callable[[], None]:
    """BDF"""
    return _trip("BDF")


def bench_radau() -> Callable[[], None]:
    """Radau"""
    return _trip("Radau")


def bench_nothing_rk45() -> Callable[[], None]:
    """RK45 with a function that does nothing, 6000 steps"""
    return _nothing("RK45")


def bench_nothing_lsoda() -> Callable[[], None]:
    """LSODA with a function that does nothing, 6000 steps"""
    return _nothing("LSODA")


def bench_nothing_bdf() -> Callable[[], None]:
    """BDF with a function that does nothing, 6000 steps"""
    return _nothing("BDF")


def bench_nothing_radau() -> Callable[[], None]:
    """Radau with a function that does nothing, 6000 steps"""
    return _nothing("Radau")
