"""The equations compiled by numba, and by the package's own emitter, which compiles the kernels and the SIMD lanes.

Every entry is a process of its own, from its start to its end.  Cold: the cache folder is empty and everything is
compiled.  Warm: an earlier process has filled it.  `VTSDT_COMPILER=emitter` makes the emitter compile the equations as
well; nothing else differs, and the results are the same to the last bit.  Take `--clock cpu`.
"""

from __future__ import annotations

import atexit
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
COMPILERS = {"numba": "numba", "emitter": "the emitter"}
WORKLOADS = {
    "trip": ("the 37-state trip", "from vtsdt.lift.lift import Lift; Lift.reference().trip('up')"),
    "diagnosis": (
        "the diagnosis of the README",
        "import sys; from vtsdt.cli.command_line import main; main(['diagnose', *sys.argv[1:], '--quiet'])",
    ),
    "diagnose_17": (
        "the search in ten 17-state trips, nothing hidden (bench_diagnose_17)",
        "import bench_diagnose_17; bench_diagnose_17.bench_nothing_hidden()",
    ),
    "scan_37": (
        "sensitivities to 100 candidates on a 37-state trip (bench_scan_37)",
        "import bench_scan_37; bench_scan_37.bench_columns()",
    ),
}


def _folder() -> Path:
    folder = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


@cache
def _study() -> Path:
    """The study of the README: recordings of a virtual axis with an effect hidden in it."""
    folder = _folder()
    words = ["bench", "axis", "--hide", "stribeck_friction", "--seed", "7", "--out", str(folder), "--quiet"]
    subprocess.run([sys.executable, "-m", "vtsdt", *words], check=True, stdout=subprocess.DEVNULL)
    return folder / "study.toml"


def _process(workload: str, compiler: str, folder: Path) -> None:
    path = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    around = {**os.environ, "VTSDT_CACHE": str(folder), "VTSDT_COMPILER": compiler, "PYTHONPATH": path}
    given = [str(_study()), "--out", str(_folder())] if workload == "diagnosis" else []
    subprocess.run(
        [sys.executable, "-c", WORKLOADS[workload][1], *given], check=True, env=around, stdout=subprocess.DEVNULL
    )


def _entry(workload: str, compiler: str, warm: bool) -> Callable[[], Any]:
    def prepare() -> Callable[[], None]:
        kept = _folder()
        if warm:
            _process(workload, compiler, kept)

        def work() -> None:
            _process(workload, compiler, kept if warm else _folder())

        return work

    prepare.__doc__ = f"{WORKLOADS[workload][0]}, equations by {COMPILERS[compiler]}, {'warm' if warm else 'cold'}"
    return prepare


globals().update(
    {
        f"bench_{workload}_{compiler}_{'warm' if warm else 'cold'}": _entry(workload, compiler, warm)
        for workload in WORKLOADS
        for warm in (True, False)
        for compiler in COMPILERS
    }
)
