"""A belt that creeps over its pulley is named where the model holds the ratio; where it does hold, no slip is named.

A carriage on a belt, driven by a recorded motor torque; the speeds of motor and carriage are measured.  The belt of the
machine transmits what its slip asks for, up to a limit that the model of slip does not have.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from plain_machines import RECORDS, diagnosed, low_passed
from scipy.integrate import solve_ivp

J, M, R, VISCOUS = 0.0052, 4.1, 0.05, 21.0
LIMIT = 150.0  # N, three times what usually acts

BELT = """
from multibody import Model
from multibody import library as lib


def belt():
    m = Model("belt")
    motor = m.add("motor", lib.Inertia(J=0.005))
    drive = m.add("drive", lib.TorqueSource())
    pulley = m.add("pulley", lib.Rack(radius=0.05))
    carriage = m.add("carriage", lib.Mass(m=4.0))
    guide = m.add("guide", lib.ViscousFriction(viscous=20.0))
    tacho = m.add("tacho", lib.SpeedSensor())
    scale = m.add("scale", lib.VelocitySensor())
    m.connect(drive.flange, motor.flange, tacho.flange, pulley.a)
    m.connect(pulley.b, carriage.flange, guide.b, scale.flange)
    m.connect(guide.a, m.ground)
    m.input("drive.torque", drive.torque)
    return m
"""

STUDY = """
[model]
build = "models.py:belt"

[uncertain]
"motor.J" = { std = 3e-4 }
"carriage.m" = { std = 0.2 }
"pulley.radius" = { std = 2e-4 }
"guide.viscous" = { std = 2.0, min = 0.0 }

[inputs]
"drive.torque" = "torque_Nm"

[outputs]
"tacho.speed" = { column = "motor_rad_s", noise = 0.05 }
"scale.velocity" = { column = "carriage_m_s", noise = 2e-3 }
"""


def belt(rng: np.random.Generator, creep: float) -> dict[str, np.ndarray]:
    """Return one record of the machine, from rest: 12 s at 100 Hz, a disturbance of 0.1 N at the carriage included."""
    t = np.arange(0.0, 12.0, 0.01)
    ramp = np.minimum(t / 0.5, 1.0)
    torque = ramp * (1.6 * np.sin(2.0 * np.pi * t / 3.0 + rng.uniform(0.0, 6.0)) + 0.8 * low_passed(rng, t, 0.5))
    wind = 0.1 * low_passed(rng, t, 2.0)

    def transmitted(u: float, v: float) -> float:
        relative = (u - v) / np.sqrt(0.25 * (u + v) ** 2 + 0.01**2)
        return LIMIT * np.tanh(relative / (creep * LIMIT))

    def rates(now, y):
        w, v = y
        force = transmitted(R * w, v)
        return [
            (np.interp(now, t, torque) - R * force) / J,
            (force + np.interp(now, t, wind) - VISCOUS * v) / M,
        ]

    y = solve_ivp(rates, (0.0, t[-1]), [0.0, 0.0], t_eval=t, method="LSODA", rtol=1e-7, atol=1e-9, max_step=0.01).y
    return {
        "time_s": t,
        "torque_Nm": torque,
        "motor_rad_s": y[0] + 0.05 * rng.standard_normal(t.size),
        "carriage_m_s": y[1] + 2e-3 * rng.standard_normal(t.size),
    }


def test_slip_is_named_with_its_size(tmp_path) -> None:
    creep = 4e-4
    answer = diagnosed(tmp_path, BELT, partial(belt, creep=creep), STUDY + RECORDS, seed=31)
    assert [(e["kind"], e["where"]) for e in answer["effects"]] == [("slip", "pulley")]
    found = answer["effects"][0]["parameters"]["creep"]
    assert found["unit"] == "1/N"
    assert answer["effects"][0]["fixed"] == {"v_s": 0.01}
    assert found["value"] == pytest.approx(creep, rel=0.1)  # a third of the limit costs 4 % of the traction (tanh)
    last, first = answer["stages"][-1]["validate"], answer["stages"][1]["validate"]
    assert last["tacho.speed"]["rmse"] < 0.7 * first["tacho.speed"]["rmse"]
    assert last["scale.velocity"]["rmse"] < first["scale.velocity"]["rmse"]


def test_no_slip_is_named_where_the_belt_holds(tmp_path) -> None:
    answer = diagnosed(tmp_path, BELT, partial(belt, creep=1e-7), STUDY + RECORDS, seed=32)
    assert answer["verdict"] == "nothing missing"
