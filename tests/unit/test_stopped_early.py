"""A calibration that was stopped at its limit of simulations says so: what is built on it may be wrong."""

from __future__ import annotations

from dataclasses import replace

import pytest

from discrepancy.conclusion.sentences import stopped_early_warnings
from estimation.fit.calibrate import calibrate


@pytest.fixture(scope="module")
def parts(small_study):
    stage = small_study.stages[0]
    return stage.system, [f.experiment for f in stage.identify.fits], small_study.stages[1].identify.parameters


def test_a_fit_with_too_few_simulations_is_no_end(parts):
    system, experiments, parameters = parts
    stopped = calibrate(system, experiments, parameters, max_evaluations=1)
    ended = calibrate(system, experiments, parameters)
    assert stopped.stopped_early
    assert not ended.stopped_early
    assert stopped.to_dict() != pytest.approx(ended.to_dict())


def test_the_report_warns(small_study, parts):
    system, experiments, parameters = parts
    last = small_study.stages[-1]
    assert stopped_early_warnings(last) == []
    stopped = replace(last, identify=calibrate(system, experiments, parameters, max_evaluations=1))
    (warning,) = stopped_early_warnings(stopped)
    assert "stopped at its limit of simulations" in warning
