"""Recordings of machines from plain equations and SciPy, written as CSV, and their diagnosis by the command alone."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfiltfilt

from vtsdt.cli.command_line import main

RECORDS = """
[records]
time = "time_s"
identify = ["run0.csv", "run1.csv"]
validate = ["run2.csv"]
"""

MOTOR = """
from multibody import Model
from multibody import library as lib


def motor():
    m = Model("motor")
    drive = m.add("motor", lib.DCMotorDrive(R=1.2, L=2e-3, k_t=0.08, inductive=True))
    rotor = m.add("rotor", lib.Inertia(J=4e-4))
    bearing = m.add("bearing", lib.RotaryViscousFriction(viscous=2e-4))
    m.connect(drive.flange, rotor.flange, bearing.b)
    m.connect(bearing.a, m.ground)
    m.input("supply.voltage", drive.voltage)
    return m
"""

#: A study of the motor, to which `RECORDS` is added.
MOTOR_STUDY = """
[model]
build = "models.py:motor"
[uncertain]
"motor.k_t" = { std = 0.002 }
"rotor.J" = { std = 2e-5 }
"bearing.viscous" = { std = 5e-5, min = 0.0 }
"motor.R" = { std = 0.03 }
[inputs]
"supply.voltage" = "voltage_V"
[outputs]
"motor.i" = "current_A"
"rotor.speed" = "speed_rad_per_s"
"rotor.angle" = "angle_rad"
"""

CARRIAGE = """
from multibody import Model
from multibody import library as lib


def carriage():
    m = Model("carriage")
    mass = m.add("carriage", lib.Mass(m=2.0))
    spring = m.add("spring", lib.SpringDamper(stiffness=200.0, damping=8.0))
    push = m.add("push", lib.ForceSource())
    m.connect(mass.flange, spring.b, push.flange)
    m.connect(spring.a, m.ground)
    m.input("push.force", push.force)
    return m
"""

#: A study of the carriage, to which `RECORDS` is added.
CARRIAGE_STUDY = """
[model]
build = "models.py:carriage"

[uncertain]
"carriage.m" = { value = 2.0, std = 0.1, min = 0.0 }
"spring.stiffness" = { value = 200.0, std = 20.0, min = 0.0 }
"spring.damping" = { value = 8.0, std = 2.0, min = 0.0 }

[inputs]
"push.force" = { column = "force_N" }

[outputs]
"carriage.position" = { column = "position_m", noise = 2e-4 }
"carriage.velocity" = { column = "velocity_m_s", noise = 2e-3 }
"""

Machine = Callable[[np.random.Generator], dict[str, np.ndarray]]


def low_passed(rng: np.random.Generator, t: np.ndarray, corner: float) -> np.ndarray:
    """Return band-limited noise of deviation one."""
    x = sosfiltfilt(butter(3, corner * 2.0 * (t[1] - t[0]), output="sos"), rng.standard_normal(t.size))
    return x / x.std()


def written(folder: Path, models: str, machine: Machine, study: str, seed: int, records: int = 3) -> Path:
    """Write so many recordings of a machine, the models and a study; return the study's file."""
    for k in range(records):
        columns = machine(np.random.default_rng([seed, k]))
        table = np.column_stack(list(columns.values()))
        np.savetxt(folder / f"run{k}.csv", table, fmt="%.7g", delimiter=",", header=",".join(columns), comments="")
    (folder / "models.py").write_text(models)
    (folder / "study.toml").write_text(study)
    return folder / "study.toml"


def diagnosed(folder: Path, models: str, machine: Machine, study: str, seed: int, records: int = 3) -> dict:
    """Write recordings, models and a study; run the command; return diagnosis.json."""
    file = written(folder, models, machine, study, seed, records)
    assert main(["diagnose", str(file), "--out", str(folder / "out"), "--quiet"]) == 0
    return json.loads((folder / "out" / "diagnosis.json").read_text())
