"""The compiled methods behave as SciPy's own do: exact where solutions are known, honest where they fail."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from multibody.compile import native
from multibody.compile.settings import jit_enabled
from multibody.inputs.table import InputTable
from multibody.solvers import (
    Automatic,
    Directions,
    DormandPrince54,
    NativeProblem,
    ProblemError,
    Rodas5P,
    Samples,
    integrate,
)

METHODS = [DormandPrince54, Rodas5P, Automatic]

# A driven oscillator, a nonlinear problem with a known solution (SciPy's rational test problem), a blow-up.
SOURCE = """
import math


def oscillator(t, x, u, p, dx):
    dx[0] = x[1]
    dx[1] = -p[0] * x[0] - p[1] * x[1] + u[0]


def oscillator_tangent(t, x, u, p, x_dot, u_dot, p_dot, out):
    out[0] = x_dot[1]
    out[1] = -p_dot[0] * x[0] - p[0] * x_dot[0] - p_dot[1] * x[1] - p[1] * x_dot[1] + u_dot[0]


def rational(t, x, u, p, dx):
    dx[0] = x[1] / t
    dx[1] = x[1] * (x[0] + 2.0 * x[1] - 1.0) / (t * (x[0] - 1.0))


def rational_tangent(t, x, u, p, x_dot, u_dot, p_dot, out):
    a = x[0] - 1.0
    b = x[0] + 2.0 * x[1] - 1.0
    out[0] = x_dot[1] / t
    out[1] = (x_dot[1] * b + x[1] * (x_dot[0] + 2.0 * x_dot[1])) / (t * a) - x[1] * b * x_dot[0] / (t * a * a)


def square(t, x, u, p, dx):
    dx[0] = 1.0
    dx[1] = x[1] * x[1]


def square_tangent(t, x, u, p, x_dot, u_dot, p_dot, out):
    out[0] = 0.0
    out[1] = 2.0 * x[1] * x_dot[1]


def root(t, x, u, p, dx):
    dx[0] = -1.0
    dx[1] = math.sqrt(x[0])


def root_tangent(t, x, u, p, x_dot, u_dot, p_dot, out):
    out[0] = 0.0
    out[1] = 0.5 * x_dot[0] / math.sqrt(x[0])


def pendulum(t, x, u, p, dx):
    dx[0] = x[1]
    dx[1] = -p[0] * math.sin(x[0]) - p[1] * x[1] + u[0]


def pendulum_tangent(t, x, u, p, x_dot, u_dot, p_dot, out):
    out[0] = x_dot[1]
    out[1] = (
        -p_dot[0] * math.sin(x[0])
        - p[0] * math.cos(x[0]) * x_dot[0]
        - p_dot[1] * x[1]
        - p[1] * x_dot[1]
        + u_dot[0]
    )
"""


def problem(name, p=(4.0, 0.0), table=None, directions=None, **options):
    module = native.load_source(SOURCE, "solver_tests")
    return NativeProblem(
        rhs=native.compile_rhs(module, name),
        p=np.array(p),
        table=InputTable.constant([0.0]) if table is None else table,
        n=2,
        tangent=native.compile_tangent(module, f"{name}_tangent"),
        directions=directions,
        **options,
    )


def solve(method, prob, span, x0, **options):
    return solve_ivp(prob.fun, span, prob.initial(x0), method=method, problem=prob, **options)


def rational_exact(t):
    return np.array([t / (t + 10), 10 * t / (t + 10) ** 2])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("span", [(5.0, 9.0), (5.0, 1.0)])
@pytest.mark.parametrize("t_eval", [False, True])
def test_known_solution_forwards_and_backwards(method, span, t_eval):
    # As SciPy's test_integration: weighted error below 15 tolerances.
    prob = problem("rational")
    points = np.linspace(*span, 23) if t_eval else None
    done = solve(method, prob, span, rational_exact(span[0]), rtol=1e-6, atol=1e-9, t_eval=points, dense_output=True)
    assert done.success
    assert done.status == 0
    assert done.t[0] == span[0]
    assert done.t[-1] == span[1]
    if points is not None:
        np.testing.assert_array_equal(done.t, points)
    exact = rational_exact(done.t)
    assert np.max(np.abs(done.y - exact) / (1e-9 + 1e-6 * np.abs(exact))) < 15.0
    fine = np.linspace(*span, 211)
    exact = rational_exact(fine)
    # Between the steps the interpolants are of order 4, one less than the methods.
    assert np.max(np.abs(done.sol(fine) - exact) / (1e-9 + 1e-6 * np.abs(exact))) < 60.0
    # SciPy drops no point: steps and dense output agree where they meet.
    np.testing.assert_allclose(done.sol(done.t), done.y, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("method", METHODS)
def test_order_of_convergence(method):
    # Fixed steps: tolerances so loose that every step is accepted.  The slope of the error must be
    # that of a method of order 5 (4.7 allows for the terms of next order at these steps).
    prob = problem("pendulum", (4.0, 0.1), InputTable.from_columns([0.0, 1.0], {"u": [0.0, 1.0]}))
    # The reference is SciPy's method of order 8; the rounding of a tolerance of 1e-13 is far below the
    # errors.
    exact = solve_ivp(prob.fun, (0.0, 1.0), [1.0, 0.5], method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    steps = np.array([1 / 20, 1 / 40, 1 / 80])
    errors = []
    for h in steps:
        done = solve(method, prob, (0.0, 1.0), [1.0, 0.5], rtol=1e3, atol=1e3, max_step=h, first_step=h)
        errors.append(np.abs(done.y[:, -1] - exact).max())
    slopes = np.diff(np.log(errors)) / np.diff(np.log(steps))
    assert np.all(slopes > 4.7), (errors, slopes)


@pytest.mark.parametrize("method", METHODS)
def test_order_of_the_interpolant(method):
    prob = problem("pendulum", (4.0, 0.1))
    steps, errors = np.array([1 / 5, 1 / 10, 1 / 20]), []
    fine = np.linspace(0.0, 1.0, 101)
    exact = solve_ivp(prob.fun, (0.0, 1.0), [1.0, 0.5], "DOP853", fine, rtol=1e-13, atol=1e-14).y
    for h in steps:
        done = solve(method, prob, (0.0, 1.0), [1.0, 0.5], rtol=1e3, atol=1e3, max_step=h, first_step=h, t_eval=fine)
        errors.append(np.abs(done.y - exact).max())
    slopes = np.diff(np.log(errors)) / np.diff(np.log(steps))
    # Order 4 inside a step: local error of order 5 that does not add up, so the global slope is between 4 and
    # 5.
    assert np.all(slopes > 3.8), (errors, slopes)


@pytest.mark.parametrize("method", METHODS)
def test_errors_follow_the_tolerance(method):
    prob, t = problem("oscillator"), np.linspace(0.0, 10.0, 101)
    errors = []
    for rtol in (1e-4, 1e-6, 1e-8):
        done = solve(method, prob, (0.0, 10.0), [1.0, 0.0], rtol=rtol, atol=rtol, t_eval=t)
        errors.append(np.abs(done.y[0] - np.cos(2.0 * t)).max())
    # Local errors at the tolerance add up over about ten periods.
    assert errors[0] < 1e-2
    assert np.all(np.array(errors[1:]) < 0.05 * np.array(errors[:-1]))


@pytest.mark.parametrize("method", METHODS)
def test_samples_are_the_same_as_t_eval(method):
    table = InputTable.from_columns(np.linspace(0.0, 5.0, 41), {"u": np.sin(np.arange(41.0))}, "cubic")
    prob = problem("oscillator", (40.0, 0.3), table)
    t = np.sort(np.random.default_rng(0).uniform(0.0, 5.0, 301))
    t[0], t[-1] = 0.0, 5.0
    direct = solve(method, prob, (0.0, 5.0), [1.0, 0.0], t_eval=t, rtol=1e-6)
    kept = integrate(prob, (0.0, 5.0), [1.0, 0.0], t, method, rtol=1e-6)
    assert kept.success
    # The same steps and interpolants; what differs is the order of operations at a shared border of two
    # steps.
    np.testing.assert_allclose(kept.y, direct.y, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(kept.t, t)
    pieces = []
    samples = Samples(t, lambda first, times, states: pieces.append((first, times.copy(), states.copy())))
    integrate(prob, (0.0, 5.0), [1.0, 0.0], method=method, samples=samples, rtol=1e-6)
    assert np.concatenate([piece[1] for piece in pieces]).tolist() == t.tolist()
    np.testing.assert_array_equal(np.concatenate([piece[2] for piece in pieces]).T, kept.y)


@pytest.mark.parametrize("method", METHODS)
def test_samples_come_at_once_where_the_buffer_holds_them(method):
    prob, t = problem("oscillator"), np.linspace(0.0, 300.0, 1000)
    pieces = []
    samples = Samples(t, lambda first, times, states: pieces.append(len(states)))
    done = integrate(prob, (0.0, 300.0), [1.0, 0.0], method=method, samples=samples, rtol=1e-11, atol=1e-13)
    assert done.nfev > 6 * 2048, "more steps than the default method takes at a time"
    assert pieces == [1000]


def test_samples_in_many_small_pieces(monkeypatch):
    from multibody.solvers import base

    monkeypatch.setattr(base, "CHUNK_BYTES", 7 * 16)
    prob, t = problem("oscillator"), np.linspace(0.0, 3.0, 100)
    pieces = []
    samples = Samples(t, lambda first, times, states: pieces.append((first, states.copy())))
    integrate(prob, (0.0, 3.0), [1.0, 0.0], samples=samples, rtol=1e-8, atol=1e-10, internal_steps=3)
    assert max(len(states) for _, states in pieces) <= 7
    firsts = [first for first, _ in pieces]
    assert firsts == np.cumsum([0, *(len(states) for _, states in pieces[:-1])]).tolist()
    y = np.concatenate([states for _, states in pieces])
    np.testing.assert_allclose(y[:, 0], np.cos(2.0 * t), rtol=0, atol=1e-6)


@pytest.mark.parametrize("rows", [1, 3, 1000])
def test_a_buffer_that_is_full_where_a_stiff_spell_ends(rows, monkeypatch):
    from multibody.solvers import base

    monkeypatch.setattr(base, "CHUNK_BYTES", 16 * rows)
    prob, t = problem("oscillator", (1e4, 1e4 + 1.0)), np.linspace(0.0, 20.0, 1000)  # exp(-t) and exp(-10 000 t)
    pieces, history = [], []
    samples = Samples(t, lambda first, times, states: pieces.append(states.copy()))
    options = {"samples": samples, "rtol": 1e-11, "atol": 1e-13, "history": history}
    integrate(prob, (0.0, 20.0), [1.0, -1.0], method=Automatic, **options)
    assert len(history) > 3, "stiff for more than one spell"
    # ten times the relative tolerance
    np.testing.assert_allclose(np.concatenate(pieces)[:, 0], np.exp(-t), rtol=0, atol=1e-10)


@pytest.mark.parametrize("method", METHODS)
def test_events(method):
    # cos(2t) crosses zero upwards at 3π/4 and 7π/4; root finding is exact to 4 eps, the solution to its
    # tolerance.
    prob = problem("oscillator")

    def crossing(t, y):
        return y[0]

    crossing.direction = 1.0
    done = integrate(prob, (0.0, 6.0), [1.0, 0.0], method=method, events=crossing, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(done.t_events[0], [3 * np.pi / 4, 7 * np.pi / 4], rtol=0, atol=1e-6)
    crossing.terminal = True
    done = integrate(prob, (0.0, 6.0), [1.0, 0.0], method=method, events=crossing, rtol=1e-8, atol=1e-10)
    assert done.status == 1
    assert done.t[-1] == done.t_events[0][0]


def test_events_between_the_steps_of_one_call_are_not_missed():
    # A pass below zero of 0.1 s is shorter than a call of 64 steps and longer than one step.
    prob = problem("oscillator")
    low = np.cos(2.0 * 0.05)

    def dip(t, y):
        return y[0] + low

    missed = solve(DormandPrince54, prob, (0.0, 3.0), [1.0, 0.0], rtol=1e-10, atol=1e-10, events=dip)
    assert missed.t_events[0].size == 0
    found = integrate(prob, (0.0, 3.0), [1.0, 0.0], events=dip, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(found.t_events[0], [np.pi / 2 - 0.05, np.pi / 2 + 0.05], rtol=0, atol=1e-7)


@pytest.mark.parametrize("method", METHODS)
def test_largest_and_first_step(method):
    prob = problem("oscillator")
    done = solve(method, prob, (0.0, 4.0), [1.0, 0.0], max_step=0.1, first_step=0.03, internal_steps=1)
    assert done.t[1] == pytest.approx(0.03)
    assert np.diff(done.t).max() <= 0.1 * (1 + 1.02e-2)  # a last step may be stretched by a hundredth
    with pytest.raises(ProblemError, match="max_step must be positive"):
        solve(method, prob, (0.0, 4.0), [1.0, 0.0], max_step=-1.0)
    for wrong in (-1.0, 0.0, 5.0):
        with pytest.raises(ProblemError, match="first_step must be positive and within the interval"):
            solve(method, prob, (0.0, 4.0), [1.0, 0.0], first_step=wrong)


@pytest.mark.parametrize("method", METHODS)
def test_zero_interval_and_single_point(method):
    prob = problem("oscillator")
    done = solve(method, prob, (2.0, 2.0), [1.0, 0.5])
    assert done.success
    np.testing.assert_array_equal(done.y[:, -1], [1.0, 0.5])
    sampled = integrate(prob, (2.0, 2.0), [1.0, 0.5], [2.0], method)
    np.testing.assert_array_equal(sampled.y, [[1.0], [0.5]])


@pytest.mark.parametrize("method", METHODS)
def test_tolerances_per_state(method):
    prob = problem("square", (0.0,))
    done = solve(method, prob, (0.0, 0.5), [0.0, 1.0], rtol=[1e-3, 1e-10], atol=[1.0, 1e-12])
    assert abs(done.y[1, -1] - 2.0) < 1e-8
    with pytest.raises(ProblemError, match="atol has the shape"):
        solve(method, prob, (0.0, 0.5), [0.0, 1.0], atol=[1.0, 1.0, 1.0])


@pytest.mark.parametrize("method", METHODS)
def test_blow_up_names_time_and_state(method):
    # x' = x² from 1 is infinite at t = 1.
    prob = problem("square", (0.0,), state_names=("clock", "bubble"))
    done = solve(method, prob, (0.0, 2.0), [0.0, 1.0])
    assert done.status == -1
    assert "state 1 ('bubble')" in done.message
    assert "t = 1" in done.message or "t = 0.99" in done.message
    assert done.t[-1] <= 1.01


@pytest.mark.parametrize("method", METHODS)
def test_not_a_number_stops_with_its_state(method):
    prob = problem("root")
    done = solve(method, prob, (0.0, 2.0), [1.0, 0.0])
    assert done.status == -1
    # Plain Python leaves the function at the fault, so that the state is not known there.
    assert "state 1" in done.message or not jit_enabled()
    assert done.t[-1] == pytest.approx(1.0, abs=1e-3)
    at_once = solve(method, prob, (0.0, 2.0), [-1.0, 0.0])
    assert at_once.status == -1
    assert "is not finite at t = 0 s" in at_once.message
    assert "derivative of state 1" in at_once.message or not jit_enabled()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("span", [(0.0, 1.0), (1.0, 0.0)])
def test_held_inputs_end_steps_at_their_jumps(method, span):
    # x'' = u with u held: the solution is made of parabolas, which both methods integrate exactly.
    times = np.array([0.0, 0.31, 0.32, 0.5, 0.77])
    values = np.array([1.0, -50.0, 2.0, 2.0, 0.0])
    table = InputTable.from_columns(times, {"u": values}, "hold")
    prob = problem("oscillator", (0.0, 0.0), table)

    def exact(t):
        edges = np.append(times, 10.0)
        x = v = 0.0
        for a, b, u in zip(edges[:-1], edges[1:], values, strict=True):
            s = np.clip(t, a, b) - a
            x, v = x + v * s + 0.5 * u * s * s, v + u * s
        return np.array([x, v])

    t = np.linspace(*span, 101)
    done = integrate(prob, span, exact(span[0]), t, method, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(done.y.T, [exact(s) for s in t], rtol=0, atol=1e-12)
    # Five pieces of parabola and no search for the jumps by rejected steps.
    assert done.nfev < 200


@pytest.mark.parametrize("method", METHODS)
def test_a_thousand_jumps_do_not_stall(method):
    times = np.linspace(0.0, 1.0, 1001)
    table = InputTable.from_columns(times, {"u": np.sign(np.sin(37.0 * np.arange(1001)))}, "hold")
    done = integrate(problem("oscillator", (4.0, 0.1), table), (0.0, 1.0), [0.0, 0.0], [1.0], method, rtol=1e-6)
    assert done.success
    assert done.nfev < 1001 * 20


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("control", [False, True])
def test_directions_are_the_derivatives_of_the_solution(method, control):
    times = np.linspace(0.0, 2.0, 21)
    table = InputTable.from_columns(times, {"u": np.sin(3.0 * times)}, "cubic", {"u": 2})
    p, x0 = np.array([4.0, 0.3, 0.23]), np.array([0.5, -0.2])
    bump = np.interp(times, [0.0, 0.7, 1.0, 2.0], [0.0, 0.0, 1.0, 0.0])
    directions = Directions(
        x0_dot=[[1, 0], [0, 0], [0, 0], [0, 0], [0.5, 0]],
        p_dot=[[0, 0, 0], [1, 0, 0], [0, 0, 1], [0, 0, 0], [0, 2, 0]],
        channel=[-1, -1, -1, 0, -1],
        shape_t=times,
        shape=np.column_stack([np.zeros((21, 3)), bump, np.zeros(21)]),
    )
    prob = problem("pendulum", p, table, directions)
    t = np.linspace(0.0, 2.0, 9)
    tight = dict(rtol=1e-11, atol=1e-12)
    done = integrate(prob, (0.0, 2.0), x0, t, method, control_directions=control, **tight)
    x, s = prob.split(done.y)
    eps = 1e-3
    for k in range(5):
        ends = []
        for sign in (1.0, -1.0):
            kink = InputTable.from_columns(times, {"u": sign * eps * directions.shape[:, k]})
            base = problem("pendulum", p + sign * eps * directions.p_dot[k], table)
            if k == 3:
                # The bump acts without the delay of the table, so it is added where the table is read.
                fine = np.linspace(-0.25, 2.0, 9001)
                values = table(fine + p[2], p) + kink(fine + p[2])
                moved = InputTable.from_columns(fine, {"u": values[:, 0]}, "cubic", {"u": 2})
                base = problem("pendulum", p, moved)
            start = x0 + sign * eps * directions.x0_dot[k]
            ends.append(integrate(base, (0.0, 2.0), start, t, DormandPrince54, **tight).y)
        difference = (ends[0] - ends[1]) / (2 * eps)
        # Central differences are exact to about eps² and to the tolerance over eps, both below 1e-6.
        np.testing.assert_allclose(s[k], difference, rtol=0, atol=5e-6)
    np.testing.assert_allclose(x[:, 0], x0, rtol=0, atol=0)


def test_controlling_directions_costs_steps_and_follows_their_scale():
    def evaluations(**options):
        scale = options.pop("scale", 1.0)
        d = Directions(x0_dot=[[0.0, 0.0]], p_dot=[[1.0, 0.0]], scale=[scale])
        prob = problem("oscillator", (400.0, 0.0), directions=d)
        return integrate(prob, (0.0, 3.0), [1e-3, 0.0], [3.0], rtol=1e-12, atol=1e-6, **options).nfev

    assert evaluations(control_directions=True, scale=1e4) > 1.5 * evaluations()


@pytest.mark.parametrize("method", METHODS)
def test_directions_are_right_where_the_state_is_at_rest(method):
    """An oscillator at rest: its own error is zero whatever the step, the derivative swings with cos(20 t)."""
    t = np.linspace(0.0, 3.0, 31)
    prob = problem("oscillator", (400.0, 0.0), directions=Directions(x0_dot=[[1.0, 0.0]], p_dot=[[0.0, 0.0]]))

    def error(**options):
        return np.max(np.abs(integrate(prob, (0.0, 3.0), [0.0, 0.0], t, method, **options).y[2] - np.cos(20.0 * t)))

    assert error() < 0.05
    assert error(direction_rtol=1e-5) < 1e-3
    assert not error(direction_rtol=np.inf) < 0.5


def test_shared_colours_give_the_same_jacobian():
    whole = problem("oscillator", (400.0, 1.0))
    shared = problem(
        "oscillator", (400.0, 1.0), colours=np.array([0, 1]), pattern=np.array([[False, True], [True, True]])
    )
    results = [integrate(p, (0.0, 1.0), [1.0, 0.0], [1.0], Rodas5P) for p in (whole, shared)]
    np.testing.assert_array_equal(results[0].y, results[1].y)
    assert results[0].njev > 0
    assert results[0].nlu >= results[0].njev
    with pytest.raises(ProblemError, match=r"columns \[0, 1\] share a colour and a row"):
        problem("oscillator", colours=np.array([0, 0]), pattern=np.ones((2, 2), bool))
    with pytest.raises(ProblemError, match="pattern of the Jacobian is needed"):
        problem("oscillator", colours=np.array([0, 0]))


def test_scipys_own_methods_take_the_same_problem():
    table = InputTable.from_columns([0.0, 1.0], {"u": [0.0, 1.0]})
    prob = problem("pendulum", (4.0, 0.1), table)
    theirs = solve_ivp(prob.fun, (0.0, 1.0), [1.0, 0.0], method="RK45", rtol=1e-9, atol=1e-11)
    ours = solve(DormandPrince54, prob, (0.0, 1.0), [1.0, 0.0], rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(ours.y[:, -1], theirs.y[:, -1], rtol=0, atol=1e-8)
    # The same pair; step control differs a little.
    assert 0.5 < ours.nfev / theirs.nfev < 1.5


def test_faults_of_use_are_named():
    prob = problem("oscillator")
    with pytest.raises(ProblemError, match="needs a NativeProblem"):
        solve_ivp(prob.fun, (0.0, 1.0), [1.0, 0.0], method=DormandPrince54)
    with pytest.raises(ProblemError, match="y0 has 3 components, the problem 2"):
        solve_ivp(prob.fun, (0.0, 1.0), [1.0, 0.0, 0.0], method=DormandPrince54, problem=prob)
    with pytest.raises(ProblemError, match=r"initial state has the shape \(3,\)"):
        integrate(prob, (0.0, 1.0), [1.0, 0.0, 0.0])
    with pytest.raises(ProblemError, match="within 0 s and 1 s"):
        integrate(prob, (0.0, 1.0), [1.0, 0.0], [0.0, 1.5])
    with pytest.raises(ProblemError, match="follow the direction"):
        integrate(prob, (0.0, 1.0), [1.0, 0.0], [0.5, 0.2])
    with pytest.raises(RuntimeError, match="samples replace dense output"):
        solve(DormandPrince54, prob, (0.0, 1.0), [1.0, 0.0], samples=Samples([1.0]), dense_output=True)
    with pytest.warns(UserWarning, match="ignores: jac"):
        solve(DormandPrince54, prob, (0.0, 0.1), [1.0, 0.0], jac=None)
    with pytest.raises(ProblemError, match="a delay parameter has the index 7, but there are 2 parameters"):
        problem("oscillator", table=InputTable(times=[0.0], values=[[0.0]], delay_parameter=[7]))
    with pytest.raises(ProblemError) as caught:
        problem("oscillator", directions=Directions(x0_dot=[[0.0]], p_dot=[[1.0, 0.0, 0.0]]), state_names=("a",))
    assert "directions are for 1 states and 3 parameters" in str(caught.value)
    assert "2 states but 1 state names" in str(caught.value)
    no_tangent = NativeProblem(rhs=prob.rhs, p=prob.p, table=prob.table, n=2)
    with pytest.raises(ProblemError, match="needs the tangent"):
        integrate(no_tangent, (0.0, 1.0), [1.0, 0.0], method=Rodas5P)


def test_a_fault_in_plain_python_reaches_the_caller():
    module = native.load_source("def rhs(t, x, u, p, dx):\n    dx[0] = nonsense\n", "faulty")
    prob = NativeProblem(rhs=native.compile_rhs(module, compile=False), p=[0.0], table=InputTable.constant([]), n=1)
    with pytest.raises(NameError, match="nonsense"):
        integrate(prob, (0.0, 1.0), [1.0], first_step=0.1)


def test_a_problem_can_be_sent_to_another_process():
    import pickle

    prob = problem("oscillator", directions=Directions(x0_dot=[[1.0, 0.0]], p_dot=[[0.0, 0.0]]))
    sent = pickle.loads(pickle.dumps(prob))
    results = [integrate(p, (0.0, 1.0), [1.0, 0.0], [0.5, 1.0]).y for p in (prob, sent)]
    np.testing.assert_array_equal(*results)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["linear", "cubic"])
def test_kinks_of_delayed_inputs_cost_no_accuracy(method, kind):
    times = np.linspace(0.0, 2.0, 21)
    table = InputTable.from_columns(times, {"u": np.sin(3.0 * times)}, kind, {"u": 2})
    prob = problem("pendulum", (4.0, 0.3, 0.23), table)
    fine = dict(method="DOP853", rtol=1e-12, atol=1e-13, max_step=0.005)
    exact = solve_ivp(prob.fun, (0.0, 2.0), [0.5, -0.2], **fine).y[:, -1]
    done = integrate(prob, (0.0, 2.0), [0.5, -0.2], [2.0], method, rtol=1e-7, atol=1e-7)
    # Within the tolerance; SciPy's RK45, which steps over the kinks, is a hundred times worse here.
    np.testing.assert_allclose(done.y[:, -1], exact, rtol=0, atol=1e-7)


def test_scipys_methods_get_the_exact_jacobian():
    times = np.linspace(0.0, 2.0, 21)
    pattern = np.array([[False, True], [True, True]])
    prob = problem("oscillator", (400.0, 3.0), colours=np.array([0, 1]), pattern=pattern)
    table = InputTable.from_columns(times, {"u": np.sin(times)}, "cubic", {"u": 2})
    whole = problem("pendulum", [4.0, 0.3, 0.23], table)
    for each in (prob, whole):
        jac, fun, x = each.jac, each.fun, np.array([0.4, -0.7])
        step = 1e-6
        for j in range(2):
            ahead, behind = x.copy(), x.copy()
            ahead[j], behind[j] = x[j] + step, x[j] - step
            difference = (fun(1.3, ahead) - fun(1.3, behind)) / (2 * step)
            # central differences: rounding 1e-16 times 400 over the step, and the step squared
            np.testing.assert_allclose(jac(1.3, x)[:, j], difference, rtol=0, atol=1e-6)
