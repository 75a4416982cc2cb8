"""A random force that acts only in a part of the motion is something that the model lacks; one everywhere is not.

A carriage on a spring, pushed by a recorded force.  What nobody recorded differs from record to record.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from plain_machines import CARRIAGE, CARRIAGE_STUDY, RECORDS, low_passed, written
from scipy.integrate import solve_ivp

from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.evidence.uneven_forces import UnevenForce, uneven_random_forces
from discrepancy.study.study import Study


def carriage(rng: np.random.Generator, one_side: bool) -> dict[str, np.ndarray]:
    """Return one record of the machine: 20 s at 50 Hz."""
    t = np.arange(0.0, 20.0, 0.02)
    force = 20.0 * np.sin(2.0 * np.pi * t / 4.0 + rng.uniform(0.0, 6.0)) + 10.0 * low_passed(rng, t, 1.0)
    wind = 2.0 * low_passed(rng, t, 3.0)

    def rates(now, y):
        x, v = y
        acts = 1.0 if x > 0.0 or not one_side else 0.0
        push = np.interp(now, t, force) + acts * np.interp(now, t, wind)
        return [v, (push - 210.0 * x - 7.5 * v) / 2.05]

    y = solve_ivp(rates, (0.0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-8, atol=1e-10, max_step=0.02).y
    return {
        "time_s": t,
        "force_N": force,
        "position_m": y[0] + 2e-4 * rng.standard_normal(t.size),
        "velocity_m_s": y[1] + 2e-3 * rng.standard_normal(t.size),
    }


def uneven(tmp_path, one_side: bool, seed: int) -> tuple[UnevenForce, ...]:
    file = written(tmp_path, CARRIAGE, partial(carriage, one_side=one_side), CARRIAGE_STUDY + RECORDS, seed=seed)
    return uneven_random_forces(StageLikelihood(stage=Study.from_file(file).stage))


def test_wind_on_one_side_of_the_middle_is_told(tmp_path) -> None:
    (force,) = uneven(tmp_path, one_side=True, seed=11)
    assert force.where == "spring"
    assert "position of spring above" in force.at
    assert force.ratio > 3.0
    assert "the model lacks" in force.sentence


@pytest.mark.parametrize("seed", [12, pytest.param(13, marks=pytest.mark.slow)])
def test_wind_that_acts_everywhere_is_a_disturbance(tmp_path, seed: int) -> None:
    assert uneven(tmp_path, one_side=False, seed=seed) == ()
