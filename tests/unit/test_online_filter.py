"""A filter that is fed sample by sample gives what the whole record gives: resumed, late, at several rates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimation.filters import (
    FilterError,
    FilterModel,
    FilterRun,
    FilterSamples,
    Noise,
    OnlineFilter,
    OnlineState,
    Prior,
    RandomWalk,
    TimeSeries,
    extended_kalman_filter,
    unscented_kalman_filter,
)
from multibody import Model
from multibody.library import Damper, ForceSource, Mass, Spring

#: Rounding of sums that are taken in another order; the issue asks for 1e-10.
CLOSE = 1e-10


@pytest.fixture(scope="module")
def model() -> FilterModel:
    machine = Model("oscillator")
    body = machine.add("body", Mass(m=2.0))
    spring, damper = machine.add("spring", Spring(stiffness=80.0)), machine.add("damper", Damper(damping=1.5))
    force = machine.add("force", ForceSource())
    for part in (spring, damper):
        machine.connect(part.a, machine.ground)
        machine.connect(part.b, body.flange)
    machine.connect(force.flange, body.flange)
    machine.input("push", force.force)
    walk = RandomWalk("spring.stiffness", rate=2.0, std=8.0)
    return FilterModel(machine.build(), ["body.position", "body.velocity"], [walk])


NOISE = Noise({"body.velocity": 1e-3}, {"body.position": 1e-6, "body.velocity": 1e-3})
PRIOR = Prior({"body.position": 0.02}, {"body.position": 1e-2, "body.velocity": 0.1})


def recording(seed: int = 0, count: int = 300) -> FilterSamples:
    """Uneven instants; the velocity is read at every third, and some positions are missing."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.005, 0.03, count))
    push = np.sin(3.0 * times)
    position = 0.02 * np.cos(6.3 * times) + 1e-3 * rng.standard_normal(count)
    velocity = -0.12 * np.sin(6.3 * times) + 0.03 * rng.standard_normal(count)
    position[rng.random(count) < 0.1] = np.nan
    velocity[np.arange(count) % 3 != 0] = np.nan
    return FilterSamples(times, push, np.column_stack([position, velocity]))


def same(online: OnlineFilter, states: np.ndarray, batch: FilterRun) -> None:
    scale = np.abs(batch.states).max(axis=0)
    assert np.max(np.abs(states - batch.states) / scale) < CLOSE
    assert online.log_likelihood == pytest.approx(batch.log_likelihood, rel=CLOSE)
    assert np.diag(online.covariance) == pytest.approx(batch.variances[-1], rel=CLOSE)


def whole_record(model: FilterModel, samples: FilterSamples, options) -> FilterRun:
    others = {name: value for name, value in options.items() if name != "method"}
    kalman = unscented_kalman_filter if options.get("method") == "unscented" else extended_kalman_filter
    return kalman(model, samples, NOISE, PRIOR, **others)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"once": True},
        {"square_root": True},
        {"discretisation": "variational", "hold": True},
        {"gate": 2.0},
        {"method": "unscented"},
        {"method": "unscented", "hold": True, "alpha": 0.5, "beta": 2.0, "substeps": 3},
    ],
    ids=["plain", "once", "square root", "variational, held", "gate", "unscented", "unscented, scaled"],
)
@pytest.mark.parametrize("size", [1, 7], ids=["one sample", "blocks of seven"])
def test_a_replay_gives_what_the_whole_record_gives(model, options, size):
    samples = recording()
    batch = whole_record(model, samples, options)
    online, states = OnlineFilter(model, NOISE, PRIOR, **options), []
    for k in range(0, samples.count, size):
        rows = slice(k, k + size)
        run = online.step(samples.times[rows], samples.inputs[rows], samples.readings[rows])
        assert run.samples.count == run.innovations.shape[0] == len(samples.times[rows])
        states.append(run.states)
    same(online, np.concatenate(states), batch)
    assert online["spring.stiffness"] == batch["spring.stiffness"][-1]
    assert online.std("spring.stiffness") == pytest.approx(batch.std("spring.stiffness")[-1], rel=CLOSE)


@pytest.mark.parametrize("options", [{}, {"once": True}, {"square_root": True}, {"method": "unscented"}])
def test_a_filter_resumes_to_the_last_bit(model, options, tmp_path: Path):
    samples = recording(1)
    whole = OnlineFilter(model, NOISE, PRIOR, **options)
    whole.step(samples.times, samples.inputs, samples.readings)
    first = OnlineFilter(model, NOISE, PRIOR, **options)
    first.step(samples.times[:137], samples.inputs[:137], samples.readings[:137])
    path = first.state().save(tmp_path / "twin.npz")
    second = OnlineFilter(model, NOISE, resume=OnlineState.load(path), **options)
    second.step(samples.times[137:], samples.inputs[137:], samples.readings[137:])
    assert np.array_equal(second.state().state, whole.state().state)
    assert np.array_equal(second.covariance, whole.covariance)
    assert second.taken == samples.count


@pytest.mark.parametrize("options", [{}, {"method": "unscented"}], ids=["extended", "unscented"])
def test_readings_that_come_late_end_where_they_belong(model, options):
    fast = recording(2)
    stamps = fast.times[5:-1:9] - 1e-3  # between two samples
    late = np.column_stack([stamps, -0.1 * np.sin(6.3 * stamps)])
    position = TimeSeries(fast.times, fast.readings[:, 0])
    channels = {"body.position": position, "body.velocity": TimeSeries(late[:, 0], late[:, 1])}
    merged = FilterSamples.merged(channels, {"push": TimeSeries(fast.times, fast.inputs[:, 0])})
    batch = whole_record(model, merged, options)
    online, waiting = OnlineFilter(model, NOISE, PRIOR, horizon=0.5, **options), list(late)
    for k, t in enumerate(fast.times):
        online.step(t, fast.inputs[k], {"body.position": fast.readings[k, 0]})
        while waiting and t - waiting[0][0] > 0.2:
            stamp, value = waiting.pop(0)
            assert online.late_reading(stamp, {"body.velocity": value})
    for stamp, value in waiting:
        assert online.late_reading(stamp, {"body.velocity": value})
    assert online.taken == merged.count
    assert online.state().state == pytest.approx(batch.states[-1], rel=CLOSE)
    assert online.log_likelihood == pytest.approx(batch.log_likelihood, rel=CLOSE)
    assert online.late == 0
    before = online.state()
    assert not online.late_reading(fast.times[-1] - 0.6, {"body.velocity": 0.0})
    assert online.late == 1
    assert np.array_equal(online.state().state, before.state)


@pytest.mark.parametrize("method", ["extended", "unscented"])
def test_a_late_reading_at_a_known_instant_joins_its_sample(model, method):
    samples = recording(3, 60)
    without = samples.readings.copy()
    without[30] = np.nan
    online = OnlineFilter(model, NOISE, PRIOR, horizon=10.0, method=method)
    online.step(samples.times, samples.inputs, without)
    value = 0.011
    assert online.late_reading(samples.times[30], {"body.position": value})
    without[30, 0] = value
    batch = whole_record(model, FilterSamples(samples.times, samples.inputs, without), {"method": method})
    assert online.state().state == pytest.approx(batch.states[-1], rel=CLOSE)
    assert online.taken == 60


def test_without_readings_a_step_is_a_simulation(model):
    times = np.arange(400) * 0.005
    online = OnlineFilter(model, NOISE, PRIOR)  # the mean of the unscented filter's points is no simulation
    run = online.step(times, np.zeros(400))
    trajectory = model.system.simulate(times[-1], initial={"body.position": 0.02}, times=times, inputs={"push": 0.0})
    # Runge and Kutta's method at 5 ms against the solver's tolerance of 1e-8
    assert np.max(np.abs(run["body.position"] - trajectory["body.position"])) < 1e-6


@pytest.mark.parametrize("method", ["extended", "unscented"])
def test_what_does_not_fit_is_refused_and_changes_nothing(model, method, tmp_path: Path):
    online = OnlineFilter(model, NOISE, PRIOR, method=method)
    with pytest.raises(FilterError, match="first sample needs its inputs push"):
        online.step(0.0)
    online.step(0.0, 0.0, {"body.position": 0.02})
    online.step(0.1)  # inputs as before
    state = online.state()
    with pytest.raises(FilterError, match=r"not later than the last sample, 0\.1 s.*late_reading"):
        online.step(0.1, 0.0)
    with pytest.raises(FilterError, match=r"'body.positoin' is not measured.*body.position"):
        online.step(0.2, 0.0, {"body.positoin": 1.0})
    with pytest.raises(FilterError, match="3 numbers for 1 samples of 2"):
        online.step(0.2, 0.0, [1.0, 2.0, 3.0])
    with pytest.raises(FilterError, match="u has 2 numbers"):
        online.step(0.2, [0.0, 1.0])
    with pytest.raises(FilterError, match=r"not before 0\.1 s"):
        online.late_reading(0.3, {"body.position": 0.0})
    assert np.array_equal(online.state().state, state.state)
    path = state.save(tmp_path / "state.npz")
    other = Noise({"body.velocity": 2e-3}, {"body.position": 1e-6, "body.velocity": 1e-3})
    with pytest.raises(FilterError, match="belongs to another model"):
        OnlineFilter(model, other, method=method, resume=OnlineState.load(path))
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(FilterError, match="no saved state"):
        OnlineState.load(path)
    replace(state, state=np.full_like(state.state, np.nan)).save(path)
    with pytest.raises(FilterError, match=r"not finite \(state\): start the filter anew"):
        OnlineState.load(path)


@pytest.mark.parametrize("method", ["extended", "unscented"])
def test_a_filter_that_diverges_keeps_its_state(model, method):
    online = OnlineFilter(model, NOISE, PRIOR, method=method)
    online.step(0.0, 0.0, {"body.position": 0.02})
    before = online.state()
    with pytest.raises(RuntimeError, match="diverged"):
        online.step(0.1, 1e308, {"body.position": 1e308})
    after = online.state()
    assert np.array_equal(after.state, before.state)
    assert after.time == before.time
    assert replace(after, taken=0).names == before.names


def test_options_of_the_other_filter_are_refused(model):
    with pytest.raises(FilterError, match=r"unscented filter has no once(.|\n)*has no gate"):
        OnlineFilter(model, NOISE, PRIOR, method="unscented", once=True, gate=3.0)
    with pytest.raises(FilterError, match="extended filter has no alpha"):
        OnlineFilter(model, NOISE, PRIOR, alpha=0.5)
    with pytest.raises(FilterError, match="take one of extended, unscented"):
        OnlineFilter(model, NOISE, PRIOR, method="particle")
    twin = OnlineFilter(model, NOISE, PRIOR, method="unscented")
    with pytest.raises(FilterError, match="no Jacobians"):
        twin.step(0.0, 0.0, keep="everything")
    with pytest.raises(FilterError, match="belongs to another model, other parameters, noise or settings"):
        OnlineFilter(model, NOISE, resume=twin.state())
