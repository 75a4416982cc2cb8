"""How long the gear stage takes, and how that grows with modes, slices and teeth: ratios within one run.

``python benchmarks/gear_stage.py [--quick]`` prints a table.  Times are CPU time, the least of several repeats.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
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
        again = least(lambda p=p: paper.simulate(1000.0, TORQUE, 1.0, rate=10000.0, parameters=p).outputs, 1)
        rows.append((f"1 s of signal, {values}", f"{again:.3f} s", f"{again / took:.2f}"))
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
