"""Controllers, filters and sources against their closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from multibody import Model, ModelError
from multibody.library import (
    PI,
    Delay,
    Derivative,
    FirstOrderLag,
    Gain,
    Integrator,
    SCurveProfile,
    Sine,
    Step,
    TrapezoidalProfile,
    profiles,
)

TIGHT = {"rtol": 1e-10, "atol": 1e-13}


def loop(k_p, k_i, **limits):
    """A PI controller around an integrator, with a step of the reference at the start."""
    model = Model("loop")
    pi = model.add("pi", PI(k_p=k_p, k_i=k_i, input_unit="m*s", output_unit="m", **limits))
    plant = model.add("plant", Integrator(input_unit="m"))
    model.connect(pi.output, plant.input)
    model.connect(plant.output, pi.measured)
    model.input("r", pi.reference)
    return model.build()


def test_pi_step_response_on_an_integrator():
    """s² + k_p s + k_i = 0 with k_p = 3, k_i = 2: y = 1 + e^{-t} − 2 e^{-2t}."""
    run = loop(3.0, 2.0).simulate(5.0, inputs={"r": 1.0}, **TIGHT)
    np.testing.assert_allclose(run["plant.total"], 1.0 + np.exp(-run.times) - 2.0 * np.exp(-2.0 * run.times), atol=1e-8)


def test_limited_pi_keeps_its_limit_and_winds_up_less():
    free = loop(3.0, 20.0, limited=True, limit=0.5, tracking_time=1e3).simulate(10.0, inputs={"r": 1.0})
    held = loop(3.0, 20.0, limited=True, limit=0.5, tracking_time=0.02).simulate(10.0, inputs={"r": 1.0})
    for run in (free, held):
        assert np.max(abs(run["pi.output"])) <= 0.5
        np.testing.assert_allclose(run["plant.total"][:150], 0.5 * run.times[:150], rtol=1e-6, atol=1e-9)
    assert free["plant.total"].max() > 1.5  # the integral has to unwind by overshooting
    assert held["plant.total"].max() - 1.0 < 0.1 * (free["plant.total"].max() - 1.0)


@pytest.mark.parametrize(("order", "reach"), [(1, 0.6), (2, 1.7), (3, 3.0), (4, 4.5)])
def test_delay_keeps_amplitudes_and_delays_phases(order, reach):
    delay = 0.02
    model = Model("delay")
    late = model.add("late", Delay(delay=delay, order=order))
    model.input("u", late.input)
    system = model.build(compiled=False)
    A, B, C, D = _state_space(system)
    for w in np.linspace(0.1, reach, 7) / delay:
        response = (C @ np.linalg.solve(1j * w * np.eye(order) - A, B) + D).item()
        assert abs(response) == pytest.approx(1.0, rel=1e-10)
        late_by = np.angle(response * np.exp(1j * w * delay))
        assert abs(late_by) < np.deg2rad(1.0)
    twice = (C @ np.linalg.solve(2j * reach / delay * np.eye(order) - A, B) + D).item()
    assert abs(np.angle(twice * np.exp(2j * reach))) > np.deg2rad(5.0)  # the reach is not understated


def _state_space(system):
    """Matrices of a linear system by its equations: columns are responses to unit states and inputs."""
    n, k = len(system.states), system.index("output", "late.output")
    zero = np.zeros(n)
    A = np.array([system.rhs(0.0, e, np.zeros(1)) for e in np.eye(n)]).T
    B = system.rhs(0.0, zero, np.ones(1))[:, None]
    C = np.array([[system.outputs_at(0.0, e, np.zeros(1))[k] for e in np.eye(n)]])
    return A, B, C, system.outputs_at(0.0, zero, np.ones(1))[k]


def test_lag_and_filtered_derivative():
    model = Model("filters")
    step = model.add("step", Step(height=2.0))
    lag = model.add("lag", FirstOrderLag(time_constant=0.1))
    rate = model.add("rate", Derivative(time_constant=0.1))
    model.connect(step.output, lag.input, rate.input)
    run = model.build().simulate(1.0, **TIGHT)
    np.testing.assert_allclose(run["lag.output"], 2.0 * (1.0 - np.exp(-10.0 * run.times)), atol=1e-9)
    np.testing.assert_allclose(run["rate.output"], 20.0 * np.exp(-10.0 * run.times), atol=1e-8)


def test_signals_of_different_kinds_cannot_be_connected():
    model = Model("units")
    wave = model.add("wave", Sine(unit="rad/s"))
    gain = model.add("gain", Gain(k=2.0, input_unit="m", output_unit="A"))
    model.connect(wave.output, gain.input)
    with pytest.raises(ModelError, match=r"'wave.output' is in rad/s but 'gain.input' takes m"):
        model.build()


def test_gain_takes_its_factor_in_its_own_units():
    assert Gain(k="3 mA/(m/s)", input_unit="m/s", output_unit="A").values["k"] == pytest.approx(3e-3)
    assert Gain(k="3 kg", input_unit="m/s", output_unit="A").faults
    assert Gain(input_unit="mm/blink").faults


MOVES = [  # distance, v, a, j: which limits are reached
    (1.0, 0.5, 2.0, 20.0),
    (0.1, 0.5, 2.0, 20.0),
    (0.005, 0.5, 2.0, 20.0),
    (2.0, 0.5, 50.0, 20.0),
    (-0.7, 0.9, 1.5, 6.0),
]


@pytest.mark.parametrize("move", MOVES)
def test_s_curve_arrives_and_keeps_its_limits(move):
    distance, v_max, a_max, j_max = move
    duration = profiles.jerk_limited(0.0, *move)[3]
    t = np.linspace(-0.1, duration + 0.1, 4001)
    s, v, a = np.array([profiles.jerk_limited(x, *move)[:3] for x in t]).T
    h = t[1] - t[0]
    assert s[0] == 0.0
    assert s[-1] == pytest.approx(distance, rel=1e-14)
    assert np.max(abs(v)) <= v_max * (1.0 + 1e-12)
    assert np.max(abs(a)) <= a_max * (1.0 + 1e-12)
    assert np.max(abs(np.diff(a))) <= j_max * h * (1.0 + 1e-9)
    # each is the rate of the one before: trapezoids of a continuous rate with jerk j are off by
    # j·h²·(number)/12
    np.testing.assert_allclose(np.cumsum(0.5 * (v[1:] + v[:-1])) * h, s[1:], atol=a_max * h * h)
    np.testing.assert_allclose(np.cumsum(0.5 * (a[1:] + a[:-1])) * h, v[1:], atol=2.0 * j_max * h * h)


def test_s_curve_takes_no_longer_than_its_limits_ask():
    # all limits reached: T = d/v + v/a + a/j
    assert profiles.jerk_limited(0.0, 1.0, 0.5, 2.0, 20.0)[3] == pytest.approx(2.0 + 0.25 + 0.1)
    # only jerk matters: T = 4 (d/2j)^(1/3)
    end = profiles.jerk_limited(0.0, 0.005, 0.5, 2.0, 20.0)[3]
    assert end == pytest.approx(4.0 * (0.005 / 40.0) ** (1.0 / 3.0))
    # without a limit on jerk it becomes the trapezoid
    assert profiles.jerk_limited(0.4, 1.0, 0.5, 2.0, 1e9)[:2] == pytest.approx(
        profiles.trapezoidal(0.4, 1.0, 0.5, 2.0)[:2], rel=1e-8
    )


@pytest.mark.parametrize(("distance", "duration"), [(1.0, 2.25), (-0.02, 0.2)])
def test_trapezoid(distance, duration):
    assert profiles.trapezoidal(0.0, distance, 0.5, 2.0)[3] == pytest.approx(duration)
    assert profiles.trapezoidal(duration, distance, 0.5, 2.0)[0] == pytest.approx(distance, rel=1e-14)
    middle = profiles.trapezoidal(0.5 * duration, distance, 0.5, 2.0)[0]
    assert middle == pytest.approx(0.5 * distance, rel=1e-12)


def test_profile_of_no_length_rests():
    assert profiles.jerk_limited(0.5, 0.0, 1.0, 1.0, 1.0)[:3] == (0.0, 0.0, 0.0)
    assert profiles.trapezoidal(0.5, 0.0, 1.0, 1.0)[:3] == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("profile", [TrapezoidalProfile, SCurveProfile])
def test_a_late_short_move_is_not_jumped_over(profile):
    """A machine at rest for 60 s, then a move of 0.1 s: steps have grown by then, and must not skip it."""
    jerk = {"j_max": 4e4} if profile is SCurveProfile else {}
    model = Model("late")
    limits = {"v_max": 5.0, "a_max": 100.0, **jerk}
    move = model.add("move", profile(position_unit="m", distance=0.1, start=60.0, **limits))
    way = model.add("way", Integrator(input_unit="m/s"))
    model.connect(move.velocity, way.input)
    run = model.build().simulate(100.0)
    # a skipped move would be wrong by all of it; the default tolerance leaves 3e-4
    assert run["way.total"][-1] == pytest.approx(0.1, rel=1e-2)


def test_profile_refuses_limits_that_cannot_be():
    faults = SCurveProfile(distance=1.0, v_max=-1.0, a_max=0.0, j_max=1.0).faults
    assert len(faults) == 2
    assert all("below its least value" in fault for fault in faults)
