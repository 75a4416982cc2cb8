"""Diagnoses of the machines that others have recorded: what each found, how probable it is, what it predicts; the page.

``VTSDT_DATA=/path/to/data python benchmarks/real_machines.py [--only emps,pendulum] [--keep FILE] [--out FOLDER]``, with
``--page docs/benchmarks/real-machines.md`` to write the page
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from run import machine

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "examples"

#: Studies under ``examples`` without ``.toml``: the machine, and the initial model.
STUDIES: dict[str, tuple[str, str]] = {
    "torque_limited_pendulum/study": ("torque-limited pendulum", "viscous friction only"),
    "quanser_qube/study": ("rotary pendulum, balanced", "viscous friction only"),
    "emps/study": ("EMPS axis", "the same friction in both directions"),
    "emps/viscous_only": ("EMPS axis", "viscous friction only"),
    "lead_screw/study": ("lead screw", "viscous friction only"),
    "pendulum/study": ("pendulum, large swings fitted", "viscous friction only"),
    "pendulum/small_swings": ("pendulum, small swings fitted", "viscous friction only"),
}


@dataclass(frozen=True, kw_only=True)
class Run:
    """A diagnosis that ended.

    Parameters
    ----------
    processor, wall : float, s
    peak : float, bytes
        Largest resident memory.
    code : int
        Exit code.
    commit, date : str
        Of the program, and when it was run.
    diagnosis : dict, optional
        Its ``diagnosis.json``, without what the page does not need.
    """

    processor: float
    wall: float
    peak: float
    code: int
    commit: str
    date: str
    diagnosis: dict[str, Any] | None


def diagnosed(study: str, out: Path) -> Run:
    """Diagnose a study in a process of its own, whose progress is shown."""
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    words = [sys.executable, "-m", "vtsdt", "diagnose", str(EXAMPLES / f"{study}.toml"), "--out", str(out)]
    begun = time.monotonic()
    run = subprocess.Popen(words, env={**os.environ, "PYTHONPATH": path}, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(run.pid, 0)
    run.returncode = os.waitstatus_to_exitcode(status)
    written = out / "diagnosis.json"
    return Run(
        processor=used.ru_utime + used.ru_stime,
        wall=time.monotonic() - begun,
        peak=1024.0 * used.ru_maxrss,
        code=run.returncode,
        commit=_commit(),
        date=time.strftime("%Y-%m-%d"),
        diagnosis=needed(json.loads(written.read_text(encoding="utf-8"))) if written.exists() else None,
    )


def needed(diagnosis: dict[str, Any]) -> dict[str, Any]:
    """Return the entries of a ``diagnosis.json`` that the page shows."""
    names = (
        *("verdict", "sentence", "effects", "stages", "explained_on", "probabilities", "predictive_gain"),
        *("predictive_checks", "checks", "disturbance", "unknown_law", "parameters", "units", "residual", "warnings"),
    )
    return {name: diagnosis[name] for name in names if name in diagnosis}


def _commit() -> str:
    words = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
    return subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip() or "unknown"


def main() -> int:
    """Diagnose what is not in the file of results yet, and write the page."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", help=f"studies, separated by commas, of: {', '.join(STUDIES)}")
    parser.add_argument("--keep", type=Path, help="file of results: what is in it is not diagnosed again")
    parser.add_argument("--out", type=Path, help="folder for the reports")
    parser.add_argument("--page", type=Path)
    given = parser.parse_args()
    kept: dict[str, Run] = {}
    if given.keep and given.keep.exists():
        for line in given.keep.read_text(encoding="utf-8").splitlines():
            study, entry = json.loads(line)
            kept[study] = Run(**entry)
    asked = given.only.split(",") if given.only else [*STUDIES]
    if unknown := [study for study in asked if study not in STUDIES]:
        parser.error(f"no study {', '.join(unknown)}; there are: {', '.join(STUDIES)}")
    with tempfile.TemporaryDirectory() as temporary:
        for study in asked:
            if study in kept:
                continue
            print(f"=== {study}", flush=True)
            run = kept[study] = diagnosed(study, (given.out or Path(temporary)) / study)
            if given.keep:
                with given.keep.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps([study, asdict(run)]) + "\n")
    if given.page:
        given.page.write_text(page({study: kept[study] for study in STUDIES if study in kept}), encoding="utf-8")
    return 1 if any(run.code for run in kept.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
