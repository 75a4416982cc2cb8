"""Recordings of machines from plain equations and SciPy, written as CSV, and their diagnosis by the command alone."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
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


def carriage_record(
    rng: np.random.Generator, wind: float, corner: float, unknown: Callable[[float, float], float]
) -> dict[str, np.ndarray]:
    """Return 20 s at 50 Hz of a carriage on a spring, pushed by a recorded force and by what nobody recorded.

    ``unknown`` gives that force, N, from the position, m, and a band-limited wind of so many N up to so many Hz.
    """
    t = np.arange(0.0, 20.0, 0.02)
    force = 20.0 * np.sin(2.0 * np.pi * t / 4.0 + rng.uniform(0.0, 6.0)) + 10.0 * low_passed(rng, t, 1.0)
    blows = wind * low_passed(rng, t, corner)

    def rates(now, y):
        x, v = y
        push = np.interp(now, t, force) + unknown(x, np.interp(now, t, blows))
        return [v, (push - 210.0 * x - 7.5 * v) / 2.05]

    y = solve_ivp(rates, (0.0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-8, atol=1e-10, max_step=0.02).y
    return {
        "time_s": t,
        "force_N": force,
        "position_m": y[0] + 2e-4 * rng.standard_normal(t.size),
        "velocity_m_s": y[1] + 2e-3 * rng.standard_normal(t.size),
    }


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
