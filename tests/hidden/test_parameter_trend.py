"""A parameter that changes from record to record is told, and no physics is invented for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from discrepancy.questions.parameter_trend import parameter_trends
from discrepancy.report.diagnosis_json import to_diagnosis
from discrepancy.rigs.axis import axis_case
from discrepancy.study.study import Study

NAME, CHANGE = "guide.viscous", 20.0


def growing(problem):
    """Return the problem with recordings of an axis whose friction grows from trip to trip."""
    system = problem.model.build(outputs=problem.identify[0].outputs)
    nominal = system.parameter_vector({q.name: q.value for q in problem.uncertain})
    found = []
    for experiment, along in zip(problem.identify, np.linspace(-0.5, 0.5, len(problem.identify)), strict=True):
        changed = nominal.copy()
        changed[system.index("parameter", NAME)] += CHANGE * along
        raw = replace(experiment, preparation=type(experiment.preparation)())
        more = raw.simulate(system, changed) - raw.simulate(system, nominal)
        record = experiment.record
        signals = dict(record.signals)
        for c, name in enumerate(experiment.outputs):
            signals[name] = replace(signals[name], values=signals[name].values + more[:, c])
        found.append(replace(experiment, record=replace(record, signals=signals)))
    return replace(problem, identify=tuple(found))


@pytest.fixture(scope="module")
def problem():
    return axis_case(3, [], trips=8).problem(seed=3)


def test_friction_that_grows_from_trip_to_trip_is_told_and_nothing_is_named(problem):
    study = Study(growing(problem))
    conclusion = study.diagnose()
    assert not conclusion.accepted
    (trend,) = to_diagnosis(conclusion)["parameter_trends"]
    assert trend["parameter"] == NAME
    assert trend["change"] == pytest.approx(CHANGE, abs=3.0 * trend["std"])
    assert abs(trend["change"]) > 4.0 * trend["std"]  # what is told is sure
    assert any(w.startswith(f"{NAME} changes along the records") for w in conclusion.warnings)


def test_where_nothing_changes_nothing_is_told(problem):
    study = Study(problem)
    study.compare()
    assert parameter_trends(study.stage, problem.level, problem.seed) == ()
