"""What the model says passes by holds wherever it is integrated: in batches, fits, transitions and filters as well."""

from __future__ import annotations

import math
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from estimation.files.record import Record, RecordedSignal
from estimation.filters import FilterModel, FilterSamples, Noise, extended_kalman_filter, unscented_kalman_filter
from estimation.response.experiment import Experiment
from estimation.response.perturbations import PerturbationResponse
from multibody import Component, Model, Output, Parameter, Translation
from multibody.library import Mass
from multibody.solvers import DormandPrince54, integrate
from multibody.solvers.batch import batch
from multibody.system.narrow_features import step_limits
from multibody.system.simulate import input_table, native_problem

TIMES = np.arange(9) * 0.125  # a step from one to the next goes past the spot, which is over within 10 ms


class TightSpot(Component):
    """Holds back what goes past one place, over a length of a centimetre."""

    level = Parameter(50.0, "N", "force in the middle of the spot")
    width = Parameter(0.01, "m", "half width of the spot")
    a = Translation("what goes past")
    speed = Output("m/s", "how fast")
    features: ClassVar[dict[str, str]] = {"width": "speed"}

    def equations(self):
        self.speed = self.a.velocity
        s = (self.a.position - 1.06) / self.width
        self.a.force = -self.level * math.exp(-s * s)


@pytest.fixture(scope="module")
def system():
    model = Model("coasting past a tight spot")
    body = model.add("body", Mass(m=1.0, velocity=2.0))
    spot = model.add("spot", TightSpot())
    model.connect(spot.a, body.flange)
    return model.build()


@pytest.fixture(scope="module")
def exact(system):
    """States at `TIMES` for some forces of the spot."""

    def states(level):
        done = system.simulate(TIMES[-1], times=TIMES, parameters={"spot.level": level}, max_step=1e-4, rtol=1e-10)
        return done.states

    return states


def test_one_place_says_what_passes_by_and_it_is_needed(system, exact):
    limits = step_limits(system, system.p)
    assert limits.widths == {"spot.speed": 0.01}
    assert limits.largest_step == math.inf
    missed = system.simulate(TIMES[-1], times=TIMES, rtol=1e-3, max_step=1.0, method="Rodas5P").states[-1, 1]
    assert missed == pytest.approx(2.0, abs=1e-9)
    assert exact(50.0)[-1, 1] < 1.6


@pytest.mark.parametrize("method", [DormandPrince54, "Rodas5P", "Automatic"])
def test_a_batch_goes_past_what_its_own_parameters_say(system, exact, method):
    from multibody import solvers

    method = getattr(solvers, method) if isinstance(method, str) else method
    table, levels = input_table(system, {}), np.linspace(20.0, 60.0, 9)

    def problems():
        for level in levels:
            p = system.parameter_vector({"spot.level": level})
            yield native_problem(system, p, table, tangent=True), system.start

    for run, level in zip(batch(problems(), (0.0, TIMES[-1]), TIMES, 2, method=method), levels, strict=True):
        np.testing.assert_allclose(run.y.T, exact(level), rtol=3e-3, atol=1e-3)


def test_a_fit_sees_it_and_its_derivatives(system, exact):
    signals = {"body.velocity": RecordedSignal(values=exact(50.0)[:, 1], unit="m/s", column="v", measured_unit="m/s")}
    experiment = Experiment(
        record=Record(name="trip", path=Path("trip.csv"), time=TIMES, signals=signals),
        inputs=(),
        outputs=("body.velocity",),
        rtol=1e-4,
    )
    response = experiment.respond(system, system.p, parameters=["spot.level"])
    np.testing.assert_allclose(response.outputs[:, 0], exact(50.0)[:, 1], rtol=1e-3)
    slope = (exact(50.1)[-1, 1] - exact(49.9)[-1, 1]) / 0.2
    assert response.derivatives[-1, 0, 0] == pytest.approx(slope, rel=1e-2)
    assert slope < -5e-3


def test_transitions_from_sample_to_sample_go_past_it(system, exact):
    signals = {"body.velocity": RecordedSignal(values=exact(50.0)[:, 1], unit="m/s", column="v", measured_unit="m/s")}
    experiment = Experiment(
        record=Record(name="trip", path=Path("trip.csv"), time=TIMES, signals=signals),
        inputs=(),
        outputs=("body.velocity",),
    )
    response = PerturbationResponse.along(experiment.simulation(system, system.p, system.start), ())
    ends = []
    for sign in (1.0, -1.0):
        start = dict(zip(system.state_names, system.start + sign * np.array([1e-4, 0.0]), strict=True))
        ends.append(system.simulate(TIMES[-1], times=TIMES, initial=start, max_step=1e-4, rtol=1e-10).states[-1])
    whole = np.linalg.multi_dot(response.phi[::-1])
    np.testing.assert_allclose(whole[:, 0], (ends[0] - ends[1]) / 2e-4, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("kalman", [extended_kalman_filter, unscented_kalman_filter])
def test_a_filter_carries_its_states_past_it(system, exact, kalman):
    samples = FilterSamples(TIMES, np.zeros((TIMES.size, len(system.inputs))), np.full((TIMES.size, 1), np.nan))
    model = FilterModel(system, ["body.position"])
    run = kalman(model, samples, Noise(1e-12 * np.eye(2), np.ones(1)))
    np.testing.assert_allclose(run.states[-1], exact(50.0)[-1], rtol=2e-2)


def test_a_largest_step_that_is_no_time_is_refused(system):
    from dataclasses import replace

    problem = native_problem(system, system.p, input_table(system, {}))
    with pytest.raises(ValueError, match="largest step must be positive, it is 0"):
        replace(problem, largest_step=0.0)
    short = replace(problem, largest_step=0.01)
    assert integrate(short, (0.0, 0.3), system.start, [0.3]).longest_step <= 0.01
