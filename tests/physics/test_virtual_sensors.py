"""Forces that nobody measures, along what a filter estimated: against a simulation that has them."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.filters import FilterError, virtual_sensors
from vtsdt.alignment.filter import TUNINGS, GuideFilter
from vtsdt.alignment.trips import Trip
from vtsdt.files.parameters import LiftParameters
from vtsdt.lift.lift import Lift


@pytest.fixture(scope="module")
def trip_and_truth():
    """A trip of the reference model with noise of its sensors."""
    from estimation.signals.preparation import low_pass

    run = Lift.reference().trip("up", step=2e-3, rtol=1e-5, atol=1e-8)
    rng = np.random.default_rng(3)
    raw = np.column_stack([run["F_c"], run["z_c"], run["zdd_c"]])
    raw += np.array([0.3, 2e-5, 0.01]) * rng.standard_normal(raw.shape)
    tension, height, acceleration = low_pass(run.times, raw, 60.0).T
    return Trip(name="up", time=run.times, tension=tension, height=height, acceleration=acceleration), run


def test_friction_and_normal_force_of_the_guides_come_out(trip_and_truth):
    trip, truth = trip_and_truth
    sensor = GuideFilter(parameters=LiftParameters.bench(), tuning=TUNINGS["quiet"], forces=("fric_c", "Nsum_c"))
    found = virtual_sensors(sensor.run(trip, keep="covariances"), ["fric_c", "Nsum_c"], every=5)
    moving = np.abs(trip.speed[::5]) > 0.2
    for name, bound in (("fric_c", 0.6), ("Nsum_c", 4.0)):
        true, error = truth[name][::5], found[name] - truth[name][::5]
        assert np.sqrt(np.mean(error[moving] ** 2)) < bound
        assert np.corrcoef(found[name][moving], true[moving])[0, 1] > 0.9
        assert np.mean(np.abs(error[moving]) < 3.0 * found.std(name)[moving]) > 0.9
    assert list(found.to_frame().columns)[:2] == ["fric_c [N]", "std of fric_c [N]"]
    assert len(found.plot().axes) == 2


def test_the_spread_is_that_of_moving_the_estimate_by_its_covariance(trip_and_truth):
    """Against outputs at states drawn from the filter's own distribution."""
    trip, _ = trip_and_truth
    sensor = GuideFilter(parameters=LiftParameters.bench(), tuning=TUNINGS["quiet"], forces=("Nsum_c",))
    run = sensor.run(trip, keep="covariances")
    k = trip.time.size // 2
    said = virtual_sensors(run, ["Nsum_c"], every=k).std("Nsum_c")[1]
    rng, system, at = np.random.default_rng(0), run.model.system, run.model.readouts[0][2]
    drawn = []
    for z in rng.multivariate_normal(run.states[k], 1e-4 * run.covariances[k], 4000):
        p = run.model.p.copy()
        p[at] += z[12]
        drawn.append(system.outputs_at(0.0, z[:12].copy(), run.samples.inputs[k], p)[2])
    assert 1e2 * np.std(drawn) == pytest.approx(said, rel=0.05)


def test_without_covariances_there_is_no_spread_and_unknown_outputs_are_named(trip_and_truth):
    trip, _ = trip_and_truth
    sensor = GuideFilter(parameters=LiftParameters.bench(), tuning=TUNINGS["quiet"], forces=("fric_c",))
    run = sensor.run(trip)
    assert np.isnan(virtual_sensors(run, ["fric_c"], every=500).stds).all()
    with pytest.raises(FilterError, match="built without the output 'friction_c'"):
        virtual_sensors(run, ["friction_c"])
