"""An effect gets no credit for taking the calibration out of a worse place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plain_machines import CARRIAGE, CARRIAGE_STUDY, RECORDS, carriage_record, written

from discrepancy.problem.problem import read_problem
from discrepancy.statistics.thresholds import RELEVANT_SHARE
from discrepancy.study.study import Study


def carriage(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return one record of the machine, on which nothing acts that is not recorded."""
    return carriage_record(rng, 0.0, 1.0, lambda x, wind: 0.0)


def test_a_model_whose_fit_was_worse_than_that_of_its_extensions_is_fitted_again(tmp_path: Path) -> None:
    problem = read_problem(written(tmp_path, CARRIAGE, carriage, CARRIAGE_STUDY + RECORDS, seed=5))
    study = Study(replace(problem, include=("quadratic_drag@spring", "cubic_stiffness@spring"), search="evidence"))
    calibrated = study.stage
    # as if the fit had ended elsewhere
    elsewhere = calibrated.identify.to_dict() | {"spring.stiffness": 400.0}
    own = [np.array(list(f.own.values())) for f in calibrated.identify.fits]
    worse = study.restored("recalibrated", (), elsewhere, own, calibrated.identify.scale, calibrated.noise)
    study.stages[-1] = worse
    assert study.diagnose().verdict == "nothing missing"
    assert study.stage.effects == ()
    for output, error in calibrated.rmse("identify").items():
        assert worse.rmse("identify")[output] > 2.0 * error
        # a fit whose square error is smaller by less than this share is not taken
        assert study.stage.rmse("identify")[output] == pytest.approx(error, rel=0.5 * RELEVANT_SHARE)
