"""One trip of the virtual axis (6 s at 1 kHz) through `solve_ivp`, by method, and the compilation of a model."""

from __future__ import annotations

import itertools
import os
import tempfile
from collections.abc import Callable

import numpy as np

_numbers = itertools.count(1)


def _axis():  # type: ignore[no-untyped-def]
    from discrepancy.rigs.axis import build

    return build()


def _trip(method: str, rtol: float) -> Callable[[], None]:
    system = _axis().build()
    times = np.arange(6001) * 1e-3
    reference = 0.2 * (1.0 - np.cos(2.0 * np.pi * times / 6.0))

    def work() -> None:
        system.simulate(6.0, inputs={"reference.position": (times, reference)}, times=times, method=method, rtol=rtol)

    work()
    return work


def bench_dormand_prince() -> Callable[[], None]:
    """compiled Dormand-Prince 5(4)"""
    return _trip("DormandPrince54", 1e-6)


def bench_rosenbrock() -> Callable[[], None]:
    """compiled Rodas5P"""
    return _trip("Rodas5P", 1e-6)


def bench_lsoda() -> Callable[[], None]:
    """SciPy LSODA with the exact Jacobian"""
    return _trip("LSODA", 1e-6)


def bench_rk45() -> Callable[[], None]:
    """SciPy RK45"""
    return _trip("RK45", 1e-6)


def bench_cold_compile() -> Callable[[], None]:
    """compile a new four-mass model (rates only), integrators already compiled"""

    def work() -> None:
        from multibody import Model
        from multibody.library import Mass, Spring

        model = Model("chain")
        tag = f"{os.getpid()}x{next(_numbers)}"  # another structure each time: nothing of it is in the cache
        last = model.ground
        for k in range(4):
            body = model.add(f"body{k}.run{tag}", Mass(m=1.0 + k))
            spring = model.add(f"spring{k}.run{tag}", Spring(stiffness=100.0))
            model.connect(spring.a, last)
            model.connect(spring.b, body.flange)
            last = body.flange
        system = model.build()
        system.rhs(0.0, system.start)

    return work


def bench_warm_process() -> Callable[[], None]:
    """a new process from its start to the end of its first simulation, everything in the cache"""
    from bench_start import _python

    code = (
        "from multibody import Model; from multibody.library import Mass, Spring; m = Model('o'); "
        "b = m.add('b', Mass(m=1.0, position=0.1)); s = m.add('s', Spring(stiffness=100.0)); m.connect(s.a, m.ground); "
        "m.connect(s.b, b.flange); m.build().simulate(1.0)"
    )
    work = _python(code)
    work()
    return work


def bench_cold_process() -> Callable[[], None]:
    """the same with an empty cache: integrator and model compiled"""
    import subprocess
    import sys

    code = (
        "from multibody import Model; from multibody.library import Mass, Spring; m = Model('o'); "
        "b = m.add('b', Mass(m=1.0, position=0.1)); s = m.add('s', Spring(stiffness=100.0)); m.connect(s.a, m.ground); "
        "m.connect(s.b, b.flange); m.build().simulate(1.0)"
    )

    def work() -> None:
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([sys.executable, "-c", code], check=True, env={**os.environ, "VTSDT_CACHE": folder})

    return work
