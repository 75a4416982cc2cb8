"""An output that is far off counts for what a fit can make of it, not for how far off it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from estimation.files.record import Record, RecordedSignal
from estimation.fit.calibrate import UncertainParameter
from estimation.fit.fit_problem import FitProblem
from estimation.fit.weights import weights_of
from estimation.response.experiment import Experiment
from multibody import Model
from multibody.library import ForceSource, Mass, Spring, ViscousFriction

STIFFNESS, MASS, G = 4000.0, 20.0, 9.81
TIME = np.arange(0.0, 8.0, 0.01)


def hanging(stiffness: float = STIFFNESS) -> Model:
    model = Model("hanging mass")
    mass, drive = model.add("mass", Mass(m=MASS)), model.add("drive", ForceSource())
    spring = model.add("spring", Spring(stiffness=stiffness))
    damper = model.add("damper", ViscousFriction(viscous=40.0))
    model.connect(mass.flange, drive.flange, spring.a, damper.a)
    model.connect(spring.b, damper.b, model.ground)
    model.input("drive.force", drive.force)
    return model


def drifting(rng: np.random.Generator, memory: float, size: float) -> np.ndarray:
    phi = np.exp(-0.01 / memory)
    x = np.zeros(TIME.size)
    for k in range(1, TIME.size):
        x[k] = phi * x[k - 1] + np.sqrt(1.0 - phi**2) * rng.standard_normal()
    return size * x


@pytest.fixture(scope="module")
def problem() -> FitProblem:
    """A mass on a spring that is 12 % softer than stated: it hangs 6.7 mm lower, with a drift of 0.2 mm."""
    rng, true = np.random.default_rng(3), 0.88 * STIFFNESS
    force = -MASS * G + 2.0 * np.sin(2 * np.pi * 0.7 * TIME)
    rest = -MASS * G / true
    run = (
        hanging(true)
        .build()
        .simulate(
            (0.0, TIME[-1]),
            inputs={"drive.force": (TIME, force)},
            times=TIME,
            initial={"mass.position": rest},
            rtol=1e-8,
        )
    )
    place = run["mass.position"] + drifting(rng, 0.5, 2e-4)
    speed = run["mass.velocity"] + drifting(rng, 0.02, 2e-3)
    signals = {
        "drive.force": RecordedSignal(values=force, unit="N", column="f", measured_unit="N"),
        "mass.position": RecordedSignal(values=place, unit="m", column="x", measured_unit="m"),
        "mass.velocity": RecordedSignal(values=speed, unit="m/s", column="v", measured_unit="m/s"),
    }
    record = Record(name="run", path=Path("run.csv"), time=TIME, signals=signals)
    experiment = Experiment(
        record=record,
        inputs=("drive.force",),
        outputs=("mass.position", "mass.velocity"),
        start={"mass.position": rest},
    )
    system = hanging().build(outputs=experiment.outputs)
    parameters = [
        UncertainParameter(name="spring.stiffness", value=STIFFNESS, std=0.08 * STIFFNESS, min=1.0, unit="N/m")
    ]
    return FitProblem(system=system, experiments=[experiment], parameters=parameters, sensors=(), base=system.p)


def test_what_a_parameter_explains_is_no_noise(problem: FitProblem) -> None:
    theta, none = problem.start(None, None), np.zeros(2)
    raw = weights_of(problem, problem.respond_all(theta, False), none, theta, np.array([0]))
    problem._responses.clear()
    fitted = weights_of(problem, problem.respond_all(theta, True), none, theta, np.array([0]))
    assert fitted[0] < 0.5 * raw[0], "six millimetres, of which most go with the stiffness"
    # at the right place a step takes no more than the mean of a drift that lasts a sixteenth of the record
    there = np.array([0.88 * STIFFNESS])
    raw = weights_of(problem, problem.respond_all(there, False), none, there, np.array([0]))
    problem._responses.clear()
    fitted = weights_of(problem, problem.respond_all(there, True), none, there, np.array([0]))
    assert np.all((0.75 * raw < fitted) & (fitted <= raw))


def test_no_more_is_taken_for_explained_than_the_stated_uncertainty_allows(problem: FitProblem) -> None:
    theta, none = problem.start(None, None), np.zeros(2)
    far = problem.parameters[0]
    tight = UncertainParameter(name=far.name, value=far.value, std=1e-4 * far.value, min=far.min, unit=far.unit)
    known = FitProblem(
        system=problem.system, experiments=problem.experiments, parameters=[tight], sensors=(), base=problem.base
    )
    raw = weights_of(known, known.respond_all(theta, False), none, theta, np.array([0]))
    known._responses.clear()
    fitted = weights_of(known, known.respond_all(theta, True), none, theta, np.array([0]))
    assert fitted == pytest.approx(raw, rel=0.05)


def test_a_floor_is_kept(problem: FitProblem) -> None:
    theta, floor = problem.start(None, None), np.array([0.5, 0.5])
    fitted = weights_of(problem, problem.respond_all(theta, True), floor, theta, np.array([0]))
    assert np.all(fitted >= floor)
