"""A force that no law of the catalogue describes: told as unknown, with what it depends on; never where there is none.

A stage on a spring, pushed by a recorded force, beside a slow disturbance that nobody recorded.  Hidden is a spring
that is softer the further the stage has moved lately: no law of the catalogue remembers that.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from plain_machines import RECORDS, diagnosed, low_passed
from scipy.integrate import solve_ivp

from discrepancy.evidence.features import feature_blocks
from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.evidence.systematic_force import systematic_force
from discrepancy.study.study import Study

MODELS = """
from multibody import Model
from multibody import library as lib


def stage():
    m = Model("stage")
    mass = m.add("stage", lib.Mass(m=4.0))
    spring = m.add("spring", lib.SpringDamper(stiffness=800.0, damping=12.0))
    push = m.add("push", lib.ForceSource())
    m.connect(mass.flange, spring.b, push.flange)
    m.connect(spring.a, m.ground)
    m.input("push.force", push.force)
    return m
"""

STUDY = """
[model]
build = "models.py:stage"

[uncertain]
"stage.m" = { value = 4.0, std = 0.2, min = 0.0 }
"spring.stiffness" = { value = 800.0, std = 60.0, min = 0.0 }
"spring.damping" = { value = 12.0, std = 4.0, min = 0.0 }

[inputs]
"push.force" = { column = "force_N" }

[outputs]
"stage.position" = { column = "position_m", noise = 2e-4 }
"stage.velocity" = { column = "velocity_m_s", noise = 2e-3 }
"""


def stage(rng: np.random.Generator, softening: float = 0.0) -> dict[str, np.ndarray]:
    """Return one record of the machine: 20 s at 50 Hz."""
    t = np.arange(0.0, 20.0, 0.02)
    swell = 1.0 + 0.8 * np.sin(2.0 * np.pi * t / 9.0 + rng.uniform(0.0, 6.0))
    force, gust = 30.0 * swell * low_passed(rng, t, 2.0), 1.5 * low_passed(rng, t, 0.5)

    def rates(now, y):
        x, v, moved = y
        push = np.interp(now, t, force) + np.interp(now, t, gust)
        k = 830.0 * (1.0 - softening * moved)
        return [v, (push - k * x - 10.0 * v) / 4.1, (abs(v) - moved) / 1.5]

    y = solve_ivp(rates, (0.0, t[-1]), [0.0, 0.0, 0.0], t_eval=t, rtol=1e-8, atol=1e-10).y
    return {
        "time_s": t,
        "force_N": force,
        "position_m": y[0] + 2e-4 * rng.standard_normal(t.size),
        "velocity_m_s": y[1] + 2e-3 * rng.standard_normal(t.size),
    }


def test_a_spring_that_remembers_is_told_as_unknown(tmp_path) -> None:
    found = diagnosed(tmp_path, MODELS, partial(stage, softening=0.1), STUDY + RECORDS, seed=3)
    assert found["verdict"] == "unknown effect"
    assert found["effects"] == []
    force = found["systematic_force"]
    assert force["where"] == "spring"
    assert force["depends_on"] == "position and earlier motion"
    assert found["probabilities"]["nothing"] < 0.05
    assert "by no law of the catalogue" in found["sentence"]


def test_where_nothing_is_hidden_no_force_is_found(tmp_path) -> None:
    found = diagnosed(tmp_path, MODELS, stage, STUDY + RECORDS, seed=4)
    assert found["verdict"] == "nothing missing"
    assert not found["systematic_force"]["convincing"]


@pytest.fixture
def likelihood(tmp_path):
    from plain_machines import written

    file = written(tmp_path, MODELS, stage, STUDY + RECORDS, seed=5)
    return StageLikelihood(stage=Study.from_file(file).stage)


def test_features_do_not_depend_on_units_or_origin(likelihood) -> None:
    """Every column moves the outputs by their noise once in all, whatever its signal is measured in."""
    (spring, *_) = feature_blocks(likelihood.linearised, likelihood.noise.records)
    noise = np.array([likelihood.linearised.noise[c] for c in likelihood.stage.outputs])
    squares = sum(np.sum((c / noise[:, None]) ** 2, axis=(0, 1)) for c in spring.columns)
    used = np.concatenate(list(spring.groups.values()))
    np.testing.assert_allclose(squares[used] * likelihood.linearised.preparation.average, 1.0, rtol=1e-9)


def test_the_price_rises_with_the_number_of_candidates(likelihood) -> None:
    few, many = systematic_force(likelihood, 10), systematic_force(likelihood, 1000)
    assert few is not None
    assert many is not None
    assert few.gain > many.gain
