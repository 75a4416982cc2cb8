"""A machine of equations without connections: what nobody recorded disturbs the rates of its states.

A tank of water with a heater.  Heat that nobody recorded reaches the water; one sensor is off, or there is a loss that
is not in the model.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from plain_machines import RECORDS, diagnosed, low_passed, written
from scipy.integrate import solve_ivp

from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.evidence.linearised_records import what_may_act
from discrepancy.evidence.unknown_law_search import unknown_law
from discrepancy.study.study import Study
from discrepancy.validation.machines.heated_tank import MACHINE

HEATER, WATER, PASSED, LOST = 2500.0, 60_000.0, 45.0, 12.0  # J/K, J/K, W/K, W/K

MODEL = MACHINE.model
#: The same with a state that is the integral of another.
WITH_INTEGRAL = MODEL.replace(
    "    def equations(self):",
    '    given = State("K*s", "what the water was exposed to", 0.0)\n\n    def equations(self):\n'
    "        self.der.given = self.water",
)

STUDY = """
[model]
build = "models.py:build"

[uncertain]
"tank.G" = { value = 45.0, std = 3.0, min = 0.0 }
"tank.H" = { value = 12.0, std = 1.0, min = 0.0 }

[inputs]
"heater.power" = { column = "power_W" }

[outputs]
"tank.heater" = { column = "heater_K", noise = 0.15 }
"tank.water" = { column = "water_K", noise = 0.05 }
"""


def tank(
    rng: np.random.Generator, offset: float = 0.0, steam: float = 0.0, heat: float = 15.0
) -> dict[str, np.ndarray]:
    """Return one record: 50 minutes at 0.2 Hz; ``heat`` is the rms of what nobody recorded, W."""
    t = np.arange(0.0, 3000.0, 5.0)
    power = 500.0 + 350.0 * np.sign(np.sin(2.0 * np.pi * t / 1500.0 + rng.uniform(0.0, 6.0)))
    draught = heat * low_passed(rng, t, 1.0 / 400.0)

    def rates(now, y):
        passed = PASSED * (y[0] - y[1])
        lost = LOST * y[1] + steam * y[1] ** 3
        return [(np.interp(now, t, power) - passed) / HEATER, (passed - lost + np.interp(now, t, draught)) / WATER]

    start = 20.0 + rng.standard_normal(2)
    y = solve_ivp(rates, (0.0, t[-1]), start, t_eval=t, rtol=1e-8, atol=1e-8, max_step=5.0).y
    return {
        "time_s": t,
        "power_W": power,
        "heater_K": y[0] + offset + 0.15 * rng.standard_normal(t.size),
        "water_K": y[1] + 0.05 * rng.standard_normal(t.size),
    }


FREE = '\n[initial]\nfree = ["tank.heater", "tank.water"]\n'


def likelihood(tmp_path, model: str = MODEL, **hidden: float) -> StageLikelihood:
    file = written(tmp_path, model, partial(tank, **hidden), STUDY + RECORDS + FREE, seed=41)
    return StageLikelihood(stage=Study.from_file(file).stage)


def test_heat_that_nobody_recorded_reaches_the_water_and_no_sensor(tmp_path) -> None:
    of = likelihood(tmp_path, WITH_INTEGRAL)
    # what the water was exposed to is an integral of its temperature, and nothing else can change it
    assert what_may_act(of.linearised) == ([], ["heater.power"], ["tank.heater", "tank.water"])
    largest = max(of.noise.model.processes, key=lambda q: q.std * WATER)
    assert (largest.where, largest.channel) == ("tank.water", -1)
    assert 0.5 < largest.std * WATER / 15.0 < 2.0


def test_a_sensor_that_is_off_is_told_from_heat_that_nobody_recorded(tmp_path) -> None:
    """In one record it is no more than an error of the other sensor that does not change; the next ones repeat it."""
    records = RECORDS.replace(
        '["run0.csv", "run1.csv"]', '["run0.csv", "run1.csv", "run3.csv", "run4.csv", "run5.csv"]'
    )
    study = STUDY + records + FREE
    answer = diagnosed(tmp_path, MODEL, partial(tank, offset=0.6), study, seed=42, records=6)
    assert [(e["kind"], e["where"]) for e in answer["effects"]] == [("sensor_offset", "tank.heater")]
    assert "in the rate of tank.water" in " ".join(answer["warnings"])


def test_a_loss_that_looks_like_a_slow_disturbance_is_found_with_what_it_follows(tmp_path) -> None:
    law = unknown_law(likelihood(tmp_path, steam=3e-3, heat=3.0))
    assert law is not None
    (function,) = law.functions
    assert (function.source.acts_on, function.source.where, function.signals[0]) == (
        "state",
        "tank.water",
        "tank.water",
    )
    assert "an addition to the rate of tank.water that is a function of tank.water" in law.sentence
