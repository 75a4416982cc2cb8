"""Discrete transitions from the Jacobians along a motion: closed forms, an integrated machine, kinks and jumps."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import multibody.base.parallel as threads
from estimation.files.record import Record, RecordedSignal
from estimation.response.experiment import Experiment
from estimation.response.perturbations import PerturbationResponse
from multibody.inputs.table import InputTable
from multibody.solvers import Samples, integrate
from multibody.solvers.frozen import frozen_state_transition
from multibody.solvers.problem import Directions, ProblemError
from multibody.solvers.state_transition import state_transition_matrices
from multibody.system.simulate import native_problem
from vtsdt.rig.models import build

A = np.array([[0.0, 1.0, 0.0], [-30.0, -2.0, 5.0], [1.0, 0.0, -8.0]])
B = np.array([[0.0, 0.0], [3.0, 0.0], [0.5, -2.0]])
UNEVEN = np.array([0.0, 0.01, 0.05, 0.06, 0.1])


def of_time(a, b, asked=None):
    """Jacobians from functions of the time; the times at which they are wanted go into a list."""

    def jacobians(at):
        if asked is not None:
            asked.append(at)
        matrices = np.array([a(t) for t in at]), np.array([b(t) for t in at])
        return lambda part: (matrices[0][part], matrices[1][part])

    return jacobians


def exact_blocks(step, a=A, b=B):
    """Transition and first-order-hold responses from one matrix exponential (Van Loan)."""
    n, m = b.shape
    whole = np.zeros((n + 2 * m, n + 2 * m))
    whole[:n, :n], whole[:n, n : n + m] = a * step, b * step
    whole[n : n + m, n + m :] = np.eye(m)
    blocks = expm(whole)
    hold, ramp = blocks[:n, n : n + m], blocks[:n, n + m :]
    return blocks[:n, :n], hold - ramp, ramp


@pytest.mark.parametrize("longest", [np.inf, 0.007])
def test_constant_coefficients_give_the_matrix_exponential(longest):
    matrices = state_transition_matrices(UNEVEN, of_time(lambda t: A, lambda t: B), longest)
    for k, step in enumerate(np.diff(UNEVEN)):
        for block, exact in zip(matrices, exact_blocks(step), strict=True):
            np.testing.assert_allclose(block[k], exact, rtol=0, atol=3e-7)


@pytest.mark.parametrize(("faster", "longest"), [(1.0, np.inf), (1.0, 0.007), (300.0, np.inf)])
def test_an_addition_that_lasts_is_one_that_begins_and_ends_alike(faster, longest):
    """In whole intervals, in pieces, and where the Jacobians are frozen."""
    at = of_time(lambda t: faster * A, lambda t: B)
    matrices = state_transition_matrices(UNEVEN, at, longest, lasting=1)
    risen = state_transition_matrices(UNEVEN, at, longest)
    np.testing.assert_array_equal(matrices.phi, risen.phi)
    np.testing.assert_array_equal(matrices.gamma1[:, :, 1], 0.0)
    for k, step in enumerate(np.diff(UNEVEN)):
        _, gamma0, gamma1 = exact_blocks(step, faster * A)
        np.testing.assert_allclose(matrices.gamma0[k, :, 0], gamma0[:, 0], rtol=0, atol=3e-7)
        np.testing.assert_allclose(matrices.gamma1[k, :, 0], gamma1[:, 0], rtol=0, atol=3e-7)
        np.testing.assert_allclose(matrices.gamma0[k, :, 1], (gamma0 + gamma1)[:, 1], rtol=0, atol=3e-7)


def test_turning_coordinates_are_followed():
    """In coordinates that turn at a rate w, A(t) = R A0 R' + w J where R(t)' = w J R has the closed form R e^{A0 t}."""
    a0, j = np.array([[-3.0, 40.0], [-50.0, -1.0]]), np.array([[0.0, -1.0], [1.0, 0.0]])
    angle, speed = lambda t: 2.0 * np.sin(3.0 * t), lambda t: 6.0 * np.cos(3.0 * t)
    turned = lambda t: expm(angle(t) * j)  # noqa: E731
    jacobians = of_time(lambda t: turned(t) @ a0 @ turned(t).T + speed(t) * j, lambda t: turned(t) @ np.ones((2, 1)))
    errors = []
    for count in (50, 100):  # 0.9 radians of the oscillation in an interval and 7 degrees of turning, then half of that
        times = np.linspace(0.0, 1.0, count + 1)
        matrices, off = state_transition_matrices(times, jacobians), np.zeros(3)
        for k, (t0, t1) in enumerate(pairwise(times)):
            phi, gamma0, gamma1 = exact_blocks(t1 - t0, a0, np.ones((2, 1)))
            for i, (block, own) in enumerate(zip(matrices, (phi @ turned(t0).T, gamma0, gamma1), strict=True)):
                off[i] = max(off[i], np.max(np.abs(block[k] - turned(t1) @ own)) / np.max(np.abs(own)))
        errors.append(off)
    assert np.all(errors[0] < 3e-4)
    assert errors[1][0] < errors[0][0] / 24  # order 4; a ramp of the inputs is over within the interval: one less
    assert np.all(errors[1] < errors[0] / 6)


def test_a_rate_that_grows_in_time():
    """δ' = -c t δ + φ leaves exp(-c (t1² - t0²) / 2) of δ."""
    times = np.linspace(0.0, 2.0, 41)
    matrices = state_transition_matrices(times, of_time(lambda t: np.array([[-20.0 * t]]), lambda t: np.ones((1, 1))))
    np.testing.assert_allclose(matrices.phi[:, 0, 0], np.exp(-10.0 * np.diff(times**2)), rtol=1e-6)
    assert matrices.gamma0.shape == matrices.gamma1.shape == (40, 1, 1)


def test_a_jump_that_is_told_is_met_exactly():
    a, times, jump = (lambda t: A if t < 0.033 else 3.0 * A), np.linspace(0.0, 0.1, 6), 0.033
    matrices = state_transition_matrices(times, of_time(a, lambda t: B), breaks=np.array([jump, 0.06, 7.0]))
    np.testing.assert_allclose(matrices.phi[1], expm(3.0 * A * 0.007) @ expm(A * 0.013), rtol=0, atol=3e-7)
    np.testing.assert_allclose(matrices.phi[3], expm(3.0 * A * 0.02), rtol=0, atol=3e-7)


def test_where_jacobians_bend_they_are_asked_for_again():
    times, asked = np.linspace(0.0, 1.0, 301), []
    rate = lambda t: np.array([[-50.0 - 400.0 * max(t - 0.502, 0.0)]])  # noqa: E731
    matrices = state_transition_matrices(times, of_time(rate, lambda t: np.ones((1, 1)), asked))
    first, again = asked
    assert first.size == 3 * 300
    assert abs(again - 0.502).max() < 3 / 300
    late = np.maximum(times - 0.502, 0.0)
    np.testing.assert_allclose(matrices.phi[:, 0, 0], np.exp(-50.0 / 300 - 200.0 * np.diff(late**2)), rtol=1e-5)
    straight = []
    falling = of_time(lambda t: np.array([[-50.0 - 30.0 * t]]), lambda t: np.ones((1, 1)), straight)
    state_transition_matrices(times, falling)
    assert len(straight) == 1


def test_intervals_that_are_stiff_are_frozen():
    fast = np.diag([-1.0, -1e6])
    at = of_time(lambda t: fast, lambda t: np.ones((2, 1)))
    phi, gamma0, gamma1 = state_transition_matrices(np.array([0.0, 0.1, 0.2]), at)
    np.testing.assert_allclose(phi[1], np.diag([np.exp(-0.1), 0.0]), rtol=0, atol=1e-12)
    assert gamma1[1, 1, 0] == pytest.approx(1e-6, rel=1e-4)
    assert gamma0[1, 1, 0] == pytest.approx(1e-11, rel=1e-4)


@pytest.mark.parametrize("faster", [1e4, 1e6])
def test_a_moment_of_sticking_inside_a_piece_of_an_interval_stops_the_motion_and_no_more(faster):
    """The nodes of the whole interval miss it, those of its pieces do not; each piece takes the input where it is.

    Frozen thirds are off by 3e-4 here; a velocity that goes on would be off by 0.9.
    """

    def damped(t):
        return np.array([[0.0, 1.0], [-1.0, -1.0 - faster * np.exp(-(((t - 0.305) / 0.002) ** 2))]])

    def along(t, y):
        rates = damped(t) @ y.reshape(2, 4)
        rates[1, 2:] += (0.4 - t) / 0.1, (t - 0.3) / 0.1
        return rates.ravel()

    at = of_time(damped, lambda t: np.array([[0.0], [1.0]]))
    matrices = state_transition_matrices(np.linspace(0.0, 0.5, 6), at, breaks=np.array([0.31]))
    begin = np.hstack((np.eye(2), np.zeros((2, 2)))).ravel()
    end = solve_ivp(along, (0.3, 0.4), begin, "Radau", rtol=1e-8, atol=1e-10, max_step=2e-4).y[:, -1].reshape(2, 4)
    np.testing.assert_allclose(np.hstack([matrix[3] for matrix in matrices]), end, rtol=0, atol=1e-3)


def test_friction_that_begins_to_stick_between_intervals_that_are_looked_at():
    """Elastic dry friction: while it slides one entry is large and no motion is fast; sticking makes it a spring."""

    def sliding_or_stuck(t):
        stuck = 0.0 if t < 0.18 or t > 0.19 else 2.2e5
        return np.array([[0.0, 1.0, 0.0], [-23049.0, -320.0, -50.5], [0.0, stuck, -0.6]])

    times = np.arange(0.0, 0.301, 0.01)
    phi, _, _ = state_transition_matrices(times, of_time(sliding_or_stuck, lambda t: np.zeros((3, 0))))
    for k, t in enumerate(times[:-1]):
        exact = expm(sliding_or_stuck(t + 0.005) * (times[k + 1] - t))
        np.testing.assert_allclose(phi[k], exact, rtol=0, atol=1e-6 * np.abs(exact).max())


@pytest.mark.parametrize(("n", "m", "faster"), [(1, 1, 1e9), (5, 8, 30.0), (3, 2, 1e6), (8, 0, 0.3), (4, 2, 0.0)])
def test_frozen_transitions_are_exponentials_of_the_whole_block(n, m, faster):
    """As by Van Loan, but without the zeros and ones below; damped motions that turn, with very different rates."""
    rng = np.random.default_rng(n)
    damping, turning = rng.normal(size=(2, 6, n, n))
    a = faster * (0.3 * (turning - turning.transpose(0, 2, 1)) - damping @ damping.transpose(0, 2, 1))
    b = faster * rng.normal(size=(6, n, m))
    a[3] *= 1e-4
    whole = np.zeros((6, n + 2 * m, n + 2 * m))
    whole[:, :n, :n], whole[:, :n, n : n + m], whole[:, n : n + m, n + m :] = a, b, np.eye(m)
    exact = expm(whole)
    phi, gamma0, gamma1 = frozen_state_transition(a[:, None], b[:, None], np.ones(6))
    held, ramp = exact[:, :n, n : n + m], exact[:, :n, n + m :]
    scale = max(1.0, float(np.abs(b).max(initial=0.0)))
    for own, block in ((phi, exact[:, :n, :n]), (gamma0, held - ramp), (gamma1, ramp)):
        np.testing.assert_allclose(own, block, rtol=0, atol=1e-11 * scale)


def test_a_frozen_motion_that_runs_away_is_not_finite():
    phi, _, _ = frozen_state_transition(np.full((1, 1, 1, 1), 1e5), np.ones((1, 1, 1, 1)), np.ones(1))
    assert not np.isfinite(phi).any()


def test_threads_change_nothing_and_faults_are_named(monkeypatch):
    times = np.linspace(0.0, 1.0, 701)
    wavy = of_time(lambda t: A * (1.0 + 0.5 * np.sin(40.0 * t)), lambda t: B)
    several = state_transition_matrices(times, wavy)
    monkeypatch.setattr(threads, "available_cores", lambda: 1)
    for one, other in zip(state_transition_matrices(times, wavy), several, strict=True):
        np.testing.assert_array_equal(one, other)
    with pytest.raises(ProblemError, match="increasing times"):
        state_transition_matrices(times[::-1], wavy)
    lost = of_time(lambda t: A * (np.nan if 0.4 < t < 0.41 else 1.0), lambda t: B)
    with pytest.raises(ProblemError, match=r"from t = 0\.4 s on is not finite"):
        state_transition_matrices(times, lost)


def test_many_columns_and_no_inputs():
    rng = np.random.default_rng(4)
    a, b = rng.normal(size=(41, 41)) / 7 - 2.0 * np.eye(41), rng.normal(size=(41, 15))
    matrices = state_transition_matrices(np.array([0.0, 0.4]), of_time(lambda t: a, lambda t: b))
    for block, exact in zip(matrices, exact_blocks(0.4, a, b), strict=True):
        np.testing.assert_allclose(block[0], exact, rtol=0, atol=1e-6)
    alone = state_transition_matrices(np.array([0.0, 0.4]), of_time(lambda t: a, lambda t: np.zeros((41, 0))))
    assert alone.gamma0.shape == (1, 41, 0)
    np.testing.assert_allclose(alone.phi, matrices.phi, rtol=0, atol=1e-12)


TICKS = np.linspace(0.0, 0.3, 76)


def integrated(system, p, table, start, channels):
    """Return phi, gamma0 and gamma1 by small steps of the state with its directions, interval by interval."""
    n, m = len(system.states), len(channels)
    shape = np.zeros((2, n + 2 * m))
    shape[0, n : n + m] = shape[1, n + m :] = 1.0
    first = np.zeros((n + 2 * m, n))
    first[:n] = np.eye(n)
    states = Samples(TICKS)
    integrate(native_problem(system, p, table), (0.0, 0.3), start, samples=states, rtol=1e-10, atol=1e-13)
    whole = []
    for t0, t1, x in zip(TICKS[:-1], TICKS[1:], states.states, strict=False):
        channel = np.concatenate([np.full(n, -1), channels, channels])
        given = Directions(
            x0_dot=first, p_dot=np.zeros((n + 2 * m, p.size)), channel=channel, shape_t=np.array([t0, t1]), shape=shape
        )
        problem = native_problem(system, p, table, given)
        y = integrate(problem, (t0, t1), x, [t1], rtol=1e-10, atol=1e-13, max_step=(t1 - t0) / 40).y[:, -1]
        whole.append(problem.split(y)[1])
    return np.array(whole)


def test_a_machine_with_friction_agrees_with_its_integrated_derivatives():
    """A lift that sets off and turns round, so that the friction of its guides changes sign."""
    system = build().build(outputs=["F_c", "i_q"])
    given = {"omega_ref": 3.0 * np.sin(25.0 * TICKS), "tau_L": np.zeros(76), "friction_c": 5.0, "friction_cw": 4.0}
    names = list(system.input_names)
    values = {name: given.get(name, 0.0) for name in names}
    signals = {
        name: RecordedSignal(values=np.broadcast_to(v, 76).astype(float), unit="", column=name, measured_unit="")
        for name, v in values.items()
    }
    signals["F_c"] = RecordedSignal(values=np.zeros(76), unit="N", column="F_c", measured_unit="N")
    experiment = Experiment(
        record=Record(name="trip", path=Path("trip.csv"), time=TICKS, signals=signals),
        inputs=tuple(names),
        outputs=("F_c",),
        rtol=1e-9,
    )
    start = experiment.start_vector(system)
    matrices = PerturbationResponse.along(experiment.simulation(system, system.p), ("tau_L", "friction_c"))
    channels = [system.index("input", name) for name in ("tau_L", "friction_c")]
    exact = integrated(system, system.p, experiment.table(system), start, channels)
    exact = exact.transpose(0, 2, 1)
    own = np.concatenate([matrices.phi, matrices.gamma0, matrices.gamma1], axis=2)
    off = np.linalg.norm(own - exact, axis=1) / np.linalg.norm(exact, axis=1)
    assert np.median(off) < 2e-6
    assert np.max(off) < 2e-5


def test_a_table_tells_where_its_held_inputs_jump():
    columns = {"held": [0.0, 1.0, 1.0, 2.0], "late": [0.0, 0.0, 5.0, 5.0], "ramp": [0.0, 1.0, 0.0, 1.0]}
    kinds = {"held": "hold", "late": "hold", "ramp": "linear"}
    table = InputTable.from_columns([0.0, 1.0, 2.0, 3.0], columns, kinds, {"late": 1})
    assert sorted(table.jumps(np.array([9.0, 0.25]))) == [1.0, 2.25, 3.0]
    assert InputTable.constant([1.0]).jumps(np.zeros(0)).size == 0
