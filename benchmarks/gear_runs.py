"""Runs of the gear stage that the benchmarks of `bench_gear_*.py` share."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from gearbox.stage.stage import GearStage

SPEED, TORQUE = 1000.0, 150.0
#: Start of the paper's updating, its updated point (Table 4), and a corner of Table 3 with its stiffest damper.
POINTS: dict[str, dict[str, float]] = {
    "Table 2": {},
    "updated": {"K": 6.44e5, "C_D": 303e3, "e_F": 2.27},
    "corner": {"K": 4.3e5, "C_D": 860e3, "e_F": 2.5},
}


class Second:
    """One second of all outputs at 10 kHz, 0.15 s of settling before it; ``note`` has the error.

    Parameters
    ----------
    point : str
        One of `POINTS`.
    method : str
    """

    def __init__(self, point: str, method: str = "auto"):
        self.stage, self.method = paper(), method
        self.values = self.stage.values(**POINTS[point])
        found = self.run(0.1)
        exact = self.run(0.1, method="DormandPrince54", rtol=1e-8, atol=1e-12).outputs
        kept = [k for k, name in enumerate(self.stage.outputs) if name.startswith("a_")]
        error = np.std((found.outputs - exact)[:, kept], axis=0) / np.std(exact[:, kept], axis=0)
        self.note = f"{found.statistics['method']}, largest error of an acceleration {np.max(error):.0e}"

    def run(self, duration: float, **options: Any) -> Any:
        """Return the run of a duration."""
        given = {"method": self.method, "rate": 10000.0, "parameters": self.values, **options}
        return self.stage.simulate(SPEED, TORQUE, duration, **given)

    def __call__(self) -> None:
        _ = self.run(1.0).outputs


class Rates:
    """Time of one evaluation of the rates along a mesh cycle, the least of 30, s; ``note`` says how many runs take.

    Parameters
    ----------
    stage : GearStage
    """

    def __init__(self, stage: GearStage, count: int = 2000):
        from gearbox.stage.static_equilibrium import moving_state

        system = self.system = stage.system
        self.states = np.tile(moving_state(stage, SPEED, TORQUE), (count, 1))
        turn = np.linspace(0.0, 2.0 * np.pi / stage.pair.teeth_1, count)
        shares = {"drive.angle": 1.0, "input_shaft.spin_angle": 1.0, "output_shaft.spin_angle": -1.0 / stage.pair.ratio}
        for name, share in shares.items():
            self.states[:, system.index("state", name)] += share * turn
        self.inputs = np.tile(system.input_vector({"speed": SPEED * np.pi / 30.0, "torque": TORQUE}), (count, 1))
        self.out, self.times, self.p = np.empty_like(self.states), np.zeros(count), system.p.copy()
        span = 0.1
        taken = stage.simulate(SPEED, TORQUE, span, rate=10000.0, settle=0.05).statistics["nfev"]
        self.note = f"{len(system.states)} states, {round(taken / (span + 0.05), -3):.0f} evaluations per s of motion"

    def __call__(self) -> float:
        import time

        from multibody.solvers.kernels.along import rhs_along

        address, least = self.system.rhs_function.address, float("inf")
        for _ in range(30):
            begun = time.process_time()
            rhs_along(address, self.times, self.states, self.inputs, self.p, self.out)
            least = min(least, time.process_time() - begun)
        return least / self.times.size


@lru_cache(maxsize=1)
def paper() -> GearStage:
    """Return the paper's stage: both gears with six motions, 16 modes of the housing, 58 states."""
    return GearStage.paper()
