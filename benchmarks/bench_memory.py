"""Memory that a batch of 17-state trips takes beyond what its process had before; one result is 0.8 MB.

The most that the process has resident after any run, in all or in the last hundred of them. It is bounded by the groups
of runs that two threads work on and those that wait to be handed on, whose number and size do not depend on how many
follow.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

UNIT = "B"
HERE = Path(__file__).resolve().parent

SCRIPT = """
import sys
sys.path.insert(0, sys.argv[2])
import numpy as np
from dataclasses import replace
from multibody.system.simulate import native_problem
from multibody.solvers.batch import batch
from trips import DURATION, trip

given = trip("one_dimensional")
problem = native_problem(given.system, given.system.p, given.table, tangent=True)
factors = 1.0 + 0.01 * np.random.default_rng(1).normal(size=(int(sys.argv[1]), problem.p.size))
def runs():
    for factor in factors:
        yield replace(problem, p=problem.p * factor), given.start
def resident():
    return 4096.0 * int(open("/proc/self/statm").read().split()[1])
failed = 0
for run in batch(((problem, given.start) for _ in range(2)), (0.0, DURATION), given.times, 1):
    failed += not run.success
before = resident()
after = []
for run in batch(runs(), (0.0, DURATION), given.times, 2):
    failed += not run.success
    after.append(resident() - before)
print(failed, max(after[-int(sys.argv[3]):]))
"""


def _most(count: int, last: int) -> Callable[[], float]:
    def work() -> float:
        done = subprocess.run(
            [sys.executable, "-c", SCRIPT, str(count), str(HERE), str(last)], check=True, capture_output=True, text=True
        )
        failed, found = done.stdout.split()[-2:]
        if int(failed):
            raise RuntimeError(f"{failed} of {count} runs failed")
        return float(found)

    return work


def bench_hundred() -> Callable[[], float]:
    """100 runs"""
    return _most(100, 100)


def bench_thousand() -> Callable[[], float]:
    """1000 runs"""
    return _most(1000, 1000)


def bench_last() -> Callable[[], float]:
    """1000 runs, the last hundred"""
    return _most(1000, 100)
