"""Machines whose recordings come from plain equations and SciPy, diagnosed through files and the command alone."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from plain_machines import MOTOR, MOTOR_STUDY, RECORDS, diagnosed, low_passed
from scipy.integrate import solve_ivp

MODELS = (
    MOTOR
    + """

def car():
    m = Model("quarter_car")
    road = m.add("road", lib.PositionSource())
    tyre = m.add("tyre", lib.SpringDamper(stiffness=1.8e5, damping=300.0))
    wheel = m.add("wheel", lib.Mass(m=35.0))
    strut = m.add("strut", lib.SpringDamper(stiffness=1.8e4, damping=1400.0))
    body = m.add("body", lib.Mass(m=320.0))
    above, below = m.add("above", lib.AccelerationSensor()), m.add("below", lib.AccelerationSensor())
    m.connect(road.flange, tyre.a)
    m.connect(tyre.b, wheel.flange, strut.a, below.flange)
    m.connect(strut.b, body.flange, above.flange)
    for name in ("position", "velocity", "acceleration"):
        m.input(f"road.{name}", f"road.{name}")
    return m
"""
)

CAR = """
[model]
build = "models.py:car"
[uncertain]
"strut.stiffness" = { std = 600.0 }
"strut.damping" = { std = 100.0 }
"body.m" = { std = 5.0 }
[inputs]
"road.position" = "road_mm"
"road.velocity" = "road_m_per_s"
"road.acceleration" = "road_m_per_s2"
[outputs]
"above.acceleration" = "body_m_per_s2"
"below.acceleration" = "wheel_m_per_s2"
"""


def fan(rng: np.random.Generator, drag: float) -> dict[str, np.ndarray]:
    """A fan in air that the model does not know of; its angle is recorded over hundreds of turns."""
    t = np.arange(0.0, 10.0, 0.005)
    u = np.interp(t, np.linspace(0.0, 10.0, 12), rng.uniform(-18.0, 24.0, 12))
    R, L, k, J, b = 1.2, 2e-3, 0.0795, 4.1e-4, 2e-4

    def rates(s, x):
        i, w, _ = x
        return [(np.interp(s, t, u) - R * i - k * w) / L, (k * i - b * w - drag * w * abs(w)) / J, w]

    i, w, a = solve_ivp(rates, (0.0, t[-1]), [0.0, 0.0, 0.0], "LSODA", t, rtol=1e-8, atol=1e-9, max_step=0.01).y
    noise = rng.standard_normal((3, t.size))
    return {
        "time_s": t,
        "voltage_V": u,
        "current_A": np.round(i + 0.01 * noise[0], 3),
        "speed_rad_per_s": np.round(w + 0.15 * noise[1], 2),
        "angle_rad": np.round(a + 1e-3 * noise[2], 4),
    }


def car(rng: np.random.Generator, rebound: float) -> dict[str, np.ndarray]:
    """A quarter of a car whose shock absorber damps more when it is pulled out."""
    dt = 0.004
    t = np.arange(0.0, 10.0, dt)
    rise = np.clip(t / 0.5, 0.0, 1.0)
    z = (0.012 * low_passed(rng, t, 2.0) + 0.002 * low_passed(rng, t, 12.0)) * rise**2 * (3.0 - 2.0 * rise)
    rate = np.gradient(z, dt)
    kt, ct, mw, ks, cs, mb = 1.8e5, 300.0, 35.0, 1.76e4, 1430.0, 323.0

    def forces(x, height, speed):
        zw, vw, zb, vb = x
        pull = ks * (zb - zw) + cs * (vb - vw) + rebound * np.maximum(vb - vw, 0.0)
        return pull, kt * (zw - height) + ct * (vw - speed)

    def rates(s, x):
        pull, push = forces(x, np.interp(s, t, z), np.interp(s, t, rate))
        return [x[1], (pull - push) / mw, x[3], -pull / mb]

    x = solve_ivp(rates, (0.0, t[-1]), np.zeros(4), "RK45", t, rtol=1e-7, atol=1e-9, max_step=dt).y
    pull, push = forces(x, z, rate)
    noise = rng.standard_normal((2, t.size))
    return {
        "time_s": t,
        "road_mm": 1e3 * z,
        "road_m_per_s": rate,
        "road_m_per_s2": np.gradient(rate, dt),
        "body_m_per_s2": -pull / mb + 0.02 * noise[0],
        "wheel_m_per_s2": (pull - push) / mw + 0.05 * noise[1],
    }


def test_the_air_around_a_fan_is_found(tmp_path):
    diagnosis = diagnosed(tmp_path, MODELS, partial(fan, drag=2.2e-6), MOTOR_STUDY + RECORDS, seed=7)
    assert diagnosis["residual"]["mode"] == "simulation", "how often it has turned moves nothing else"
    assert [f"{e['kind']}@{e['where']}" for e in diagnosis["effects"]] == ["quadratic_drag@bearing"]
    assert diagnosis["effects"][0]["parameters"]["drag"]["value"] == pytest.approx(2.2e-6, rel=0.01)
    assert diagnosis["explained"] > 0.99


@pytest.mark.slow
def test_rebound_of_a_shock_absorber_is_found(tmp_path):
    diagnosis = diagnosed(tmp_path, MODELS, partial(car, rebound=600.0), CAR + RECORDS, seed=7)
    assert [f"{e['kind']}@{e['where']}" for e in diagnosis["effects"]] == ["asymmetric_viscous_friction@strut"]
    damping = next(p for p in diagnosis["parameters"] if p["name"] == "strut.damping")["value"]
    sides = sorted(v["value"] for v in diagnosis["effects"][0]["parameters"].values())
    # the same way as in the model, and pulled out: 1430 and 2030 N s/m
    assert damping + sides[0] == pytest.approx(1430.0, rel=0.01)
    assert damping + sides[1] == pytest.approx(2030.0, rel=0.01)
    assert diagnosis["explained"] > 0.99


@pytest.mark.parametrize(
    ("machine", "study"),
    [
        pytest.param(partial(fan, drag=0.0), MOTOR_STUDY, id="fan"),
        pytest.param(partial(car, rebound=0.0), CAR, id="car", marks=pytest.mark.slow),
    ],
)
def test_where_it_has_nothing_nothing_is_named(tmp_path, machine, study):
    diagnosis = diagnosed(tmp_path, MODELS, machine, study + RECORDS, seed=7)
    assert diagnosis["verdict"] == "nothing missing"
    assert diagnosis["effects"] == []
