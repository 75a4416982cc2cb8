"""A friction that makes most of the motion is found, although a random force would explain the same records.

A rotor behind a gear, driven by its motor's torque in steps.  Nothing is known of inertia and viscous friction, so the
calibration without dry friction is far off, and around it the linearised problem tells little of what friction changes.
"""

from __future__ import annotations

import numpy as np
import pytest
from plain_machines import RECORDS, diagnosed
from scipy.integrate import solve_ivp

MODELS = """
from multibody import Model
from multibody import library as lib


def rotor():
    m = Model("rotor")
    motor = m.add("motor", lib.TorqueSource())
    rotor = m.add("rotor", lib.Inertia(J=1e-2))
    bearing = m.add("bearing", lib.RotaryViscousFriction(viscous=2e-2))
    m.connect(motor.flange, rotor.flange, bearing.b)
    m.connect(bearing.a, m.ground)
    m.input("motor.torque", motor.torque)
    return m
"""

STUDY = """
[model]
build = "models.py:rotor"

[uncertain]
"rotor.J" = { min = 0.0 }
"bearing.viscous" = { min = 0.0 }

[inputs]
"motor.torque" = { column = "torque_Nm", interpolation = "hold" }

[outputs]
"rotor.speed" = "speed_rad_per_s"
"""


def rotor(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return one record: 10 s at 200 Hz, steps of torque, and a friction of 0.15 N·m."""
    t = np.arange(0.0, 10.0, 0.005)
    levels = rng.uniform(-1.0, 1.0, 21)

    def torque(now):
        return levels[int(now / 0.5)]

    def rates(now, y):
        return [(torque(now) - 0.01 * y[0] - 0.15 * np.tanh(y[0] / 0.05)) / 6e-3]

    speed = solve_ivp(rates, (0.0, t[-1]), [0.0], "LSODA", t, rtol=1e-8, atol=1e-10, max_step=0.005).y[0]
    return {
        "time_s": t,
        "torque_Nm": np.array([torque(now) for now in t]),
        "speed_rad_per_s": speed + 0.05 * rng.standard_normal(t.size),
    }


def test_it_is_named_with_its_size(tmp_path):
    diagnosis = diagnosed(tmp_path, MODELS, rotor, STUDY + RECORDS, seed=41)
    first = diagnosis["effects"][0]
    assert f"{first['kind']}@{first['where']}" == "coulomb_friction@bearing"
    (size,) = (v["value"] for k, v in first["parameters"].items() if v["unit"] == "N*m")
    assert size == pytest.approx(0.15, rel=0.02)
    assert len(diagnosis["effects"]) == 1
    assert diagnosis["explained"] > 0.99
