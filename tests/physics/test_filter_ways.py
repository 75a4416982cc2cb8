"""Faster ways through the extended filter give what the slower ones give: on the cabin of the lift with its δ."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.filters import FilterModel, FilterSamples, Noise, Prior, RandomWalk, extended_kalman_filter
from vtsdt.alignment.filter import DELTA, TUNINGS, GuideFilter
from vtsdt.alignment.trips import Trip
from vtsdt.files.parameters import LiftParameters
from vtsdt.lift.lift import Lift

COUNT = 1500


@pytest.fixture(scope="module")
def problem():
    """The first 1.5 s of a trip at 1 kHz: the start, contacts closing, speed rising."""
    run = Lift.reference().trip("up", until=1.5, step=1e-3, rtol=1e-5, atol=1e-8)
    trip = Trip(name="up", time=run.times, tension=run["F_c"], height=run["z_c"], acceleration=run["zdd_c"])
    sensor = GuideFilter(parameters=LiftParameters.bench(), tuning=TUNINGS["bounded"])
    names = {name.rpartition(".")[2]: name for name in sensor.system.state_names}
    process = {names[k]: v for k, v in sensor.tuning.process.items() if k != "delta"}
    noise = Noise({**process, DELTA: 1e-3}, {"z_c": 1e-4, "zdd_c": 1e-7}, "density_times_step")
    samples = FilterSamples(trip.time, trip.tension, np.column_stack([trip.height, trip.acceleration]))
    return sensor, samples, noise, sensor.prior(trip)


def test_all_directions_at_once_give_what_one_after_another_gives(problem, monkeypatch):
    sensor, samples, noise, prior = problem
    fast = extended_kalman_filter(sensor.model(), samples, noise, prior, keep="covariances")
    monkeypatch.setattr("multibody.compile.vector_mode.along_directions", lambda tangent, count: None)
    slow = extended_kalman_filter(sensor.model(), samples, noise, prior, keep="covariances")
    assert np.abs(fast[DELTA] - slow[DELTA]).max() < 1e-9
    assert np.abs(fast.states - slow.states).max() < 1e-8
    scale = np.sqrt(np.einsum("ki,kj->kij", slow.variances, slow.variances))
    assert np.abs((fast.covariances - slow.covariances) / scale).max() < 1e-6


def test_central_differences_give_what_exact_derivatives_give(problem):
    """The paper's way: δ to 0.1 µm."""
    sensor, samples, noise, prior = problem
    exact = sensor.model()
    central = FilterModel(
        exact.system,
        exact.measured,
        exact.latents,
        jacobian="central",
        bounds={DELTA: tuple(exact.bounds[exact.index(DELTA)] + exact.nominal(DELTA))},
    )
    a, b = (extended_kalman_filter(model, samples, noise, prior) for model in (exact, central))
    assert np.abs(a[DELTA] - b[DELTA]).max() < 1e-7


def test_one_linearisation_a_sample_gives_what_two_give(problem):
    """As `vtsdt align` takes it: δ to 2 % of its own standard deviation in the root mean square."""
    sensor, samples, noise, prior = problem
    two, one = (extended_kalman_filter(sensor.model(), samples, noise, prior, once=once) for once in (False, True))
    off = np.sqrt(np.mean(((one[DELTA] - two[DELTA]) / two.std(DELTA)) ** 2))
    assert off < 0.02


def test_outputs_that_are_no_states_are_differentiated_at_once_too(monkeypatch):
    """A measured energy of a spring: its row comes from the tangent of the outputs."""
    from multibody import Model
    from multibody.library import Mass, Spring

    model = Model("oscillator")
    body = model.add("body", Mass(m=1.0))
    spring = model.add("spring", Spring(stiffness=30.0))
    model.connect(spring.a, model.ground)
    model.connect(spring.b, body.flange)
    system = model.build(outputs=["spring.energy"])
    times = np.arange(200) * 0.01
    y = 15.0 * (0.1 * np.cos(np.sqrt(30.0) * times)[:, None]) ** 2
    joint = FilterModel(system, ["spring.energy"], [RandomWalk("spring.stiffness", rate=0.1, std=3.0)])
    given = (
        joint,
        FilterSamples(times, np.zeros((200, 0)), y),
        Noise({"body.velocity": 1e-6}, {"spring.energy": 1e-6}),
        Prior({"body.position": 0.1}, {"body.position": 0.01, "body.velocity": 0.1}),
    )
    fast = extended_kalman_filter(*given)
    monkeypatch.setattr("multibody.compile.vector_mode.along_directions", lambda tangent, count: None)
    np.testing.assert_allclose(fast.states, extended_kalman_filter(*given).states, rtol=1e-12, atol=1e-14)
