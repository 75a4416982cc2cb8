"""What is unknown of each record held out is fitted to that record alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from discrepancy.search.state import SLOWER, not_much_slower
from estimation.files.record import Record, RecordedSignal
from estimation.fit.calibrate import calibrate, evaluate, simulated_at
from estimation.fit.fit_problem import FitProblem
from estimation.response.experiment import Experiment
from multibody import Model
from multibody.base.errors import SimulationError
from multibody.library import CoulombFriction, ForceSource, Mass

TIME = np.arange(0.0, 0.5, 0.005)
SPEEDS = (1.3, 2.4)


@pytest.fixture(scope="module")
def system():
    """A mass on a dry guide that sticks at once: a start speed, positive or negative, hardly moves it from rest."""
    model = Model("sledge")
    mass, drive = model.add("mass", Mass(m=2.0)), model.add("drive", ForceSource())
    guide = model.add("guide", CoulombFriction(coulomb=8.0, v_s=1e-9))
    model.connect(mass.flange, drive.flange, guide.a)
    model.connect(guide.b, model.ground)
    model.input("drive.force", drive.force)
    return model.build(outputs=["mass.position"])


def experiment(system, name: str, speed: float, creep: float = 0.0) -> Experiment:
    """The sledge let go at a speed, its place recorded; the speed is to be found, from one that is 10 % off."""
    force = np.full(TIME.size, 3.0)
    run = system.simulate(
        (0.0, TIME[-1]),
        inputs={"drive.force": (TIME, force)},
        times=TIME,
        initial={"mass.position": 5.0, "mass.velocity": speed},
        rtol=1e-9,
    )
    place = run["mass.position"] + creep * TIME
    signals = {
        "drive.force": RecordedSignal(values=force, unit="N", column="f", measured_unit="N"),
        "mass.position": RecordedSignal(values=place, unit="m", column="x", measured_unit="m"),
    }
    record = Record(name=name, path=Path(name), time=TIME, signals=signals)
    return Experiment(
        record=record,
        inputs=("drive.force",),
        outputs=("mass.position",),
        free=("mass.position", "mass.velocity"),
        start={"mass.velocity": 0.9 * speed},
    )


def test_a_record_that_no_step_improves_keeps_no_other_where_it_is(system):
    """The linearised problem says that a start speed of many km/s makes up for a creep at rest."""
    records = [experiment(system, "creeps", 0.0, creep=2e-3), *(experiment(system, f"at {v}", v) for v in SPEEDS)]
    given = calibrate(system, records, (), noise={"mass.position": 1e-4}, hold=True)
    fits = evaluate(system, records, given, noise={"mass.position": 1e-4}).fits
    assert [f.own["mass.velocity"] for f in fits[1:]] == pytest.approx(SPEEDS, abs=1e-3)


def test_a_response_that_is_known_is_not_simulated_again_for_its_record_alone(system):
    records = [experiment(system, f"at {v}", v) for v in SPEEDS]
    whole = FitProblem(system=system, experiments=records, parameters=[], sensors=(), base=system.p)
    theta = whole.start(None, None)
    known = whole.respond_all(theta, True)
    for i, response in enumerate(known):
        alone = whole.of_record(i)
        here = theta[whole.first[i] : whole.first[i + 1]]
        assert alone.respond_all(here, True)[0] is response
        assert alone.evaluations == 0
        alone.respond_all(1.01 * here, True)
        assert alone.evaluations == 1


def test_a_fit_that_is_known_is_simulated_and_nothing_is_differentiated(system):
    records = [experiment(system, f"at {v}", v) for v in SPEEDS]
    given = calibrate(system, records, (), noise={"mass.position": 1e-4})
    at = simulated_at(system, records, (), values=(), own=given.own_values, scale=given.scale, not_excited=("a mass",))
    assert at.not_excited == ("a mass",)
    assert at.evaluations == len(records)
    for one, other in zip(at.fits, given.fits, strict=True):
        assert np.allclose(one.response.outputs, other.response.outputs, rtol=0.0, atol=1e-9)
        assert one.own == other.own


def test_a_simulation_elsewhere_may_not_take_many_times_as_long(system):
    """At the speed of the fit the sledge comes to rest; from another the law's step stops the integration."""
    fit = calibrate(system, [experiment(system, "one", SPEEDS[0])], (), noise={"mass.position": 1e-4}).fits[0]
    most = SLOWER * TIME.size
    assert fit.response.evaluations < TIME.size, "so few that the samples are counted"
    assert not_much_slower(fit).max_evaluations == most
    with pytest.raises(SimulationError, match=f"more than the {most} allowed"):
        not_much_slower(fit).simulate(system, system.p)
    longer = replace(fit, response=replace(fit.response, evaluations=2 * TIME.size))
    assert not_much_slower(longer).max_evaluations == 2 * most
    limited = replace(fit, experiment=replace(fit.experiment, max_evaluations=TIME.size))
    assert not_much_slower(limited).max_evaluations == TIME.size, "a limit that was set stays"
    unknown = replace(fit, response=replace(fit.response, evaluations=0))
    assert not_much_slower(unknown) is unknown.experiment
