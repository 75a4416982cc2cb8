"""Start of a process: the interpreter and its imports.

Byte code of all modules is there, as after an installation.  The first trip needs SciPy's `solve_ivp`, whose import
alone is a row of its own; names and texts of the model's equations and machine code are in the cache.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable

_BYTE_CODE = tempfile.TemporaryDirectory()  # where this process may not write it beside the sources, or was told not to
_ENVIRONMENT = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
_ENVIRONMENT["PYTHONPYCACHEPREFIX"] = _BYTE_CODE.name


def _python(code: str) -> Callable[[], None]:
    def work() -> None:
        subprocess.run([sys.executable, "-c", code], check=True, env=_ENVIRONMENT)

    return work


def bench_bare() -> Callable[[], None]:
    """bare interpreter"""
    return _python("pass")


def bench_numpy() -> Callable[[], None]:
    """import numpy"""
    return _python("import numpy")


def bench_vtsdt() -> Callable[[], None]:
    """import vtsdt"""
    return _python("import vtsdt")


def bench_all_packages() -> Callable[[], None]:
    """import all six packages"""
    return _python("import multibody, estimation, surrogate, discrepancy, vtsdt, gearbox")


def bench_solve_ivp() -> Callable[[], None]:
    """import scipy.integrate"""
    return _python("import scipy.integrate")


TRIP = "from vtsdt.lift.lift import Lift; Lift.reference().trip('up')"


def bench_first_trip() -> Callable[[], None]:
    """a new process from its start to the end of its first 37-state trip, everything in the cache"""
    work = _python(TRIP)
    work()
    return work


def bench_cold_trip() -> Callable[[], None]:
    """the same with an empty cache: everything compiled"""

    def work() -> None:
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([sys.executable, "-c", TRIP], check=True, env={**_ENVIRONMENT, "VTSDT_CACHE": folder})

    return work
