"""Many cases: written, diagnosed each in a process of its own with limits, scored, and gathered in ``results.csv``."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from discrepancy.validation.machines.case import Case, CaseError, draw, write
from discrepancy.validation.machines.evidence_of_truth import FITTED_ALONE, evidence_of_truth, study_with_truth_alone
from discrepancy.validation.machines.fleet import machine_named
from discrepancy.validation.machines.judge import Score, judged

__all__ = ["COLUMNS", "Limits", "cases", "run_cases"]

COLUMNS = (
    "case",
    "machine",
    "what",
    "category",
    "nats",
    "evidence",
    "seed",
    "final",
    "answer",
    "right",
    "first",
    "in_set",
    "set_size",
    "invented",
    "confident_wrong",
    "unknown",
    "worse",
    "held_out",
    "processor_s",
    "peak_MB",
    "hidden",
    "named",
    "statements",
    "code",
)


@dataclass(frozen=True)
class Limits:
    """What a diagnosis may take.

    Parameters
    ----------
    seconds : float
        Of processor time; twice as many by the clock.  Ten times the bar of 60 s, so that a slow case shows its figure.
    megabytes : float
        Of data.  Above the bar of 1500, for the same reason.
    """

    seconds: float = 600.0
    megabytes: float = 6000.0


def cases(
    machines: Iterable[str], what: Iterable[str], nats: Iterable[float], trials: int, *, final: bool = False
) -> list[Case]:
    """Return the cases of a plan; "nothing" has no nats, and as many seeds as there are nats and trials."""
    nats = list(nats)
    plan: list[Case] = []
    for name in machines:
        for each in what:
            if each == "nothing":
                plan += [
                    Case(machine=name, what=each, nats=0.0, seed=seed, final=final)
                    for seed in range(trials * len(nats))
                ]
            else:
                plan += [
                    Case(machine=name, what=each, nats=float(n), seed=seed, final=final)
                    for seed in range(trials)
                    for n in nats
                ]
    return plan


def run_cases(
    plan: Sequence[Case],
    out: Path,
    *,
    code: str,
    limits: Limits | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> list[dict[str, str]]:
    """Run the cases that ``results.csv`` in a folder does not have yet, and return all rows.

    Parameters
    ----------
    plan : sequence of Case
    out : Path
        Folder of ``results.csv`` and of one folder for each case.
    code : str
        Hash of the code, for the rows.
    limits : Limits, optional
    progress : callable, optional
        Called with one line for each case.
    """
    out.mkdir(parents=True, exist_ok=True)
    path = out / "results.csv"
    rows = _read_results(path)
    known = {row["case"] for row in rows}
    left = [case for case in plan if case.name not in known]
    with path.open("a", newline="") as stream:
        writer = csv.DictWriter(stream, COLUMNS)
        if not rows:
            writer.writeheader()
        for count, case in enumerate(left, 1):
            row = {key: str(value) for key, value in _run(case, out / case.name, limits or Limits(), code).items()}
            writer.writerow(row)
            stream.flush()
            rows.append({key: row.get(key, "") for key in COLUMNS})
            progress(
                f"{count}/{len(left)} {case.name}: {row['answer']}, named {row.get('named') or 'nothing'}, "
                f"right {row.get('right', '-')} ({row.get('processor_s', '-')} s, {row.get('peak_MB', '-')} MB)"
            )
    return rows


def _read_results(path: Path) -> list[dict[str, str]]:
    """Return the rows of a ``results.csv``; none where there is no file yet."""
    if not path.exists():
        return []
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def _run(case: Case, folder: Path, limits: Limits, code: str) -> dict[str, Any]:
    head = {
        "case": case.name,
        "machine": case.machine,
        "what": case.what,
        "nats": f"{case.nats:g}",
        "seed": case.seed,
        "final": int(case.final),
        "code": code,
    }
    try:
        study = write(draw(case, machine_named(case.machine)), folder)
    except CaseError as error:
        return {**head, "category": "", "answer": f"no case: {error}"}
    truth = json.loads((folder / "truth.json").read_text())
    head |= {"category": truth["category"], "hidden": " + ".join(e["name"] for e in truth["effects"])}
    answer, seconds, megabytes = _diagnosed(study, folder / "out", limits)
    head |= {"processor_s": f"{seconds:.1f}", "peak_MB": f"{megabytes:.0f}"}
    if answer is None:
        return {**head, "answer": "none", "right": 0, "first": 0, "in_set": 0, "invented": 0, "worse": 0, "unknown": 0}
    if truth["category"] == "single":
        head["evidence"] = _evidence_of_truth(folder, limits)
    return {**head, "answer": answer["verdict"], **_columns(judged(truth, answer))}


def _evidence_of_truth(folder: Path, limits: Limits) -> str:
    """Return by how many nats the records are for the truth; where the search did not try it, it is tried alone."""
    evidence = evidence_of_truth(folder)
    if evidence is None:
        listed = [sys.executable, "-m", "vtsdt", "catalogue", str(folder / "study.toml"), "--names"]
        names = subprocess.run(listed, check=True, capture_output=True, text=True).stdout.split()
        study = study_with_truth_alone(folder, names)
        if study is not None:
            _diagnosed(study, folder / FITTED_ALONE, limits)
            evidence = evidence_of_truth(folder)
    return "" if evidence is None else f"{evidence:.1f}"


def _columns(score: Score) -> dict[str, Any]:
    flags = ("right", "first", "in_set", "confident_wrong", "unknown", "worse")
    return {
        **{name: int(getattr(score, name)) for name in flags},
        "set_size": f"{score.set_size:g}",
        "invented": score.invented,
        "held_out": f"{score.held_out:.4g}",
        "named": " + ".join(score.named),
        "statements": json.dumps([[s.said, round(s.probability, 4), int(s.true)] for s in score.statements]),
    }


def _diagnosed(study: Path, out: Path, limits: Limits) -> tuple[dict[str, Any] | None, float, float]:
    """Diagnose a study in a process of its own; return the answer (None: there is none), seconds and megabytes."""

    def limited() -> None:
        import resource

        resource.setrlimit(resource.RLIMIT_CPU, (int(limits.seconds), int(limits.seconds) + 5))
        size = int(limits.megabytes * 2**20)
        resource.setrlimit(resource.RLIMIT_DATA, (size, size))

    out.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "vtsdt", "diagnose", str(study), "--out", str(out), "--quiet"]
    with (out / "log.txt").open("w") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log, preexec_fn=limited)
        ends = time.monotonic() + 2.0 * limits.seconds
        while True:
            done, _, usage = os.wait4(process.pid, os.WNOHANG)
            if done:
                break
            if time.monotonic() > ends:
                process.send_signal(signal.SIGKILL)
                ends = float("inf")
            time.sleep(0.1)
    process.returncode = 0  # it has been waited for
    unit = 2.0**20 if sys.platform == "darwin" else 2.0**10
    answer = out / "diagnosis.json"
    diagnosis = json.loads(answer.read_text()) if answer.is_file() else None
    return diagnosis, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / unit
