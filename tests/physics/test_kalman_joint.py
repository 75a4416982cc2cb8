"""States, parameters and forces nobody measures, estimated together; and what the filter says of its own errors."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.filters import (
    FilterModel,
    FilterSamples,
    Matern32,
    Noise,
    OrnsteinUhlenbeck,
    Prior,
    RandomWalk,
    extended_kalman_filter,
    nees,
    observability,
    tune,
    unscented_kalman_filter,
)

STEP = 0.01


def carriage(outputs=("body.position", "body.velocity")):
    """A mass on a spring with viscous friction, pulled by a force; a second force disturbs it."""
    from multibody import Model
    from multibody.library import ForceSource, Mass, Spring, ViscousFriction

    model = Model("carriage")
    body = model.add("body", Mass(m=2.0))
    spring = model.add("spring", Spring(stiffness=80.0))
    guide = model.add("guide", ViscousFriction(viscous=3.0))
    model.connect(spring.a, model.ground)
    model.connect(spring.b, body.flange)
    model.connect(guide.a, model.ground)
    model.connect(guide.b, body.flange)
    for name in ("force", "disturbance"):
        source = model.add(name, ForceSource())
        model.connect(source.flange, body.flange)
        model.input(name, source.force, default=0.0)
    return model.build(outputs=list(outputs))


@pytest.fixture(scope="module")
def system():
    return carriage()


def forced(count: int, rng) -> np.ndarray:
    """Inputs: a slowly varying force, no disturbance."""
    slow = np.convolve(rng.standard_normal(count), np.ones(30) / 30.0, "same")
    return np.column_stack([40.0 * slow, np.zeros(count)])


def stochastic(system, seed: int, count: int = 600, stiffness_rate: float = 0.0):
    """Truth and readings of exactly the model that the filter assumes: noise at every step, held inputs."""
    rng = np.random.default_rng(seed)
    inputs = forced(count, rng)
    q = np.array([1e-9, 1e-5])
    x = np.array([0.02, 0.0]) + np.array([2e-3, 1e-2]) * rng.standard_normal(2)
    stiffness = 80.0 + 8.0 * rng.standard_normal()
    p, truth = system.p.copy(), []
    at = system.index("parameter", "spring.stiffness")
    for k in range(count):
        if k:
            p[at] = stiffness
            x = rk4(system, x, inputs[k - 1], p) + np.sqrt(q) * rng.standard_normal(2)
            stiffness += np.sqrt(stiffness_rate) * rng.standard_normal()
        truth.append([*x, stiffness - 80.0])
    truth = np.array(truth)
    readings = truth[:, :1] + 1e-4 * rng.standard_normal((count, 1))
    return FilterSamples(np.arange(count) * STEP, inputs, readings), truth, q


def rk4(system, x, u, p):
    k1 = system.rhs(0.0, x, u, p)
    k2 = system.rhs(0.0, x + 0.5 * STEP * k1, u, p)
    k3 = system.rhs(0.0, x + 0.5 * STEP * k2, u, p)
    k4 = system.rhs(0.0, x + STEP * k3, u, p)
    return x + STEP / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4)


def joint(system, rate=0.04):
    model = FilterModel(system, ["body.position"], [RandomWalk("spring.stiffness", rate=1.0, std=8.0)])
    process = {"body.position": 1e-9, "body.velocity": 1e-5, "spring.stiffness": rate}
    return model, Noise(process, {"body.position": 1e-8}, "per_step")


PRIOR = Prior({"body.position": 0.02}, {"body.position": 2e-3, "body.velocity": 1e-2, "spring.stiffness": 8.0})


@pytest.mark.parametrize("method", ["extended", "unscented"])
def test_nees_and_nis_lie_within_their_bounds_where_the_assumptions_hold(system, method):
    model, noise = joint(system)
    runs, truths = [], []
    for seed in range(40):
        samples, truth, _ = stochastic(system, seed, 300, stiffness_rate=0.04)
        if method == "extended":
            runs.append(extended_kalman_filter(model, samples, noise, PRIOR, hold=True, keep="covariances"))
        else:
            runs.append(unscented_kalman_filter(model, samples, noise, PRIOR, hold=True, covariances=True))
        truths.append(truth)
    found = nees(runs, truths)
    # Instants are correlated, so the share inside wanders about 95 %; the mean over time is near one.
    assert found.inside > 0.88
    assert found.values.mean() == pytest.approx(1.0, abs=0.1)
    inside = [
        run.consistency().nis_bounds[0] <= run.consistency().nis <= run.consistency().nis_bounds[1] for run in runs
    ]
    assert sum(inside) >= 34  # of 40 at 95 %: 33 or fewer has a chance of 0.4 %
    white = [min(run.consistency().whiteness.values()) > 0.05 for run in runs]
    assert sum(white) >= 34


def test_nees_over_all_runs_lies_within_its_bounds_at_single_instants(system):
    """Instants far apart are independent: the statistic of each is chi-squared."""
    model, noise = joint(system)
    runs, truths = [], []
    for seed in range(100, 140):
        samples, truth, _ = stochastic(system, seed, 201, stiffness_rate=0.04)
        runs.append(extended_kalman_filter(model, samples, noise, PRIOR, hold=True, keep="covariances"))
        truths.append(truth)
    found = nees(runs, truths)
    low, high = found.bounds
    assert all(low <= found.values[k] <= high for k in (0, 100, 200))


def test_a_filter_that_trusts_its_model_too_much_is_found_out(system):
    model, _ = joint(system)
    samples, _, _ = stochastic(system, 1, stiffness_rate=0.04)
    vain = Noise({"body.position": 1e-13, "body.velocity": 1e-9}, {"body.position": 1e-8}, "per_step")
    said = extended_kalman_filter(model, samples, vain, PRIOR, hold=True).consistency()
    assert not said.consistent
    assert any("larger than the filter predicts" in sentence for sentence in said.sentences())
    shy = Noise({"body.position": 1e-5, "body.velocity": 1e-1}, {"body.position": 1e-5}, "per_step")
    said = extended_kalman_filter(model, samples, shy, PRIOR, hold=True).consistency()
    assert any("smaller than" in s for s in said.sentences())


def test_constant_parameter_is_found_and_smoothing_narrows_it(system):
    model, noise = joint(system, rate=0.0)
    samples, truth, _ = stochastic(system, 7, 1500)
    run = extended_kalman_filter(model, samples, noise, PRIOR, hold=True, keep="everything")
    true = 80.0 + truth[-1, 2]
    assert abs(run["spring.stiffness"][-1] - true) < 3.0 * run.std("spring.stiffness")[-1]
    assert run.std("spring.stiffness")[-1] < 1.0
    smoothed = run.smooth()
    assert np.all(smoothed.std("body.velocity")[:-1] <= run.std("body.velocity")[:-1] * (1 + 1e-9))
    error = np.abs(smoothed["body.velocity"] - truth[:, 1])
    assert np.sqrt(np.mean(error**2)) < 0.8 * np.sqrt(np.mean((run["body.velocity"] - truth[:, 1]) ** 2))
    assert np.mean(error < 2.0 * smoothed.std("body.velocity")) > 0.9


def test_unscented_and_extended_agree_where_the_machine_is_nearly_linear(system):
    model, noise = joint(system)
    samples, _, _ = stochastic(system, 3, stiffness_rate=0.04)
    narrow = Prior({"body.position": 0.02}, {"body.position": 1e-4, "body.velocity": 1e-3, "spring.stiffness": 1.0})
    a = extended_kalman_filter(model, samples, noise, narrow, hold=True)
    b = unscented_kalman_filter(model, samples, noise, narrow, hold=True)
    for name in model.state_names:
        assert np.abs(a[name] - b[name]).max() < 0.05 * a.std(name)[50:].max()


@pytest.mark.parametrize(
    "latent",
    [
        RandomWalk("disturbance", rate=200.0, std=1.0),
        OrnsteinUhlenbeck("disturbance", std=5.0, time=0.5),
        Matern32("disturbance", std=5.0, time=0.4),
    ],
)
def test_a_force_that_nobody_measures_comes_out(system, latent):
    """Truth from a full simulation with a disturbance of known shape."""
    times = np.arange(800) * STEP
    hidden = 6.0 * np.sin(2.0 * np.pi * 0.5 * times) * (times > 2.0)
    force = 5.0 * np.cos(1.3 * times)
    run = system.simulate(
        (0.0, times[-1]), inputs={"force": (times, force), "disturbance": (times, hidden)}, times=times, rtol=1e-9
    )
    rng = np.random.default_rng(0)
    readings = run["body.position"][:, None] + 2e-5 * rng.standard_normal((times.size, 1))
    model = FilterModel(system, ["body.position"], [latent])
    found = extended_kalman_filter(
        model,
        FilterSamples(times, np.column_stack([force, np.zeros(times.size)]), readings),
        Noise({"body.velocity": 1e-8}, {"body.position": 4e-10}),
        Prior(std={"body.velocity": 0.1}),
        keep="everything",
    )
    smoothed = found.smooth()
    middle = slice(50, 750)
    error = smoothed["disturbance"][middle] - hidden[middle]
    assert np.sqrt(np.mean(error**2)) < 0.8
    assert np.corrcoef(smoothed["disturbance"][middle], hidden[middle])[0, 1] > 0.98
    assert np.sqrt(np.mean(error**2)) < np.sqrt(np.mean((found["disturbance"][middle] - hidden[middle]) ** 2))


@pytest.mark.parametrize("method", ["likelihood", "em"])
def test_tuning_finds_the_noise_that_made_the_record(system, method):
    samples = [stochastic(system, seed, 1500)[0] for seed in (11, 12)]
    model = FilterModel(system, ["body.position"], [RandomWalk("spring.stiffness", std=8.0)])
    wrong = Noise({"body.position": 1e-9, "body.velocity": 1e-3}, {"body.position": 1e-6}, "per_step")
    found = tune(
        model,
        samples,
        wrong,
        PRIOR,
        process=["body.velocity"],
        measurement=["body.position"],
        method=method,
        steps=60,
        hold=True,
    )
    table = found.to_frame()["tuned"]
    assert table["measurement body.position"] == pytest.approx(1e-8, rel=0.15)
    assert table["process body.velocity"] == pytest.approx(1e-5, rel=0.4)
    assert found.log_likelihoods[-1] > found.log_likelihoods[0]


def test_what_the_sensors_cannot_tell_is_named(system):
    """Two forces on the same mass: only their sum shows, and their difference does not decay."""
    twins = [
        RandomWalk("force", rate=10.0, std=1.0, name="one"),
        RandomWalk("disturbance", rate=10.0, std=1.0, name="other"),
    ]
    model = FilterModel(system, ["body.position"], twins)
    samples, _, _ = stochastic(system, 5, 900)
    noise = Noise({"body.velocity": 1e-5}, {"body.position": 1e-8})
    seen = observability(extended_kalman_filter(model, samples, noise, keep="everything"), window=200)
    assert not seen.detectable
    assert seen.rank == 3
    assert {name for name, _ in seen.undetectable[0].states} == {"one", "other"}
    assert not seen.bounded("one")
    assert seen.bounded("body.position")
    alone = FilterModel(system, ["body.position"], twins[:1])
    seen = observability(extended_kalman_filter(alone, samples, noise, keep="everything"), window=200)
    assert seen.detectable
    assert seen.rank == 3
    assert seen.bounded("one")


def test_gate_keeps_wild_readings_out(system):
    model, noise = joint(system)
    samples, truth, _ = stochastic(system, 2, stiffness_rate=0.04)
    wild = samples.readings.copy()
    wild[::50, 0] += 0.5
    spoiled = FilterSamples(samples.times, samples.inputs, wild)
    open_, gated = (extended_kalman_filter(model, spoiled, noise, PRIOR, hold=True, gate=g) for g in (None, 5.0))
    assert gated.refused == 12
    away = [np.abs(run["body.position"] - truth[:, 0]).max() for run in (open_, gated)]
    assert away[1] < 0.01 * away[0]
