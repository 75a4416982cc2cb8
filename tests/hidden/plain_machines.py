"""Recordings of machines from plain equations and SciPy, written as CSV, and their diagnosis by the command alone."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfiltfilt

from vtsdt.cli import main

RECORDS = """
[records]
time = "time_s"
identify = ["run0.csv", "run1.csv"]
validate = ["run2.csv"]
"""

Machine = Callable[[np.random.Generator], dict[str, np.ndarray]]


def low_passed(rng: np.random.Generator, t: np.ndarray, corner: float) -> np.ndarray:
    """Return band-limited noise of deviation one."""
    x = sosfiltfilt(butter(3, corner * 2.0 * (t[1] - t[0]), output="sos"), rng.standard_normal(t.size))
    return x / x.std()


def diagnosed(folder: Path, models: str, machine: Machine, study: str, seed: int) -> dict:
    """Write three recordings of a machine, the models and a study; run the command; return diagnosis.json."""
    for k in range(3):
        columns = machine(np.random.default_rng([seed, k]))
        table = np.column_stack(list(columns.values()))
        np.savetxt(folder / f"run{k}.csv", table, fmt="%.7g", delimiter=",", header=",".join(columns), comments="")
    (folder / "models.py").write_text(models)
    (folder / "study.toml").write_text(study)
    assert main(["diagnose", str(folder / "study.toml"), "--out", str(folder / "out"), "--quiet"]) == 0
    return json.loads((folder / "out" / "diagnosis.json").read_text())
