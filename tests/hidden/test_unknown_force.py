"""A force that the catalogue does not have: estimated over time, and what is said of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from discrepancy.conclusion.conclude import conclude
from discrepancy.rigs.axis import axis_case
from discrepancy.search.loop import Search
from discrepancy.search.moves.free_curves import propose_curve
from discrepancy.search.omnibus import omnibus_of_stage
from discrepancy.stages.force_estimate import estimate_force
from discrepancy.study.study import Study


@pytest.fixture(scope="module")
def found():
    case = axis_case(1, ["unknown_force@guide"], over="position", trips=4)
    study = Study(case.problem(seed=1))
    stage = propose_curve(study.stage, study.on_trial, level=0.02, seed=1, progress=lambda text: None)
    Search(study).accept(stage.accepted, stage)
    return case, study, conclude(study)


def test_force_over_time_is_the_true_one(found):
    case, study, _ = found
    before = study.stages[1]
    place = next(p for p in before.system.places if p.name == "guide")
    estimate = estimate_force(before, place, study.stages[-1])
    law = {n: v["value"] for n, v in case.truth["effects"][0]["parameters"].items()}
    true = -law["level"] * np.tanh((estimate.motion["position"] - law["centre"]) / law["width"])
    error = estimate.force - true
    assert estimate.reconstructable
    # the disturbance of 3 N is a force at the carriage too, and is estimated with it
    assert np.std(error) < 4.0
    assert np.corrcoef(estimate.force, true)[0, 1] > 0.97
    assert np.all(estimate.std > 0.0)


def test_its_entry_names_position_and_simple_laws(found):
    _, _, conclusion = found
    entry = conclusion.extra["unknown"]
    assert conclusion.verdict == "unknown effect"
    assert (entry["depends_on"], entry["turns_with_direction"]) == ("position", False)
    assert entry["reconstructable"]
    assert "a function of position" in conclusion.unknown.statement
    errors = [law["error"] for law in entry["laws"]]
    assert errors == sorted(errors)
    assert len(errors) >= 3


def test_a_force_that_no_sensor_sees_is_not_called_measured(found):
    _, study, _ = found
    before = study.stages[1]
    place = next(p for p in before.system.places if p.name == "guide")
    from dataclasses import replace

    deaf = replace(before, noise={n: 1e6 for n in before.noise})
    estimate = estimate_force(before, place, deaf)
    assert not estimate.reconstructable
    from discrepancy.questions.unknown_force import UnknownForce

    assert "cannot be reconstructed" in UnknownForce(estimate=estimate, report=None).sentence


def test_what_is_left_follows_the_inputs_only_where_something_is_missing(found):
    _, study, _ = found
    assert omnibus_of_stage(study.stages[1], level=0.02).rejects
    assert not omnibus_of_stage(Study(axis_case(7, trips=4).problem(seed=1)).stage, level=0.02).rejects


@pytest.mark.parametrize(("seed", "over"), [(8015, "time"), pytest.param(8013, "position", marks=pytest.mark.slow)])
def test_a_curve_takes_the_place_of_names_that_only_resemble_it(seed, over):
    """A slow force was taken for a drift of the torque sensor, a step over position for three waves."""
    problem = axis_case(seed, ["unknown_force@guide"], over=over).problem(seed=seed)
    conclusion = Study(replace(problem, search="significance")).diagnose()
    assert conclusion.verdict == "unknown effect"
    assert conclusion.unknown.where == "guide"
    assert conclusion.extra["unknown"]["depends_on"] == over


@pytest.mark.slow
def test_a_slow_force_is_told_from_a_random_one_by_its_evidence():
    """It is a force without a name, beside the random force that acts at the same place."""
    conclusion = Study(axis_case(8015, ["unknown_force@guide"], over="time").problem(seed=8015)).diagnose()
    assert conclusion.verdict == "unknown effect"
    assert "at guide" in next(w for w in conclusion.warnings if "the records show" in w)
    assert conclusion.probabilities.nothing < 0.05
    assert [(e.kind, e.where) for e in conclusion.probabilities.effects] == [("unknown_force", "guide")]
