"""Start of a process: the interpreter and its imports."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable


def _python(code: str) -> Callable[[], None]:
    def work() -> None:
        subprocess.run([sys.executable, "-c", code], check=True)

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
