"""A force that follows the machine's state by no law of the catalogue is reported as unknown; a disturbance is not.

A carriage on a spring, pushed by a recorded force.  The force that is missing grows with the square of the speed and
turns with the position: towards the middle from either side, the faster the more.  No law of the catalogue is like it.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from plain_machines import CARRIAGE, CARRIAGE_STUDY, RECORDS, diagnosed, low_passed, written
from scipy.integrate import solve_ivp

from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.evidence.unknown_law import UnknownLaw, unknown_law
from discrepancy.study.study import Study


def carriage(rng: np.random.Generator, strength: float) -> dict[str, np.ndarray]:
    """Return one record of the machine: 20 s at 50 Hz, a disturbance of 0.5 N included."""
    t = np.arange(0.0, 20.0, 0.02)
    force = 20.0 * np.sin(2.0 * np.pi * t / 4.0 + rng.uniform(0.0, 6.0)) + 10.0 * low_passed(rng, t, 1.0)
    wind = 0.5 * low_passed(rng, t, 3.0)

    def rates(now, y):
        x, v = y
        missing = strength * x * v**2
        return [v, (np.interp(now, t, force + wind) - missing - 210.0 * x - 7.5 * v) / 2.05]

    y = solve_ivp(rates, (0.0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-8, atol=1e-10, max_step=0.02).y
    return {
        "time_s": t,
        "force_N": force,
        "position_m": y[0] + 2e-4 * rng.standard_normal(t.size),
        "velocity_m_s": y[1] + 2e-3 * rng.standard_normal(t.size),
    }


def law_of(tmp_path, strength: float, seed: int) -> UnknownLaw:
    file = written(tmp_path, CARRIAGE, partial(carriage, strength=strength), CARRIAGE_STUDY + RECORDS, seed=seed)
    law = unknown_law(StageLikelihood(stage=Study.from_file(file).stage))
    assert law is not None
    return law


def test_a_force_without_a_name_is_found_with_what_it_follows(tmp_path) -> None:
    law = law_of(tmp_path, strength=150.0, seed=21)
    assert law.announced
    assert (law.where, law.acts_on) == ("spring", "connection")
    assert set(law.depends_on) == {"place.spring.position", "place.spring.velocity"}
    assert "a force at spring that is a function of" in law.sentence


@pytest.mark.parametrize("seed", [22, pytest.param(23, marks=pytest.mark.slow)])
def test_a_disturbance_follows_nothing(tmp_path, seed: int) -> None:
    law = law_of(tmp_path, strength=0.0, seed=seed)
    assert not law.announced
    assert law.gain < 0.0


def test_the_answer_names_nothing_and_says_that_something_is_missing(tmp_path) -> None:
    answer = diagnosed(tmp_path, CARRIAGE, partial(carriage, strength=150.0), CARRIAGE_STUDY + RECORDS, seed=24)
    assert answer["verdict"] == "unknown effect"
    assert [e["kind"] for e in answer["effects"] if e["kind"] != "unknown_force"] == []
    assert answer["probabilities"]["unknown"] > 0.9
    assert answer["probabilities"]["nothing"] < 0.1


WHEEL = """
from multibody import Model
from multibody import library as lib


def wheel():
    m = Model("wheel")
    wheel = m.add("wheel", lib.Inertia(J=0.5))
    bearing = m.add("bearing", lib.RotaryViscousFriction(viscous=0.2))
    motor = m.add("motor", lib.TorqueSource())
    m.connect(wheel.flange, bearing.b, motor.flange)
    m.connect(bearing.a, m.ground)
    m.input("motor.torque", motor.torque)
    return m
"""

WHEEL_STUDY = """
[model]
build = "models.py:wheel"

[uncertain]
"wheel.J" = { value = 0.5, std = 0.02, min = 0.0 }
"bearing.viscous" = { value = 0.2, std = 0.05, min = 0.0 }

[inputs]
"motor.torque" = { column = "torque_Nm" }

[outputs]
"wheel.angle" = { column = "angle_rad", noise = 2e-3 }
"wheel.speed" = { column = "speed_rad_s", noise = 2e-2 }
"""


def wheel(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return one record of a wheel whose drag varies twice a turn: 20 s at 50 Hz."""
    t = np.arange(0.0, 20.0, 0.02)
    torque = 1.0 * np.sin(2.0 * np.pi * t / 10.0 + rng.uniform(0.0, 6.0)) + 0.3 * low_passed(rng, t, 1.0)

    def rates(now, y):
        angle, speed = y
        return [speed, (np.interp(now, t, torque) - 0.2 * (1.0 + 0.3 * np.cos(2.0 * angle)) * speed) / 0.5]

    y = solve_ivp(rates, (0.0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-8, atol=1e-10, max_step=0.02).y
    return {
        "time_s": t,
        "torque_Nm": torque,
        "angle_rad": y[0] + 2e-3 * rng.standard_normal(t.size),
        "speed_rad_s": y[1] + 2e-2 * rng.standard_normal(t.size),
    }


def test_a_product_of_two_signals_is_found_one_of_them_the_place_within_a_turn(tmp_path) -> None:
    """Neither signal shows it by itself: over a turn the drag is as stated, and at each speed too."""
    file = written(tmp_path, WHEEL, wheel, WHEEL_STUDY + RECORDS, seed=31)
    law = unknown_law(StageLikelihood(stage=Study.from_file(file).stage))
    assert law is not None
    assert law.announced
    assert law.acts_on in ("connection", "input")
    assert {"place.bearing.angle within a turn", "place.bearing.speed"} <= set(law.depends_on)
    assert "the angle within a turn of bearing" in law.sentence
