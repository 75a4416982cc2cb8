"""Recorded positions that contradict each other where a machine is at rest: their zeros are not known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from discrepancy import Study
from discrepancy.problem.contradicting_positions import contradicting_positions
from discrepancy.problem.problem import Problem, make_experiments
from discrepancy.questions.plausibility import check_problem
from estimation.files.record import Record, RecordedSignal
from estimation.fit.calibration import UncertainParameter
from multibody import Model
from multibody.library import ForceSource, InclinedMass, RopeSegment

EA, LENGTH, UPPER, LOWER, G = 2e4, 4.0, 10.0, 20.0, 9.80665
OUTPUTS = ("upper.position", "lower.position", "high.tension")
NOISE = dict(zip(OUTPUTS, (1e-5, 1e-5, 0.2), strict=True))


def hanging() -> Model:
    """Two masses that hang on ropes, one below the other; a force acts on the upper one."""
    model = Model("hanging")
    upper, lower = model.add("upper", InclinedMass(m=UPPER)), model.add("lower", InclinedMass(m=LOWER))
    high = model.add("high", RopeSegment(EA=EA, length=LENGTH, damping=60.0))
    low = model.add("low", RopeSegment(EA=EA, length=LENGTH, damping=60.0))
    push = model.add("push", ForceSource())
    model.connect(high.b, model.ground)
    model.connect(high.a, upper.flange, push.flange, low.b)
    model.connect(low.a, lower.flange)
    model.input("push", push.force)
    return model


def problem(zeros: tuple[float, float], outputs: tuple[str, ...] = OUTPUTS) -> Problem:
    """Two records from rest; the lower mass is read from a zero of its own in each, m; the stiffness is stated low."""
    model, t = hanging(), np.arange(800) * 0.005
    system = model.build()
    records = []
    for number, zero in enumerate(zeros):
        rng = np.random.default_rng(number)
        push = 40.0 * np.sin((4.0 + number) * t) * (t > 0.2)
        upper = -LENGTH * (1.0 + (UPPER + LOWER) * G / EA)
        start = {"upper.position": upper, "lower.position": upper - LENGTH * (1.0 + LOWER * G / EA)}
        run = system.simulate((0.0, float(t[-1])), inputs={"push": (t, push)}, initial=start, times=t, rtol=1e-9)
        read = {n: run[n] + NOISE[n] * rng.standard_normal(t.size) for n in outputs}
        if "lower.position" in read:
            read["lower.position"] = read["lower.position"] + zero
        units = {q.name: q.unit for q in (*system.outputs, *system.inputs)}
        signals = {
            n: RecordedSignal(values=v, unit=units[n], column=n, measured_unit=units[n])
            for n, v in {"push": push, **read}.items()
        }
        records.append(Record(name=f"record {number}", path=Path("record.csv"), time=t, signals=signals))
    free = ("upper.position", "lower.position")
    identify = make_experiments(model, records, ("push",), outputs, free=free)
    stated = UncertainParameter(name="low.EA", value=0.96 * EA, std=0.05 * EA)
    return Problem(
        name="hanging", model=model, uncertain=(stated,), identify=identify, noise=NOISE, residual="simulation"
    )


@pytest.fixture(scope="module")
def off() -> Problem:
    return problem((0.008, -0.005))


def test_positions_that_contradict_each_other_have_zeros_of_their_own(off: Problem) -> None:
    assert contradicting_positions(off) == OUTPUTS[:2]
    study = Study(off)
    assert study.stage.identify.to_dict()["low.EA"] == pytest.approx(EA, rel=0.001)
    assert study.stage.rmse("identify")["lower.position"] == pytest.approx(NOISE["lower.position"], rel=0.05)
    assert all(e.offsets == OUTPUTS[:2] for e in study.problem.identify)
    assert any("'upper.position', 'lower.position' contradict each other" in text for text in study.remarks)


def test_the_check_says_so(off: Problem) -> None:
    assert any("contradict each other" in text for text in check_problem(off).warnings)


def test_positions_that_agree_keep_their_zeros() -> None:
    agreeing = problem((0.0, 0.0))
    assert contradicting_positions(agreeing) == ()
    assert not Study(agreeing).remarks


def test_one_position_contradicts_nothing_nor_do_zeros_that_are_unknown_already(off: Problem) -> None:
    assert contradicting_positions(problem((0.0, 0.0), OUTPUTS[:1])) == ()
    known = replace(off, identify=tuple(replace(e, offsets=OUTPUTS[:1]) for e in off.identify))
    assert contradicting_positions(known) == ()
