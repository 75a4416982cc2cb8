"""Least squares to mesh lines, on the analytic stand-in of a gear stage."""

from __future__ import annotations

import numpy as np
import pytest
from gear_stand_in import RANGES, START, TEETH, measured, stand_in

from gearbox.files.operating_condition import OperatingCondition
from gearbox.papers.manufacturing_errors import CONTACT, WAYS, Way, _Fit
from gearbox.signals.recordings import Recording
from gearbox.stage.stage import GearStage
from gearbox.updating.chain import UpdatingChain
from gearbox.updating.runs import Runs
from gearbox.updating.settings import UpdatingSettings
from gearbox.updating.virtual import Settings
from surrogate import DesignSpace

TRUTH = {**START, "K": 6.44e5, "C_D": 303.0, "e_F": 2.1}


def fit(model=stand_in) -> _Fit:
    made = []
    for i, torque in enumerate((150.0, 75.0, 220.0)):
        _, signals = measured(TRUTH, OperatingCondition(1000.0, torque), noise=0.0, sidebands=0.0, seed=i)
        made.append(Recording(OperatingCondition(1000.0, torque, f"{torque:g}"), signals))
    settings = UpdatingSettings(
        space=DesignSpace.from_mapping(RANGES),
        start=START,
        sensor="seat",
        sensors=("seat", "base"),
        driving_teeth=TEETH,
    )
    chain = UpdatingChain(settings, Runs(model, Settings(driving_teeth=TEETH)), made)
    ranges = {name: RANGES[name][:2] for name in CONTACT}
    return _Fit(way=Way(what="stand-in", parameters=ranges), chain=chain, means=())


def test_truth_inside_the_model_is_found() -> None:
    found = fit()
    x, left, runs = found.run()
    values = found.values(x)
    assert left < 1e-3
    assert runs > 0
    # the stand-in's working stiffness follows from K and e_F together; three loads tell them apart
    assert values["K"] == pytest.approx(TRUTH["K"], rel=0.05)
    assert values["e_F"] == pytest.approx(TRUTH["e_F"], rel=0.02)


def test_points_where_the_stage_cannot_be_run_do_not_stop_the_search() -> None:
    def often_fails(values, condition, duration):
        if values["e_F"] < 1.9:
            raise RuntimeError("no rest near the guess")
        return stand_in(values, condition, duration)

    x, left, _ = fit(often_fails).run()
    assert np.isfinite(x).all()
    assert left < 0.05


def test_every_parameter_of_a_way_is_one_of_the_stage() -> None:
    stage = GearStage.paper(housing="clamped", imperfect=True)
    for way in WAYS:
        assert stage.values(**{name: low for name, (low, _) in way.parameters.items()})
