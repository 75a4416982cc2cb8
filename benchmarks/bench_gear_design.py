"""The simulations of a design of the updating chain: flexible housing, K, C_D and e_F over Table 3

Each is a run of 0.3 s of settling and 24 mesh periods at the tolerance of the chain (rtol 3e-5), from which the mesh
lines follow.  The design goes through the chain's own two processes, whose start is included.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from gearbox.files.operating_condition import OperatingCondition
from gearbox.papers.updating_success import rig_vibration
from gearbox.rig.accelerometers import PARAMETERS
from gearbox.updating.runs import ModelSource, Runs
from gearbox.updating.virtual import Settings
from surrogate import DesignSpace, latin_hypercube

BASE = OperatingCondition(1000.0, 150.0)


def _wanted(count: int) -> list[tuple[dict[str, float], Any]]:
    space = DesignSpace.from_mapping({n: (low, high, u) for n, _, low, high, u in PARAMETERS[:3]})
    points = latin_hypercube(space, count, seed=1).points.tolist()
    return [(dict(zip(space.names, x, strict=True)), BASE) for x in points]


def bench_start() -> Callable[[], None]:
    """one simulation at Table 2's parameters, in this process"""
    model = rig_vibration("flexible")
    model({}, BASE, 0.05)

    def work() -> None:
        model({}, BASE, Settings(driving_teeth=32).length(BASE))

    return work


def bench_design() -> Callable[[], None]:
    """45 simulations, two processes"""

    def work() -> None:
        with Runs(ModelSource(rig_vibration, "flexible", "bench"), Settings(driving_teeth=32), processes=2) as runs:
            runs.many(_wanted(45))

    return work
