"""A stop and a play: laws that bend so far that no small step from the recalibrated model leads to them."""

from __future__ import annotations

import numpy as np
import pytest
from plain_machines import RECORDS, diagnosed, low_passed
from scipy.integrate import solve_ivp

from discrepancy.report.schema import check_diagnosis

MODELS = """
from multibody import Model
from multibody import library as lib


def table():
    m = Model("shaker")
    coil, mass = m.add("coil", lib.ForceSource()), m.add("table", lib.Mass(m=3.0))
    leaf, rubber = m.add("leaf", lib.Spring(stiffness=2000.0)), m.add("rubber", lib.Damper(damping=12.0))
    m.connect(coil.flange, mass.flange, leaf.b, rubber.b)
    m.connect(leaf.a, rubber.a, m.ground)
    m.input("coil.force", coil.force)
    return m


def drive():
    m = Model("two_mass_drive")
    source = m.add("drive", lib.TorqueSource())
    motor, load = m.add("motor", lib.Inertia(J=2e-3)), m.add("load", lib.Inertia(J=8e-3))
    shaft, damper = m.add("shaft", lib.TorsionSpring(stiffness=120.0)), m.add("damper", lib.TorsionDamper(damping=0.03))
    first = m.add("motor_bearing", lib.RotaryViscousFriction(viscous=4e-3))
    second = m.add("load_bearing", lib.RotaryViscousFriction(viscous=1e-2))
    m.connect(source.flange, motor.flange, shaft.a, damper.a, first.b)
    m.connect(shaft.b, damper.b, load.flange, second.b)
    m.connect(first.a, second.a, m.ground)
    m.input("drive.torque", source.torque)
    return m
"""

TABLE = """
[model]
build = "models.py:table"
[uncertain]
"leaf.stiffness" = { std = 60.0 }
"rubber.damping" = { std = 2.0, min = 0.0 }
[inputs]
"coil.force" = "force_N"
[outputs]
"table.position" = "position_mm"
"""

DRIVE = """
[model]
build = "models.py:drive"
[uncertain]
"motor.J" = { std = 6e-5 }
"load.J" = { std = 2.4e-4 }
"shaft.stiffness" = { std = 5.0 }
"damper.damping" = { std = 0.01, min = 0.0 }
"motor_bearing.viscous" = { std = 1e-3, min = 0.0 }
"load_bearing.viscous" = { std = 3e-3, min = 0.0 }
[inputs]
"drive.torque" = "torque_Nm"
[outputs]
"motor.speed" = "motor_rad_per_s"
"load.speed" = "load_rad_per_s"
"""


def table(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """A table on a leaf spring that meets a rubber buffer 18 mm on one side of its middle."""
    t = np.arange(0.0, 5.0, 0.002)
    force = 25.0 * low_passed(rng, t, 6.0) * np.clip(t / 0.3, 0.0, 1.0)

    def rates(s, x):
        return [x[1], (np.interp(s, t, force) - 2030.0 * x[0] - 11.0 * x[1] - 2e4 * max(x[0] - 0.018, 0.0)) / 3.0]

    p, _ = solve_ivp(rates, (0.0, t[-1]), [0.0, 0.0], "LSODA", t, rtol=1e-8, atol=1e-10, max_step=0.002).y
    return {"time_s": t, "force_N": force, "position_mm": np.round(1e3 * p + 5e-3 * rng.standard_normal(t.size), 3)}


def drive(rng: np.random.Generator, duration: float = 6.0) -> dict[str, np.ndarray]:
    """Two rotors with a play of 10 mrad in the spring between them."""
    t = np.arange(0.0, duration, 0.002)
    torque = (1.2 * low_passed(rng, t, 1.5) + 0.3 * low_passed(rng, t, 15.0)) * np.clip(t / 0.3, 0.0, 1.0)

    def rates(s, x):
        twist = x[0] - x[2]
        passed = 117.0 * (twist - np.clip(twist, -0.005, 0.005)) + 0.03 * (x[1] - x[3])
        return [
            x[1],
            (np.interp(s, t, torque) - 4e-3 * x[1] - passed) / 2.05e-3,
            x[3],
            (passed - 1e-2 * x[3]) / 7.9e-3,
        ]

    x = solve_ivp(rates, (0.0, t[-1]), np.zeros(4), "LSODA", t, rtol=1e-8, atol=1e-10, max_step=0.002).y
    noise = 0.03 * rng.standard_normal((2, t.size))
    return {
        "time_s": t,
        "torque_Nm": torque,
        "motor_rad_per_s": np.round(x[1] + noise[0], 3),
        "load_rad_per_s": np.round(x[3] + noise[1], 3),
    }


@pytest.mark.slow
def test_a_buffer_that_a_table_meets_is_found(tmp_path):
    diagnosis = diagnosed(tmp_path, MODELS, table, TABLE + RECORDS, seed=11)
    assert [f"{e['kind']}@{e['where']}" for e in diagnosis["effects"]] == ["end_stop@leaf"]
    values = {k: v["value"] for k, v in diagnosis["effects"][0]["parameters"].items()}
    assert values["stiffness"] == pytest.approx(2e4, rel=0.01)
    assert values["place"] == pytest.approx(0.018, rel=0.01)
    assert diagnosis["explained"] > 0.99


@pytest.mark.slow
def test_play_between_two_rotors_is_found(tmp_path):
    diagnosis = diagnosed(tmp_path, MODELS, drive, DRIVE + RECORDS, seed=11)
    first = diagnosis["effects"][0]
    assert f"{first['kind']}@{first['where']}" == "backlash@shaft"
    assert first["parameters"]["gap"]["value"] == pytest.approx(0.01, rel=0.2)
    assert diagnosis["explained"] > 0.5


def test_play_that_the_catalogue_does_not_have_is_a_force_that_follows_the_twist_of_its_place(tmp_path):
    kinds = '[candidates]\ninclude = ["*_friction@*", "*drag@*", "sensor_*@*"]\n'
    diagnosis = diagnosed(tmp_path, MODELS, drive, DRIVE + RECORDS + kinds, seed=11)
    assert diagnosis["verdict"] == "unknown effect"
    assert check_diagnosis(diagnosis) == []
    assert diagnosis["effects"] == []
    law = diagnosis["unknown_law"]
    assert (law["where"], law["depends_on"], law["announced"]) == ("shaft", ["place.shaft.angle"], True)
    assert "a force at shaft that is a function of the angle of shaft" in diagnosis["sentence"]
    assert diagnosis["probabilities"]["unknown"] > 0.5
