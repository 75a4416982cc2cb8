"""Residuals of records left out follow from one fit: against fits made anew, and between a law and a curve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from discrepancy.search.model_comparison import left_out_difference, left_out_residuals
from discrepancy.search.moves.free_curves import predicts_better
from discrepancy.study.study import Study


@pytest.fixture(scope="module")
def with_law(sticking):
    step = sticking.explain()
    assert str(step.accepted.effect) == "coulomb_friction@guide"
    return sticking.fitted("law", (step.accepted.effect,), step.stage, step.stage.noise)


def test_a_residual_left_out_is_that_of_a_fit_to_the_others(sticking, with_law):
    problem, weights = sticking.problem, with_law.identify.scale
    found = left_out_residuals(with_law, problem.identify[0].preparation, weights)
    others = Study(replace(problem, identify=problem.identify[1:], validate=problem.identify[:1]))
    others.prepared = sticking.prepared
    fitted = others.fitted("law", with_law.effects, None, with_law.noise)
    first = problem.identify[0]
    rows = len(first.measured)
    held = fitted.validate.fits[0].residual
    inside = with_law.identify.fits[0].residual
    assert found.shape[0] == sum(len(e.measured) for e in problem.identify)
    for c, name in enumerate(first.outputs):
        size = {
            k: float(np.sqrt(np.mean(v[:rows, c] ** 2))) * u
            for k, v, u in (("found", found, weights[name]), ("held out", held, 1.0), ("inside", inside, 1.0))
        }
        assert size["found"] == pytest.approx(size["held out"], rel=0.05), (name, size)
        assert size["found"] > 0.999 * size["inside"]


def test_a_law_says_more_of_records_left_out_than_the_curve_that_can_be_it(sticking, with_law):
    recalibrated = sticking.stage
    offer = recalibrated.free_curve_scan(level=0.02, seed=1, where=["guide"])
    curve = next(e for e in offer.effects if e.over == "speed")
    fitted = sticking.fitted("curve", (curve,), recalibrated, recalibrated.noise)
    preparation = with_law.scan_preparation
    assert left_out_difference(fitted, with_law, preparation) > 0.0
    assert left_out_difference(with_law, fitted, preparation) < 0.0
    assert left_out_difference(fitted, recalibrated, preparation) < -10.0
    assert left_out_difference(with_law, with_law, preparation) == 0.0


def test_friction_over_position_does_not_take_the_place_of_a_true_law(sticking, with_law):
    """Its level at 17 places follows what is slow in the disturbance, as a force over position does."""
    recalibrated = sticking.stage
    offer = recalibrated.free_curve_scan(level=0.02, seed=1, where=["guide"])
    for curve in (e for e in offer.effects if e.over in ("position", "friction")):
        fitted = sticking.fitted("curve", (curve,), recalibrated, recalibrated.noise)
        assert not predicts_better(fitted, with_law, with_law.effects), curve.over
    assert "friction" in [e.over for e in offer.effects]
