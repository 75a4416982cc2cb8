"""A stage owns what is computed of it: once, shared by stages of the same fit, and anew on request."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from discrepancy.stages.stage import comparable_residuals


@pytest.fixture
def stage(small_study):
    return small_study.stages[1].without_results()


def test_a_linearised_problem_is_computed_once_and_shared_by_stages_of_one_fit(stage):
    linearised = stage.linearised_problem()
    assert stage.linearised_problem() is linearised
    assert replace(stage, notes=("read again",)).linearised_problem() is linearised
    assert stage.linearised_problem(replace(stage.scan_preparation, edge=0.1)) is not linearised
    assert stage.without_results().linearised_problem() is not linearised


def test_a_trial_fit_is_done_once_for_effects_that_agree_to_nine_digits(stage, small_study):
    (effect,) = small_study.stages[2].effects
    rounded = effect.with_values({effect.parameter_name(k): v * (1.0 + 1e-13) for k, v in effect.strengths.items()})
    other = effect.with_values({effect.parameter_name(k): v * 1.01 for k, v in effect.strengths.items()})
    assert rounded.strengths != effect.strengths
    fits = iter([small_study.stages[2], small_study.stages[1]])
    first = stage.trial_fit("+ effect", (effect,), lambda: next(fits))
    assert stage.trial_fit("+ effect", (rounded,), lambda: next(fits)) is first
    assert stage.trial_fit("+ effect", (other,), lambda: next(fits)) is small_study.stages[1]


def test_a_machine_that_is_held_has_no_accumulating_disturbance(stage, small_study):
    assert stage.disturbance is None  # not computed yet
    assert stage.weighted_problem() is stage.linearised_problem()
    assert stage.disturbance is None
    one, other = comparable_residuals(stage, small_study.stages[2])
    np.testing.assert_array_equal(one[0], stage.identify.fits[0].residual)
    np.testing.assert_array_equal(other[0], small_study.stages[2].identify.fits[0].residual)


def test_weights_leave_what_does_not_depend_on_them(stage):
    linearised = stage.linearised_problem()
    plain = linearised.residual()
    halved = [lambda block: 0.5 * block for _ in linearised.experiments]
    weighted = linearised.weighted_by(halved)
    assert weighted.nominal_outputs(0) is linearised.nominal_outputs(0)
    for block, whole in zip(weighted.sensitivities().blocks, linearised.sensitivities().blocks, strict=True):
        np.testing.assert_array_equal(block, 0.5 * whole)
    assert linearised.residual() is plain
