"""A random force that acts only in a part of the motion is something that the model lacks; one everywhere is not.

A carriage on a spring, pushed by a recorded force.  What nobody recorded differs from record to record.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from plain_machines import CARRIAGE, CARRIAGE_STUDY, RECORDS, carriage_record, written

from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.evidence.uneven_forces import UnevenForce, uneven_random_forces
from discrepancy.study.study import Study


def carriage(rng: np.random.Generator, one_side: bool) -> dict[str, np.ndarray]:
    """Return one record of the machine, under a wind of 2 N."""
    return carriage_record(rng, 2.0, 3.0, lambda x, wind: wind if x > 0.0 or not one_side else 0.0)


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
