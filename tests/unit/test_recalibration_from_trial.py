"""An effect gets no credit for taking a calibration out of a worse place; a curve must be relevant as a law must."""

from dataclasses import replace

import pytest

from discrepancy.rigs.axis import axis_case
from discrepancy.search.loop import Search
from discrepancy.search.model_comparison import bic_difference
from discrepancy.search.moves.free_curves import _best_curve
from discrepancy.study.study import Study


def missed_by(stage, share):
    """Return the stage as if it missed its records by so many times what it does."""
    fits = []
    for f in stage.identify.fits:
        outputs = f.experiment.measured - share * f.residual
        fits.append(replace(f, response=replace(f.response, outputs=outputs)))
    return replace(stage, identify=replace(stage.identify, fits=tuple(fits)))


@pytest.fixture
def study():
    found = Study(axis_case(1, [], trips=3).problem(seed=1))
    found.compare()
    return found


def test_a_better_calibration_takes_the_place_of_the_latest_stage(study):
    good = study.stage
    study.stages[-1] = replace(missed_by(good, 1.5), notes=("kept",))  # in a worse place
    lines = []
    study.progress = lines.append
    assert Search(study)._recalibrated_from(good)
    assert "it does better than before: the calibration continues from there" in lines
    assert len(study.stages) == 2
    assert study.stage.notes == ("kept",)
    assert bic_difference(study.stage, good) == pytest.approx(0.0, abs=1.0)
    assert not Search(study)._recalibrated_from(good)  # it ends


def test_a_trial_that_cannot_be_simulated_without_its_effect_changes_nothing(study, monkeypatch):
    def fails(*_, **__):
        raise RuntimeError("it runs away")

    latest = study.stage
    monkeypatch.setattr(study, "fitted", fails)
    assert not Search(study)._recalibrated_from(latest)
    assert study.stage is latest


def test_a_curve_below_every_noise_floor_is_no_answer(study):
    before = study.stage
    better = missed_by(before, 0.9)
    effect = type("Curve", (), {"over": "time", "where": "guide"})()

    def best(stage):
        return _best_curve(before, before, [effect], [0.001], lambda *_: stage, lambda _: None, least=0.0)

    assert bic_difference(better, before) < -10.0  # enough samples make anything significant
    floor = {n: 2.0 * r for n, r in before.rmse("identify").items()}
    assert best(replace(better, noise=floor)) is None
    small = {n: 0.1 * r for n, r in before.rmse("identify").items()}
    found = replace(better, noise=small, effects=(effect,))
    assert best(found).accepted.p_value == 0.001
