"""How long the gear stage takes, and how that grows with modes, slices and teeth: ratios within one run.

``python benchmarks/gear_stage.py [--quick]`` prints a table.  Times are CPU time, the least of several repeats.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from gearbox.box import box_modes
from gearbox.parameters import StageParameters
from gearbox.stage import Stage, Structure

TORQUE = 150.0


def least(work: Callable[[], Any], repeats: int) -> float:
    """Return the least CPU time of several calls, s."""
    found = []
    for _ in range(repeats):
        begun = time.process_time()
        work()
        found.append(time.process_time() - begun)
    return min(found)


def rate_time(stage: Stage, repeats: int = 30) -> float:
    """Return the time of one evaluation of the rates along a mesh cycle, s."""
    from gearbox.running import moving_state
    from multibody.native import load_driver

    system = stage.system
    n = 2000
    states = np.tile(moving_state(stage, 1000.0, TORQUE), (n, 1))
    turn = np.linspace(0.0, 2.0 * np.pi / stage.pair.teeth_1, n)
    shares = {"drive.angle": 1.0, "input_shaft.spin_angle": 1.0, "output_shaft.spin_angle": -1.0 / stage.pair.ratio}
    for name, share in shares.items():
        states[:, system.index("state", name)] += share * turn
    inputs = np.tile(system.input_vector({"speed": 104.7, "torque": TORQUE}), (n, 1))
    out = np.empty_like(states)
    along = load_driver("multibody.solvers.kernels.along")
    p = system.p.copy()
    return least(lambda: along.rhs_along(system.rhs_function.address, np.zeros(n), states, inputs, p, out), repeats) / n


def second_of_signal(
    stage: Stage, values: dict[str, float], p: dict[str, float], method: str, base: float
) -> tuple[str, str, str]:
    """Return the row of 1 s of signal by a method, with its error against a run at tight tolerance."""
    run: Callable[..., Any] = partial(stage.simulate, 1000.0, TORQUE, rate=10000.0, parameters=p)
    spent = least(lambda: run(1.0, method=method).outputs, 1 if method == "Rodas5P" else 2)
    kept = [k for k, name in enumerate(stage.outputs) if name.startswith("a_")]
    exact = run(0.2, method="DormandPrince54", rtol=1e-8, atol=1e-12).outputs[:, kept]
    here = run(0.2, method=method)
    error = float(np.max(np.std(here.outputs[:, kept] - exact, axis=0) / np.std(exact, axis=0)))
    told = f"{spent / base:.2f}; {here.statistics['method']}, error of the accelerations {error:.0e}"
    return f"1 s of signal, {values}, {method}", f"{spent:.3f} s", told


def one_of_design(values: dict[str, float]) -> float:
    """Run one simulation of a design as the updating chain does, and return its CPU time, s."""
    from gearbox.condition import OperatingCondition
    from gearbox.vibrating import build

    begun = time.process_time()
    condition = OperatingCondition(1000.0, TORQUE, "base")
    shared = _stage.setdefault("stage", build())
    shared.vibration(values, condition, 24.0 / condition.mesh_frequency(32))
    return time.process_time() - begun


_stage: dict[str, Any] = {}


def design() -> tuple[str, str, str]:
    """Return the row of the 45 simulations of a design in two processes."""
    from concurrent.futures import ProcessPoolExecutor

    from scipy.stats import qmc

    unit = qmc.LatinHypercube(3, seed=0).random(45)
    low, high = np.array([4.3e5, 86e3, 1.5]), np.array([12.9e5, 860e3, 2.5])
    plan = [dict(zip(("K", "C_D", "e_F"), map(float, low + u * (high - low)), strict=True)) for u in unit]
    begun = time.perf_counter()
    with ProcessPoolExecutor(2) as pool:
        spent = sum(pool.map(one_of_design, plan))
    return "45 simulations of a design, 2 processes", f"{time.perf_counter() - begun:.1f} s", f"{spent:.1f} s of CPU"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="leave out what has to be compiled first")
    quick = parser.parse_args().quick
    paper = Stage.paper()
    paper.simulate(1000.0, TORQUE, 0.01)
    run = paper.simulate(1000.0, TORQUE, 1.0, rate=10000.0)
    took = least(lambda: paper.simulate(1000.0, TORQUE, 1.0, rate=10000.0).outputs, 3)
    base = rate_time(paper)
    rows = [
        ("1 s of signal, Table 2, 58 states, 16 modes", f"{took:.3f} s", f"{run.statistics['nfev']} evaluations"),
        ("one evaluation of the rates", f"{1e6 * base:.2f} us", "1.00"),
    ]
    for values in ({"C_D": 303e3, "e_F": 2.27, "K": 6.44e5}, {"C_D": 860e3, "e_F": 2.5, "K": 4.3e5}):
        p = paper.values(**values)
        for method in ("auto", "DormandPrince54") if quick else ("auto", "DormandPrince54", "Rodas5P"):
            rows.append(second_of_signal(paper, values, p, method, took))
    rows.append(design())
    if not quick:
        gears = {"teeth_1": 64.0, "teeth_2": 88.0, "module": 1.75e-3}
        other: list[tuple[str, Stage]] = [
            ("clamped housing, no modes", Stage.paper(housing="clamped")),
            ("8 modes", Stage.paper(modes=box_modes().first(8))),
            ("64/88 teeth of half the module", Stage(StageParameters.paper().replaced("gears", **gears))),
            ("16 fixed slices", Stage(structure=Structure(slices=16))),
            ("31 fixed slices", Stage(structure=Structure(slices=31))),
            ("62 fixed slices", Stage(structure=Structure(slices=62))),
            ("imperfect=True, bearing_defects=True", Stage.paper(imperfect=True, bearing_defects=True)),
        ]
        for name, stage in other:
            each = rate_time(stage)
            count = stage.simulate(1000.0, TORQUE, 0.2, rate=10000.0).statistics["nfev"]
            told = f"{each / base:.2f}, {count / 0.35:.0f} evaluations per s of motion"
            rows.append((name, f"{1e6 * each:.2f} us", told))
        count = paper.simulate(1000.0, TORQUE, 0.2, rate=10000.0).statistics["nfev"]
        rows.append(("moving line, 32/44 teeth, 16 modes", f"{1e6 * base:.2f} us", f"1.00, {count / 0.35:.0f}"))
    width = max(len(r[0]) for r in rows)
    print("\n".join(f"{a:<{width}}  {b:>12}  {c}" for a, b, c in rows))


if __name__ == "__main__":
    main()
