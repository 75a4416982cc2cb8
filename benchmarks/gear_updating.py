"""45 simulations of a design of the gear stage: processor time of one process, and of the design on two.

python benchmarks/gear_updating.py [--housing flexible|rigid] [--count 45] [--processes 2]
"""

from __future__ import annotations

import argparse
import os
import time

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import numpy as np  # noqa: E402

from gearbox.condition import OperatingCondition  # noqa: E402
from gearbox.papers_chain import rig_vibration  # noqa: E402
from gearbox.rig_texts import PARAMETERS  # noqa: E402
from gearbox.updating_runs import ModelSource, Runs  # noqa: E402
from gearbox.virtual import Settings  # noqa: E402
from surrogate import DesignSpace, latin_hypercube  # noqa: E402


def main() -> None:
    """Run the design and print times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--housing", default="flexible", choices=("flexible", "rigid", "clamped"))
    parser.add_argument("--count", type=int, default=45)
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    space = DesignSpace.from_mapping({n: (low, high, u) for n, _, low, high, u in PARAMETERS[:3]})
    base = OperatingCondition(1000.0, 150.0)
    rows = latin_hypercube(space, given.count, seed=1).points
    wanted = [(dict(zip(space.names, x, strict=True)), base) for x in rows.tolist()]
    model = rig_vibration(given.housing)
    begun = time.perf_counter()
    model(wanted[0][0], base, 0.05)
    print(f"first run, compiled code read or made: {time.perf_counter() - begun:.1f} s")
    cpu = []
    for values, condition in wanted[:9]:
        begun = time.process_time()
        model(values, condition, Settings(32).length(condition))
        cpu.append(time.process_time() - begun)
    print(
        f"processor time of a run (0.3 s to settle and 45 ms): {np.mean(cpu):.2f} s mean, {np.max(cpu):.2f} s at most"
    )
    with Runs(ModelSource(rig_vibration, given.housing, "bench"), Settings(32), processes=given.processes) as runs:
        begun = time.perf_counter()
        runs.many(wanted)
        wall = time.perf_counter() - begun
    print(f"{given.count} runs on {given.processes} processes: {wall:.1f} s, the start of the processes included")
    print(f"load of the machine meanwhile: {os.getloadavg()[0]:.1f} on {len(os.sched_getaffinity(0))} processors")


if __name__ == "__main__":
    main()
