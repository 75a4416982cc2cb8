"""The equations compiled by numba, and by the package's own emitter: four workloads, cold and warm.

Every measurement is a process of its own, from its start to its end.  Cold: the cache folder is empty and everything is
compiled.  Warm: the same again in the folder that it left.  ``VTSDT_COMPILER=emitter`` makes the emitter compile the
equations too; nothing else differs, and the results are the same to the last bit.  Processor time of all threads is
measured, because other programs may run; the load average stands beside it.

    python benchmarks/compilers.py [--rounds 3] [--only trip] [--keep FILE] [--write-docs]

A file that is kept holds every measurement; a run that was broken off goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import statistics
import subprocess
import sys
import tempfile
import time
from datetime import date
from pathlib import Path
from typing import Any

from run import LINEAR_ALGEBRA, machine

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "docs" / "benchmarks" / "compilers.md"
COMPILERS = ("emitter", "numba")
STATES = ("cold", "warm")
WORKLOADS = {
    "trip": ("a trip of the 37-state lift", "from vtsdt.lift.lift import Lift; Lift.reference().trip('up')"),
    "diagnosis": (
        "the README's diagnosis",
        "import sys; from vtsdt.cli.command_line import main; main(['diagnose', *sys.argv[1:], '--quiet'])",
    ),
    "diagnose_17": (
        "the search in ten 17-state trips, nothing hidden (`bench_diagnose_17`)",
        "import bench_diagnose_17; bench_diagnose_17.bench_nothing_hidden()",
    ),
    "scan_37": (
        "sensitivities to 100 candidates on a 37-state trip (`bench_scan_37`)",
        "import bench_scan_37; bench_scan_37.bench_columns()",
    ),
}


def study(folder: Path) -> Path:
    """Write the study of the README, recordings of a virtual axis with an effect hidden in it, and return its path."""
    words = ["bench", "axis", "--hide", "stribeck_friction", "--seed", "7", "--out", str(folder), "--quiet"]
    subprocess.run([sys.executable, "-m", "vtsdt", *words], check=True, stdout=subprocess.DEVNULL)
    return folder / "study.toml"


def measured(workload: str, compiler: str, cache: Path, arguments: list[str]) -> dict[str, float]:
    """Run a workload in a process; return its processor and wall-clock time, s, and the load before and after."""
    path = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    around = {**os.environ, "VTSDT_CACHE": str(cache), "VTSDT_COMPILER": compiler, "PYTHONPATH": path}
    around |= {name: os.environ.get(name, "1") for name in LINEAR_ALGEBRA}
    load, begun, before = os.getloadavg()[0], time.perf_counter(), os.times()
    command = [sys.executable, "-c", WORKLOADS[workload][1], *arguments]
    subprocess.run(command, check=True, env=around, stdout=subprocess.DEVNULL)
    after = os.times()
    processor = after.children_user + after.children_system - before.children_user - before.children_system
    wall = time.perf_counter() - begun
    return {"processor": processor, "wall": wall, "load_before": load, "load_after": os.getloadavg()[0]}


def measure(rounds: int, only: str, keep: Path | None) -> list[dict[str, Any]]:
    """Measure every workload in turns, the compilers in random order, and return a row for each process."""
    rows: list[dict[str, Any]] = []
    if keep is not None and keep.exists():
        rows = json.loads(keep.read_text(encoding="utf-8"))
    done = {(r["round"], r["workload"], r["compiler"], r["state"]) for r in rows}
    rng = random.Random(0)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        example = study(folder / "study")
        for k in range(rounds):
            for workload in [name for name in WORKLOADS if only in ("", name)]:
                for compiler in rng.sample(COMPILERS, len(COMPILERS)):
                    if (k, workload, compiler, "warm") in done:
                        continue
                    rows = [r for r in rows if (r["round"], r["workload"], r["compiler"]) != (k, workload, compiler)]
                    cache = folder / f"{k}-{workload}-{compiler}"
                    for state in STATES:
                        out = folder / f"{k}-{compiler}-{state}"
                        arguments = [str(example), "--out", str(out)] if workload == "diagnosis" else []
                        figures = measured(workload, compiler, cache, arguments)
                        rows.append({"round": k, "workload": workload, "compiler": compiler, "state": state, **figures})
                        print(f"{workload}, {compiler}, {state}: {figures['processor']:.1f} s", flush=True)
                    if keep is not None:
                        keep.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    return rows


def times(rows: list[dict[str, Any]], workload: str, compiler: str, state: str) -> dict[int, float]:
    """Return the processor time of one kind of process in each round, s."""
    wanted = (workload, compiler, state)
    return {r["round"]: r["processor"] for r in rows if (r["workload"], r["compiler"], r["state"]) == wanted}


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Return the lines of a table: medians of the processor time, s, and of the ratio within a round."""
    lines = [
        "| | rounds | emitter, cold | numba, cold | ratio | emitter, warm | numba, warm | ratio |",
        "|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for workload, (what, _) in WORKLOADS.items():
        cells = []
        for state in STATES:
            emitter, numba = (times(rows, workload, compiler, state) for compiler in COMPILERS)
            both = sorted(emitter.keys() & numba.keys())
            if not both:
                break
            ratio = statistics.median(numba[k] / emitter[k] for k in both)
            cells += [f"{statistics.median(t[k] for k in both):.1f}" for t in (emitter, numba)] + [f"{ratio:.2f}"]
        else:
            lines.append(f"| {what} | {len(both)} | {' | '.join(cells)} |")
    return lines


def page(rows: list[dict[str, Any]]) -> str:
    """Return the text of the page."""
    loads = [r[key] for r in rows for key in ("load_before", "load_after")]
    return "\n".join(
        [
            "# The two compilers",
            "",
            "numba compiles the equations; an emitter of the package compiles kernels and lanes, and could compile the",
            "equations too. Processor time of whole processes, s, with an empty cache (cold) and with what that",
            "process left in it (warm); the ratio is numba's time over the emitter's, taken within a round. What",
            "follows from it: [what compiles what](../howto/speed.md#what-compiles-what).",
            "",
            *table(rows),
            "",
            f"Measured {date.today().isoformat()} on {machine()}. The load average lay between {min(loads):.1f} and "
            f"{max(loads):.1f} (median {statistics.median(loads):.1f}) on {os.cpu_count()} cores, because other "
            "programs ran: that makes all times larger, and ratios count.",
            "",
            "`python benchmarks/compilers.py --write-docs` measures again and writes this page.",
            "",
        ]
    )


def main() -> int:
    """Command line: see the module's text."""
    parser = argparse.ArgumentParser(prog="benchmarks/compilers.py", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3, help="(%(default)s)")
    parser.add_argument("--only", default="", choices=("", *WORKLOADS), help="one workload")
    parser.add_argument("--keep", type=Path, help="file of all measurements; what it holds is not measured again")
    parser.add_argument("--write-docs", action="store_true", help=f"write docs/benchmarks/{PAGE.name}")
    options = parser.parse_args()
    rows = measure(options.rounds, options.only, options.keep)
    print("\n".join(table(rows)))
    if options.write_docs:
        PAGE.write_text(page(rows), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
