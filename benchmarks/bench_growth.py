"""Growth with the size of a machine: chains of masses and springs, one second of motion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def _chain(count: int) -> Callable[[], None]:
    from multibody import Model
    from multibody.library import Mass, Spring

    model = Model("chain")
    last = model.ground
    for k in range(count):
        body, spring = model.add(f"body{k}", Mass(m=1.0)), model.add(f"spring{k}", Spring(stiffness=1e4))
        model.connect(spring.a, last)
        model.connect(spring.b, body.flange)
        last = body.flange
    system = model.build()
    times, initial = np.linspace(0.0, 1.0, 101), {"body0.position": 0.01}

    def work() -> None:
        system.simulate(1.0, times=times, initial=initial, method="DormandPrince54", max_step=2e-3)

    work()
    return work


def bench_5() -> Callable[[], None]:
    """5 masses"""
    return _chain(5)


def bench_10() -> Callable[[], None]:
    """10 masses"""
    return _chain(10)


def bench_20() -> Callable[[], None]:
    """20 masses"""
    return _chain(20)


def bench_40() -> Callable[[], None]:
    """40 masses"""
    return _chain(40)


def bench_80() -> Callable[[], None]:
    """80 masses"""
    return _chain(80)
