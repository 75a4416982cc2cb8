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
from discrepancy.evidence.unknown_law import UnknownLaw
from discrepancy.evidence.unknown_law_search import at_a_second_place, unknown_law
from discrepancy.study.study import Study
from discrepancy.validation.machines.shaker import MACHINE as SHAKER


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
    (function,) = law.functions
    assert (function.source.where, function.source.acts_on) == ("spring", "connection")
    assert set(function.signals) == {"place.spring.position", "place.spring.velocity"}
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
    (function,) = law.functions
    assert function.source.acts_on in ("connection", "input")
    assert {"place.bearing.angle within a turn", "place.bearing.speed"} <= set(function.signals)
    assert "the angle within a turn of bearing" in law.sentence


VOICE_COIL_STUDY = """
[model]
build = "models.py:build"

[uncertain]
"coil.K" = { value = 18.0, std = 0.3, min = 0.0 }
"springs.damping" = { value = 6.0, std = 1.0, min = 0.0 }

[inputs]
"amplifier.voltage" = { column = "voltage_V" }

[outputs]
"table.position" = { column = "position_m", noise = 2e-6 }
"coil.current" = { column = "current_A", noise = 2e-3 }
"""


def voice_coil(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return one record of a shaker whose force constant falls with the square of the place: 3 s at 500 Hz."""
    t = np.arange(0.0, 3.0, 2e-3)
    voltage = 6.0 * np.sin(2.0 * np.pi * 0.9 * t + rng.uniform(0.0, 6.0)) + 2.0 * low_passed(rng, t, 20.0)

    def rates(now, y):
        current, x, v = y
        constant = 18.0 * (1.0 - 300.0 * x**2)
        rate_of_current = (np.interp(now, t, voltage) - 3.2 * current - constant * v) / 4e-3
        return [rate_of_current, v, (constant * current - 5200.0 * x - 6.0 * v) / 1.4]

    y = solve_ivp(rates, (0.0, t[-1]), np.zeros(3), t_eval=t, rtol=1e-8, atol=1e-11, max_step=2e-3).y
    return {
        "time_s": t,
        "voltage_V": voltage,
        "position_m": y[1] + 2e-6 * rng.standard_normal(t.size),
        "current_A": y[0] + 2e-3 * rng.standard_normal(t.size),
    }


def test_one_law_that_acts_at_two_places_is_found_at_both(tmp_path) -> None:
    """A force constant that falls with the place changes the force on the current and the voltage on the speed."""
    file = written(tmp_path, SHAKER.model, voice_coil, VOICE_COIL_STUDY + RECORDS, seed=41)
    likelihood = StageLikelihood(stage=Study.from_file(file).stage)
    law = unknown_law(likelihood)
    assert law is not None
    both = at_a_second_place(likelihood, law)
    assert both.gain > law.gain + 50.0
    found = {(f.source.where, f.source.acts_on): set(f.signals) for f in both.functions}
    assert found == {
        ("amplifier.voltage", "input"): {"place.springs.position", "place.springs.velocity"},
        ("springs", "connection"): {"place.springs.position", "coil.current"},
    }
    assert both.announced
    assert "; together they account for" in both.sentence
    assert [e["where"] for e in both.to_dict()["elsewhere"]] == [both.functions[1].source.where]


def test_a_law_at_one_place_has_no_second(tmp_path) -> None:
    """Of a small one: what a large one changes to second order may look as if it acted elsewhere."""
    file = written(tmp_path, CARRIAGE, partial(carriage, strength=30.0), CARRIAGE_STUDY + RECORDS, seed=46)
    likelihood = StageLikelihood(stage=Study.from_file(file).stage)
    law = unknown_law(likelihood)
    assert law is not None
    assert at_a_second_place(likelihood, law) is law
