"""Where the machine is linear, the compiled filters are the textbook's: to 1e-10, with gaps, rates and delays."""

from __future__ import annotations

import numpy as np
import pytest

from estimation.filters import (
    FilterModel,
    FilterSamples,
    LinearModel,
    Noise,
    Prior,
    RandomWalk,
    TimeSeries,
    extended_kalman_filter,
    kalman_filter,
    rauch_tung_striebel,
    unscented_kalman_filter,
)
from estimation.filters.linear_kalman import van_loan

STEP = 0.01
COUNT = 300


def oscillator(compiled: bool = True):
    """A mass on a spring and a damper, pulled by a force; states position and velocity."""
    from multibody import Model
    from multibody.library import Damper, ForceSource, Mass, Spring

    model = Model("oscillator")
    body = model.add("body", Mass(m=2.0))
    spring = model.add("spring", Spring(stiffness=200.0))
    damper = model.add("damper", Damper(damping=1.5))
    push = model.add("push", ForceSource())
    for part in (spring, damper):
        model.connect(part.a, model.ground)
        model.connect(part.b, body.flange)
    model.connect(push.flange, body.flange)
    model.input("force", push.force)
    return model.build(outputs=["body.position", "body.acceleration"], compiled=compiled)


def problem(system, measured=("body.position", "body.acceleration")):
    """A linear model with the force held, random readings with a gap, and the same for the compiled filter."""
    linear = system.linearize()
    rows = [system.index("output", name) for name in measured]
    from scipy.linalg import expm

    whole = np.zeros((3, 3))
    whole[:2, :2], whole[:2, 2:] = linear.A, linear.B
    moved = expm(whole * STEP)
    q, r = np.diag([1e-6, 1e-3]), np.array([1e-4, 0.3])[: len(measured)]
    model = LinearModel(F=moved[:2, :2], H=linear.C[rows], Q=q, R=np.diag(r), G=moved[:2, 2:], D=linear.D[rows])
    rng = np.random.default_rng(4)
    force = rng.standard_normal((COUNT, 1))
    readings = 0.1 * rng.standard_normal((COUNT, len(measured)))
    readings[40:55] = np.nan
    readings[100:140, -1] = np.nan
    prior = np.array([0.05, -0.2]), np.array([[0.2, 0.05], [0.05, 0.4]])
    samples = FilterSamples(np.arange(COUNT) * STEP, force, readings)
    return model, samples, Noise(q, r, "per_step"), prior


@pytest.mark.parametrize("jacobian", ["exact", "central"])
@pytest.mark.parametrize("square_root", [False, True])
def test_extended_filter_is_the_closed_form_filter(jacobian, square_root):
    system = oscillator()
    linear, samples, noise, (x, p) = problem(system)
    wanted = kalman_filter(linear, samples.readings, x, p, samples.inputs)
    model = FilterModel(system, ["body.position", "body.acceleration"], jacobian=jacobian)
    run = extended_kalman_filter(
        model,
        samples,
        noise,
        Prior(x, covariance=p),
        hold=True,
        substeps=20,
        keep="everything",
        square_root=square_root,
    )
    assert np.abs(run.states - wanted.states).max() < 1e-10
    assert np.abs(run.predicted - wanted.predicted).max() < 1e-10
    assert np.abs(run.covariances - wanted.covariances).max() < 1e-10
    assert run.log_likelihood == pytest.approx(wanted.log_likelihood, abs=1e-7)
    smoothed = run.smooth()
    states, covariances = rauch_tung_striebel(linear, wanted)
    assert np.abs(smoothed.states - states).max() < 1e-10
    assert np.abs(smoothed.covariances - covariances).max() < 1e-10


def test_unscented_and_variational_filters_are_the_closed_form_filter():
    system = oscillator()
    linear, samples, noise, (x, p) = problem(system)
    wanted = kalman_filter(linear, samples.readings, x, p, samples.inputs)
    model = FilterModel(system, ["body.position", "body.acceleration"])
    prior = Prior(x, covariance=p)
    for run in (
        unscented_kalman_filter(model, samples, noise, prior, hold=True, substeps=20, covariances=True),
        extended_kalman_filter(
            model, samples, noise, prior, hold=True, substeps=20, discretisation="variational", keep="covariances"
        ),
    ):
        assert np.abs(run.states - wanted.states).max() < 1e-10
        assert np.abs(run.covariances - wanted.covariances).max() < 1e-10


def test_plain_python_gives_the_same():
    system = oscillator(compiled=False)
    linear, samples, noise, (x, p) = problem(system)
    wanted = kalman_filter(linear, samples.readings, x, p, samples.inputs)
    model = FilterModel(system, ["body.position", "body.acceleration"])
    run = extended_kalman_filter(model, samples, noise, Prior(x, covariance=p), hold=True, substeps=20)
    assert np.abs(run.states - wanted.states).max() < 1e-10


def test_smoothed_states_are_those_of_one_large_least_squares_problem():
    """Independent of any recursion: the posterior mean of all states at once."""
    linear, samples, _, (x, p) = problem(oscillator(), ("body.position",))
    count = 40
    y, u = samples.readings[60 : 60 + count], samples.inputs[60 : 60 + count]
    run = kalman_filter(linear, y, x, p, u)
    states, covariances = rauch_tung_striebel(linear, run)
    n = 2
    information, right = np.zeros((n * count, n * count)), np.zeros(n * count)
    information[:n, :n] += np.linalg.inv(p)
    right[:n] += np.linalg.solve(p, x)
    for k in range(count):
        at = slice(n * k, n * k + n)
        rows = linear.H / linear.R[0, 0]
        information[at, at] += linear.H.T @ rows
        right[at] += rows[0] * (y[k, 0] - linear.D[0, 0] * u[k, 0])
        if k:
            both = slice(n * k - n, n * k + n)
            step = np.hstack([-linear.F, np.eye(n)])
            weighted = step.T @ np.linalg.inv(linear.Q)
            information[both, both] += weighted @ step
            right[both] += weighted @ (linear.G[:, 0] * u[k - 1, 0])
    assert np.allclose(states.ravel(), np.linalg.solve(information, right), atol=1e-9)
    whole = np.linalg.inv(information)
    assert np.allclose(covariances[7], whole[14:16, 14:16], rtol=1e-6, atol=1e-12)


def test_discretisations_converge_and_the_exponential_is_exact_for_a_linear_machine():
    system = oscillator()
    model = FilterModel(system, ["body.position"])
    a = system.linearize().A
    density = np.diag([0.0, 0.3])
    errors = {}
    for step in (0.001, 0.0005):
        samples = FilterSamples(np.arange(3) * step, np.zeros((3, 1)), np.full((3, 1), np.nan))
        from scipy.linalg import expm

        f, q = expm(a * step), van_loan(a, density, step)
        p = np.diag([1e-3, 1e-2])
        wanted = f @ (f @ p @ f.T + q) @ f.T + q
        for how in ("exponential", "euler", "variational"):
            run = extended_kalman_filter(
                model,
                samples,
                Noise(density, np.array([1.0])),
                Prior(covariance=p),
                discretisation=how,
                keep="everything",
                substeps=8,
            )
            errors[how, step] = np.abs(run.kept["transitions"][1] - f).max()
            if how == "exponential":
                errors["noise", step] = np.abs(run.covariances[2] - wanted).max()
    assert errors["exponential", 0.001] < 1e-12
    assert errors["variational", 0.001] < 1e-6
    assert errors["euler", 0.001] / errors["euler", 0.0005] == pytest.approx(4.0, rel=0.1)
    # The trapezoidal rule leaves an error of third order in the step.
    assert errors["noise", 0.001] / errors["noise", 0.0005] == pytest.approx(8.0, rel=0.2)


def test_rates_and_delays_are_undone():
    """Slow, late readings give what the same readings give on one axis without delay."""
    system = oscillator()
    _, samples, noise, (x, p) = problem(system)
    times, delay = samples.times, 0.004
    model = FilterModel(system, ["body.position", "body.acceleration"])
    slow = slice(3, None, 5)
    merged = FilterSamples.merged(
        {
            "body.position": TimeSeries(times, samples.readings[:, 0]),
            "body.acceleration": TimeSeries(times[slow] + delay, samples.readings[slow, 1], delay=delay),
        },
        {"force": TimeSeries(times, samples.inputs[:, 0])},
    )
    readings = samples.readings.copy()
    skipped = np.ones(COUNT, dtype=bool)
    skipped[slow] = False
    readings[skipped, 1] = np.nan
    direct = extended_kalman_filter(
        model, FilterSamples(times, samples.inputs, readings), noise, Prior(x, covariance=p)
    )
    assert np.allclose(merged.times, times, atol=1e-12)
    run = extended_kalman_filter(model, merged, noise, Prior(x, covariance=p))
    assert np.allclose(run.states, direct.states, atol=1e-9)
    late = FilterSamples(times, samples.inputs, np.column_stack([readings[:, 0], np.roll(readings[:, 1], 1)]))
    assert (
        np.abs(extended_kalman_filter(model, late, noise, Prior(x, covariance=p)).states - direct.states).max() > 1e-3
    )


def test_square_root_keeps_its_sign_where_the_covariance_loses_digits():
    """A reading 1e9 times sharper than the prior, twice of nearly the same combination."""
    system = oscillator()
    model = FilterModel(system, ["body.position"], [RandomWalk("force", rate=0.0, std=1e6)])
    count = 400
    samples = FilterSamples(np.arange(count) * 1e-4, np.zeros((count, 1)), np.zeros((count, 1)))
    noise = Noise({}, {"body.position": 1e-20})
    prior = Prior(std={"body.position": 1e3, "body.velocity": 1e3})
    run = extended_kalman_filter(model, samples, noise, prior, square_root=True, keep="covariances")
    spectrum = np.linalg.eigvalsh(run.covariances)
    assert np.all(spectrum[:, 0] >= -1e-15 * spectrum[:, -1])
    assert np.array_equal(run.covariances, np.swapaxes(run.covariances, 1, 2))


def test_covariance_stays_symmetric_and_positive_over_a_long_run():
    system = oscillator()
    model = FilterModel(system, ["body.position"], [RandomWalk("spring.stiffness", rate=1.0, std=20.0)])
    count = 5000
    rng = np.random.default_rng(0)
    samples = FilterSamples(
        np.arange(count) * 0.005, rng.standard_normal((count, 1)), 1e-2 * rng.standard_normal((count, 1))
    )
    run = extended_kalman_filter(model, samples, Noise({}, {"body.position": 1e-6}), keep="covariances")
    assert np.array_equal(run.covariances, np.swapaxes(run.covariances, 1, 2))
    scale = np.sqrt(np.maximum(run.variances, 1e-300))
    unit = run.covariances / scale[:, :, None] / scale[:, None, :]
    assert np.linalg.eigvalsh(unit[10:]).min() > -1e-9
