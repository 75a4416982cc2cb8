"""How a study chooses the mode of its residual, cuts windows, and prescribes a recorded motion."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from discrepancy.problem.problem import Problem, make_experiments
from discrepancy.problem.study_file import StudyError
from discrepancy.residual.initial_state import estimate_states
from discrepancy.residual.input_noise import input_noise_weighting
from discrepancy.residual.inverse import derivatives, inverse_problem
from discrepancy.residual.residual_mode import prepared_problem, problem_in_windows
from discrepancy.residual.signal_bandwidth import signal_bandwidth
from discrepancy.residual.windows import WINDOW_FACTOR, ErrorGrowth, cut_windows, error_growth
from estimation.files.record import Record, RecordedSignal
from estimation.fit.calibrate import UncertainParameter
from estimation.response.perturbations import InputPerturbation
from estimation.signals.preparation import Preparation, low_pass
from multibody import Model
from multibody.library import (
    ForceSource,
    Inertia,
    Mass,
    Pendulum,
    Spring,
    TorqueSource,
    TorsionDamper,
    ViscousFriction,
)

DT = 0.005


def record_of(name, time, **columns):
    signals = {
        k.replace("__", "."): RecordedSignal(values=v, unit=unit, column=k, measured_unit=unit)
        for k, (v, unit) in columns.items()
    }
    return Record(name=name, path=Path(f"{name}.csv"), time=time, signals=signals)


def slide(stiffness=0.0):
    model = Model("slide")
    carriage, drive = model.add("carriage", Mass(m=20.0)), model.add("drive", ForceSource())
    guide = model.add("guide", ViscousFriction(viscous=3.0))
    model.connect(carriage.flange, drive.flange, guide.a)
    model.connect(guide.b, model.ground)
    if stiffness:
        spring = model.add("spring", Spring(stiffness=stiffness))
        model.connect(spring.a, carriage.flange)
        model.connect(spring.b, model.ground)
    model.input("drive.force", drive.force)
    return model


def slide_problem(stiffness=0.0, noise=0.0, residual="auto", duration=8.0):
    model = slide(stiffness)
    rng = np.random.default_rng(1)
    time = np.arange(0.0, duration, DT)
    force = 20.0 * np.sin(2 * np.pi * 0.5 * time)
    run = model.build().simulate((0.0, time[-1]), inputs={"drive.force": (time, force)}, times=time, rtol=1e-9)
    record = record_of(
        "run",
        time,
        drive__force=(force + noise * rng.standard_normal(time.size), "N"),
        carriage__position=(run["carriage.position"] + 1e-4 * rng.standard_normal(time.size), "m"),
    )
    experiments = make_experiments(model, [record], ("drive.force",), ("carriage.position",))
    uncertain = (UncertainParameter(name="guide.viscous", value=3.0, std=3.0, min=0.0),)
    return Problem(
        name="slide", model=model, uncertain=uncertain, identify=experiments, validate=experiments, residual=residual
    ), run


def standing_pendulum(residual="auto"):
    """A pendulum that starts upright and is hardly pushed: the textbook example of a diverging simulation."""
    model = Model("pendulum")
    rod = model.add("rod", Pendulum(J=0.25, m=1.0, arm=0.5, angle=3.0))
    drive = model.add("drive", TorqueSource())
    model.connect(rod.flange, drive.flange)
    model.input("drive.torque", drive.torque)
    time = np.arange(0.0, 4.0, DT)
    torque = 0.5 * np.sin(3.0 * time)
    run = model.build().simulate((0.0, time[-1]), inputs={"drive.torque": (time, torque)}, times=time, rtol=1e-10)
    rng = np.random.default_rng(2)
    angle = run["rod.angle"] + 1e-4 * rng.standard_normal(time.size)
    record = record_of("swing", time, drive__torque=(torque, "N*m"), rod__angle=(angle, "rad"))
    experiments = make_experiments(model, [record], ("drive.torque",), ("rod.angle",))
    return Problem(name="pendulum", model=model, uncertain=(), identify=experiments, residual=residual), run


def test_machine_on_a_spring_is_simulated():
    problem, _ = slide_problem(stiffness=2000.0, noise=0.05)
    found = prepared_problem(problem)
    assert (found.mode, found.problem) == ("simulation", problem)
    assert "simulations do not diverge" in found.reason


def test_a_wrong_model_whose_errors_do_not_grow_is_not_cut_into_windows():
    problem, _ = slide_problem(stiffness=2000.0, noise=0.05)
    assert problem_in_windows(problem, {"carriage.position": 1.0}) is None


def test_free_mass_with_a_noisy_force_is_cut_into_windows():
    problem, _ = slide_problem(noise=0.1, duration=16.0)
    found = prepared_problem(problem)
    assert found.mode == "prediction"
    assert "noise of drive.force" in found.reason
    assert len(found.problem.identify) > 2


def test_free_mass_with_an_exact_force_may_be_simulated():
    problem, _ = slide_problem(noise=0.0)
    assert prepared_problem(problem).mode == "simulation"


def test_errors_of_a_standing_pendulum_grow_at_the_known_rate():
    problem, _ = standing_pendulum()
    time = np.arange(0.0, 1.0, DT)
    record = record_of(
        "upright",
        time,
        drive__torque=(np.zeros(time.size), "N*m"),
        rod__angle=(np.full(time.size, np.pi - 1e-3), "rad"),
    )
    e = make_experiments(problem.model, [record], ("drive.torque",), ("rod.angle",))[0]
    system = problem.model.build(outputs=e.outputs)
    growth = error_growth(estimate_states(e, system, system.p), np.ones(1), np.ones(2))
    rate = np.sqrt(9.80665 / 0.5)
    # d angle / d (angle, speed) at the start, linearised about upright; relative to the first 20 samples.  The rod
    # has left upright by 0.04 rad in the end, where the linearisation is off by 0.04²/2.
    size = np.hypot(np.cosh(rate * time), np.sinh(rate * time) / rate)
    np.testing.assert_allclose(growth.start, size / size[19], rtol=2e-3)


@pytest.mark.parametrize(
    ("growth", "diverges"),
    [
        (lambda t: 1.0 + 40.0 * t * np.exp(-2.0 * t), False),  # 8.4 at most: below the factor in any case
        (lambda t: np.exp(4.0 * np.minimum(t, 1.0) - 9.0 * np.maximum(t - 1.0, 0.0)), False),  # 55 after 1 s, then gone
        (lambda t: np.exp(5.0 * np.minimum(t, 1.0) - 9.0 * np.maximum(t - 1.0, 0.0)), True),  # 148: as large as outputs
        (lambda t: np.exp(4.0 * np.minimum(t, 1.0)), True),  # stays
        (lambda t: np.exp(4.0 * np.clip(t - 3.0, 0.0, 1.0)), True),  # begins late: none knows whether it would die out
    ],
)
def test_an_error_of_the_initial_state_that_dies_out_is_a_transient(growth, diverges):
    time = np.arange(0.0, 4.0, DT)
    found = ErrorGrowth(time=time, start=growth(time), inputs=np.zeros(time.size))
    assert np.isfinite(found.within) == diverges


def test_states_are_those_of_the_simulation_where_it_follows_the_record():
    """A spring that is 3 % too stiff: sensors' corrections would pull the states to and fro, 64 times a record."""
    problem, _ = slide_problem(stiffness=2000.0)
    e = problem.identify[0]
    system = slide(2060.0).build(outputs=e.outputs)
    states = estimate_states(e, system, system.p).states
    run = system.simulate(
        (0.0, e.record.time[-1]),
        inputs={"drive.force": (e.record.time, e.record.values("drive.force")[:, 0])},
        initial=e.start_vector(system),
        times=e.record.time,
        rtol=1e-9,
    )
    # rtol 1e-5 in each of 64 pieces, of a state whose largest value counts
    np.testing.assert_allclose(states, run.states, atol=1e-3 * np.max(np.abs(run.states)))


def test_windows_do_not_cross_records_and_cover_them():
    problem, _ = standing_pendulum("prediction")
    found = prepared_problem(problem)
    record, windows = problem.identify[0].record, found.problem.identify
    ends = [(w.record.time[0], w.record.time[-1]) for w in windows]
    assert ends[0][0] == record.time[0]
    assert ends[-1][1] == record.time[-1]
    assert all(a[1] == b[0] for a, b in pairwise(ends))
    assert all(w.name.startswith("swing [") for w in windows)
    assert len({w.name for w in windows}) == len(windows)
    assert found.reason.startswith("asked for by the study")


def test_windows_start_where_the_machine_was():
    problem, run = standing_pendulum("prediction")
    windows = prepared_problem(problem).problem.identify
    assert len(windows) > 1
    for window in windows:
        k = int(np.argmin(np.abs(run.times - window.record.time[0])))
        # The angle is known to its noise of 1e-4 rad; a parabola over half-width 3 samples at least gives its rate
        # to 1e-4/(0.015 s·√2): 0.02 rad/s, three times that is allowed, and the same for its bias in fast motion.
        assert window.start["rod.angle"] == pytest.approx(run["rod.angle"][k], abs=1e-3)
        assert window.start["rod.speed"] == pytest.approx(run["rod.speed"][k], abs=0.12)


def test_within_a_window_errors_grow_less_than_the_factor():
    problem, _ = standing_pendulum()
    e = problem.identify[0]
    system = problem.model.build(outputs=e.outputs)
    up = estimate_states(e, system, system.p)
    spread, scale = np.ones(1), np.array([1.0, 3.0])
    windows = cut_windows(up, 1.0, spread, scale)
    assert len(windows) > 1
    for window in windows:
        first = int(np.argmin(np.abs(e.record.time - window.record.time[0])))
        growth = error_growth(up, spread, scale, first, first + len(window.record.time) - 1)
        assert np.max(growth.start) <= WINDOW_FACTOR


def test_windows_are_never_more_than_a_fit_can_solve_for(monkeypatch: pytest.MonkeyPatch):
    problem, _ = standing_pendulum("prediction")
    all_windows = prepared_problem(problem).problem
    assert len(all_windows.identify) >= 4
    assert all_windows.warnings == problem.warnings
    monkeypatch.setattr("discrepancy.residual.residual_mode.MOST_UNKNOWNS", len(all_windows.identify))  # of 2 states
    some = prepared_problem(problem).problem
    assert len(some.identify) < len(all_windows.identify)
    ends = [(w.record.time[0], w.record.time[-1]) for w in some.identify]
    assert all(b[0] > a[1] for a, b in pairwise(ends))
    assert ends[-1][1] > 0.5 * all_windows.identify[-1].record.time[-1]  # they are spread over the record
    assert "only some stand for the records" in some.warnings[-1]


def test_a_window_of_the_preparation_is_kept():
    problem, _ = slide_problem(noise=0.1)
    narrow = [e.with_preparation(Preparation(start=1.0, stop=5.0)) for e in problem.identify]
    windows = prepared_problem(
        Problem(name="slide", model=problem.model, uncertain=(), identify=tuple(narrow), residual="prediction")
    ).problem.identify
    assert windows[0].record.time[0] == pytest.approx(1.0)
    assert windows[-1].record.time[-1] == pytest.approx(5.0)


def test_derivatives_of_a_sine():
    time = np.arange(0.0, 2.0, 0.01)
    w = 2 * np.pi * 5.0  # a twentieth of the sampling rate
    rate, second = derivatives(time, np.sin(w * time))
    # (ωh)⁴/30 and (ωh)⁴/90 of the five-point formulas; the continued ends are worse and are left out anyway
    inside = slice(4, -4)
    assert np.max(np.abs(rate - w * np.cos(w * time))[inside]) < 1.1 * w * (w * 0.01) ** 4 / 30
    assert np.max(np.abs(second + w * w * np.sin(w * time))[inside]) < 1.1 * w * w * (w * 0.01) ** 4 / 90


def test_bandwidth_of_a_sine_in_noise():
    time = np.arange(0.0, 20.0, 0.002)
    values = np.sin(2 * np.pi * 7.0 * time) + 0.01 * np.random.default_rng(0).standard_normal(time.size)
    # the smoothing over neighbours widens the line by a few bins of 0.05 Hz
    assert signal_bandwidth(time, values) == pytest.approx(7.0, abs=2.0)


def test_inverse_of_the_right_model_needs_the_recorded_torque():
    problem, _ = standing_pendulum("inverse")
    found = prepared_problem(problem)
    assert found.mode == "inverse"
    assert "rod.angle" in found.reason
    e = found.problem.identify[0]
    system = found.problem.model.build(outputs=e.outputs)
    assert e.outputs == ("drive.torque",)
    assert system.state_names == ()
    needed = e.simulate(system, system.p)
    # 1e-4 rad of noise, twice differentiated within the bandwidth, times the inertia, against 0.5 N·m of torque
    record = problem.identify[0].record
    bandwidth = signal_bandwidth(record.time, record.signals["rod.angle"].values)
    noise = 0.25 * 1e-4 * (2 * np.pi * bandwidth) ** 2
    assert np.std(e.measured - needed) < max(3.0 * noise, 0.02)
    assert np.std(needed) > 0.2


def test_inverse_keeps_places_and_filters_all_signals_alike():
    problem, _ = slide_problem(noise=0.05, residual="inverse")
    found = inverse_problem(problem, bandwidth=4.0)
    assert {p.name for p in found.problem.model.places()} == {p.name for p in problem.model.places()}
    record, whole = found.problem.identify[0].record, problem.identify[0].record
    expected = low_pass(np.array(whole.time), whole.signals["drive.force"].values, 4.0)
    k = int(np.argmin(np.abs(whole.time - record.time[0])))
    np.testing.assert_array_equal(record.signals["drive.force"].values, expected[k : k + len(record.time)])
    assert "sensor_*@needed.*" in found.problem.exclude


def test_inverse_without_a_drive_force_is_compared_with_zero():
    model = Model("free swing")
    rotor, bearing = model.add("rotor", Inertia(J=0.1, speed=5.0)), model.add("bearing", TorsionDamper(damping=0.02))
    model.connect(rotor.flange, bearing.a)
    model.connect(bearing.b, model.ground)
    time = np.arange(0.0, 4.0, DT)
    run = model.build().simulate((0.0, time[-1]), times=time, rtol=1e-10)
    record = record_of("spin", time, rotor__speed=(run["rotor.speed"], "rad/s"))
    problem = Problem(
        name="spin",
        model=model,
        uncertain=(),
        identify=make_experiments(model, [record], (), ("rotor.speed",)),
        residual="inverse",
    )
    found = inverse_problem(problem, bandwidth=5.0)
    e = found.problem.identify[0]
    system = found.problem.model.build(outputs=e.outputs)
    assert e.outputs == ("needed.bearing.torque",)
    assert not np.any(e.measured)
    # exact data: the residual is the error of the five-point formula and the filter's edge, far below 0.1 N·m
    assert np.max(np.abs(e.simulate(system, system.p))) < 1e-4


def test_inverse_removes_the_controller_when_its_output_is_measured():
    from discrepancy.rigs.axis_model import build

    model = build()
    time = np.arange(0.0, 3.0, 0.002)
    reference = 0.1 * np.sin(2 * np.pi * 0.5 * time)
    run = model.build().simulate(
        (0.0, time[-1]), inputs={"reference.position": (time, reference)}, times=time, rtol=1e-8
    )
    record = record_of(
        "trip",
        time,
        reference__position=(reference, "m"),
        motor__torque=(run["motor.torque"], "N*m"),
        encoder__angle=(run["motor.angle"], "rad"),
    )
    uncertain = (
        UncertainParameter(name="carriage.m", value=40.0, std=4.0),
        UncertainParameter(name="controller.k_speed", value=0.12, std=0.01),
    )
    experiments = make_experiments(model, [record], ("reference.position",), ("motor.torque", "encoder.angle"))
    problem = Problem(name="axis", model=model, uncertain=uncertain, identify=experiments)
    assert prepared_problem(problem).mode == "simulation"
    found = inverse_problem(
        Problem(name="axis", model=model, uncertain=uncertain, identify=experiments, residual="inverse"), bandwidth=20.0
    ).problem
    assert "controller" not in found.model.components
    assert [q.name for q in found.uncertain] == ["carriage.m"]
    e = found.identify[0]
    system = found.model.build(outputs=e.outputs)
    rest = e.measured - e.simulate(system, system.p)
    # The elastic side starts from a guess, whose ringing dies away; of a torque of 0.5 N·m less than 2 % is left.
    assert np.std(rest[rest.size // 2 :]) < 0.02 * np.std(e.measured)


def test_inverse_refuses_a_machine_without_measured_motion():
    problem, _ = slide_problem()
    model = problem.model.copy()
    model.output("guide.loss_shown", "guide.loss")
    time = np.array(problem.identify[0].record.time)
    record = record_of("run", time, drive__force=(np.ones(time.size), "N"), guide__loss=(np.ones(time.size), "W"))
    wrong = Problem(
        name="slide",
        model=model,
        uncertain=(),
        identify=make_experiments(model, [record], ("drive.force",), ("guide.loss",)),
        residual="inverse",
    )
    with pytest.raises(StudyError, match=r"none of the measured outputs \(guide.loss\)"):
        prepared_problem(wrong)


def test_weighted_noise_of_a_force_is_white():
    """A free mass driven by white noise alone: after weighting, deviation and output noise together are white."""
    problem, _ = slide_problem(noise=0.0, duration=4.0)
    e = problem.identify[0]
    system = problem.model.build(outputs=e.outputs)
    x0, noise, sigma = system.start, np.array([1e-4]), 0.5
    noisy = replace(e, input_noise={"drive.force": sigma})
    weights = input_noise_weighting(noisy, system, system.p, x0, noise)
    rng = np.random.default_rng(3)
    n = len(e.record.time)
    perturbations = [InputPerturbation("drive.force", sigma * rng.standard_normal(n)) for _ in range(60)]
    deviation = e.respond(system, system.p, x0, perturbations=perturbations).derivatives
    deviation = deviation + noise[:, None] * rng.standard_normal(deviation.shape)
    before, after = deviation[-1, 0] / noise[0], weights(deviation)[-1, 0] / noise[0]
    assert np.std(before) > 5.0
    # 60 draws: the standard deviation is known to 9 %, three of these around 1
    assert np.sqrt(np.mean(weights(deviation) ** 2)) / noise[0] == pytest.approx(1.0, abs=0.1)
    assert np.std(after) < 1.4


@pytest.mark.parametrize(("at_the_end", "forgotten"), [(0.1, True), (3.0, False)])
def test_an_error_that_has_died_out_at_the_end_is_forgotten(at_the_end, forgotten):
    """As on a slide that dry friction holds until it first moves, late in the record."""
    time = np.linspace(0.0, 3.0, 300)
    start = np.where(time < 1.0, 1.0 + 7.0 * time, np.where(time < 2.5, 40.0, at_the_end))
    growth = ErrorGrowth(time=time, start=start, inputs=np.zeros(300))
    assert growth.is_forgotten is forgotten
    assert np.isinf(growth.within) == forgotten
