"""SciPy's own methods end their steps where the inputs ask for it, and are SciPy's own in everything else."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from multibody.compile import native
from multibody.inputs.table import InputTable
from multibody.solvers import NativeProblem, ProblemError, Samples, integrate
from multibody.solvers.scipy_methods import IMPLICIT, SCIPY_METHODS, Stops, solve_with_stops

# A slow lag, T y' = u - y, whose answer to what an input does is known in closed form.
SLOW = 2.0
SOURCE = """
def lag(t, x, u, p, dx):
    dx[0] = (u[0] - x[0]) / p[0]


def lag_tangent(t, x, u, p, x_dot, u_dot, p_dot, out):
    out[0] = (u_dot[0] - x_dot[0]) / p[0] - p_dot[0] * (u[0] - x[0]) / (p[0] * p[0])
"""
TIGHT = {"rtol": 1e-7, "atol": 1e-10}
METHODS = pytest.mark.parametrize("method", SCIPY_METHODS)
DIRECTIONS = pytest.mark.parametrize("span", [(0.0, 10.0), (10.0, 0.0)])


def problem(table, p=(SLOW,)):
    module = native.load_source(SOURCE, "scipy_method_tests")
    rates, tangent = native.compile_rhs(module, "lag"), native.compile_tangent(module, "lag_tangent")
    return NativeProblem(rhs=rates, p=np.array(p), table=table, n=1, tangent=tangent)


def step_table(at=4.3, kind="hold"):
    return InputTable.from_columns([0.0, at, 20.0], {"u": [1.0, 3.0, 3.0]}, kind)


def stepped(t, at=4.3):
    """The lag from 0 under 1 and, from ``at``, 3."""
    first = 1.0 - np.exp(-np.minimum(t, at) / SLOW)
    return np.where(t < at, first, 3.0 + (first - 3.0) * np.exp(-(t - at) / SLOW))


def plain(prob, method, span, x0, **options):
    more = {"jac": prob.jac} if method in ("Radau", "BDF", "LSODA") else {}
    return solve_ivp(prob.fun, span, x0, method=method, **more, **options)


@METHODS
def test_a_short_pulse_is_not_jumped_over(method):
    # A triangle of 20 ms in 10 s of rest, of area 0.01: y is its answer, known to the second order of its width.
    pulse = InputTable.from_columns([0.0, 4.99, 5.0, 5.01, 10.0], {"u": [0.0, 0.0, 1.0, 0.0, 0.0]})
    done = integrate(problem(pulse), (0.0, 10.0), [0.0], method=method, **TIGHT)
    exact = 0.01 / SLOW * np.exp(-5.0 / SLOW)
    assert done.y[0, -1] == pytest.approx(exact, rel=1e-4)
    assert plain(problem(pulse), method, (0.0, 10.0), [0.0], **TIGHT).y[0, -1] == 0.0  # by themselves they do


@METHODS
def test_steps_end_at_corners(method):
    corners = [1.1, 2.345, 7.0]
    table = InputTable.from_columns([0.0, *corners, 10.0], {"u": [0.0, 0.0, 5.0, -5.0, 0.0]})
    done = integrate(problem(table), (0.0, 10.0), [0.0], method=method, rtol=1e-4, atol=1e-7)
    longest = np.diff(done.t).max()
    for corner in corners:
        assert np.abs(done.t - corner).min() < 1e-9 * longest
    assert done.longest_step == longest


@METHODS
@DIRECTIONS
def test_known_answer_to_a_jump(method, span):
    times = np.linspace(*span, 301)
    start = stepped(np.array([span[0]]))
    done = integrate(problem(step_table()), span, start, t_eval=times, method=method, **TIGHT)
    assert done.success
    np.testing.assert_array_equal(done.t, times)
    # Backwards the lag is unstable: an error grows by exp(5).
    error = np.abs(done.y[0] - stepped(times)).max()
    assert error < (1e-5 if span[0] == 0.0 else 3e-3)


@pytest.mark.parametrize("method", ["RK23", "RK45", "DOP853", "Radau"])
def test_a_jump_costs_no_rejected_steps(method):
    calls = {}
    for kind in ("jump", "none"):
        table = step_table() if kind == "jump" else InputTable.constant([1.0])
        calls[kind] = integrate(problem(table), (0.0, 10.0), [0.0], method=method, rtol=1e-6, atol=1e-9).nfev
    alone = plain(problem(step_table()), method, (0.0, 10.0), [0.0], rtol=1e-6, atol=1e-9).nfev
    # The motion starts once more after the jump; without the stop the steps have to close in on it besides.
    assert calls["jump"] < 2.1 * calls["none"]
    assert calls["jump"] < alone


@METHODS
def test_without_breaks_they_are_scipys_own(method):
    prob = problem(InputTable.constant([1.0]))
    ours = integrate(prob, (0.0, 10.0), [0.0], method=method, dense_output=True, **TIGHT)
    theirs = plain(prob, method, (0.0, 10.0), [0.0], dense_output=True, **TIGHT)
    np.testing.assert_array_equal(ours.t, theirs.t)
    np.testing.assert_allclose(ours.y, theirs.y, rtol=1e-13, atol=0.0)
    assert (ours.nfev, ours.njev, ours.nlu) == (theirs.nfev, theirs.njev, theirs.nlu)
    assert (ours.status, ours.message) == (theirs.status, theirs.message)
    fine = np.sort(np.append(np.linspace(0.0, 10.0, 333), theirs.t))
    np.testing.assert_allclose(ours.sol(fine), theirs.sol(fine), rtol=1e-13, atol=1e-16)


@METHODS
@DIRECTIONS
def test_dense_output_and_samples_agree(method, span):
    start, times = stepped(np.array([span[0]])), np.linspace(*span, 173)
    prob = problem(step_table(kind="linear"))
    both = integrate(prob, span, start, t_eval=times, method=method, dense_output=True, **TIGHT)
    steps = integrate(prob, span, start, method=method, dense_output=True, **TIGHT)
    np.testing.assert_allclose(both.sol(times), both.y, rtol=1e-12)
    np.testing.assert_allclose(steps.sol(steps.t), steps.y, rtol=1e-7)
    assert both.nfev == steps.nfev


@METHODS
def test_events_before_and_after_a_jump(method):
    def rises(t, x):
        return x[0] - 0.5

    def ends(t, x):
        return x[0] - 2.0

    ends.terminal = True
    prob = problem(step_table())
    done = integrate(prob, (0.0, 10.0), [0.0], events=[rises, ends], method=method, **TIGHT)
    first = -SLOW * np.log(0.5)
    at_jump = 1.0 - np.exp(-4.3 / SLOW)
    second = 4.3 - SLOW * np.log(1.0 / (3.0 - at_jump))
    assert done.t_events[0] == pytest.approx([first], abs=1e-5)
    assert done.t_events[1] == pytest.approx([second], abs=1e-5)
    assert done.t[-1] == done.t_events[1][0]
    assert (done.status, done.message) == (1, "A termination event occurred.")


@METHODS
def test_a_delay_moves_the_stop(method):
    table = InputTable.from_columns([0.0, 4.0, 20.0], {"u": [1.0, 3.0, 3.0]}, "hold", {"u": 1})
    done = integrate(problem(table, (SLOW, 0.3)), (0.0, 10.0), [0.0], method=method, **TIGHT)
    assert done.y[0, -1] == pytest.approx(float(stepped(np.array(10.0))), abs=1e-5)
    assert np.abs(done.t - 4.3).min() < 1e-9


@METHODS
def test_the_largest_step_asked_for_is_kept(method):
    done = integrate(problem(step_table()), (0.0, 10.0), [0.0], method=method, max_step=0.07)
    assert np.diff(done.t).max() <= 0.07 * (1.0 + 1e-9)
    assert np.abs(done.t - 4.3).min() < 1e-9


@pytest.mark.parametrize("method", ["RK45", "DOP853", "Radau", "BDF"])
def test_failures_say_what_scipy_says(method):
    def explodes(t, x):
        return np.array([x[0] * x[0]])

    ours = solve_with_stops(explodes, (0.0, 2.0), np.array([1.0]), step_table(0.5), np.zeros(0), method, rtol=1e-6)
    theirs = solve_ivp(explodes, (0.0, 2.0), [1.0], method=method, rtol=1e-6)
    assert not ours.success
    assert (ours.status, ours.message) == (theirs.status, theirs.message)
    assert ours.t[-1] == pytest.approx(1.0, abs=1e-3)


@METHODS
def test_evaluations_are_counted_honestly(method):
    calls = []

    def rates(t, x):
        calls.append(t)
        return -x

    jac = {"jac": lambda t, x: np.array([[-1.0]])} if method in IMPLICIT else {}  # else some calls go into differences
    done = solve_with_stops(rates, (0.0, 3.0), np.array([1.0]), step_table(0.5), np.zeros(0), method, **jac)
    assert len(calls) == done.nfev


def test_stops_near_each_other_are_one():
    stops = Stops(np.array([1.0, 1.0 + 1e-15, 2.0, 7.0]), np.array([False, True, False, True]), (0.0, 5.0))
    assert stops.ahead() == 1.0
    stops.ended(1.0, 0.5)
    assert stops.go_on()  # at a jump
    assert stops.ahead() == 2.0
    stops.ended(1.9, 0.9)
    assert not stops.go_on()
    assert stops.ahead() == 2.0
    stops.ended(2.0 - 1e-13, 0.1)
    assert not stops.go_on()  # at a corner
    assert stops.ahead() is None
    assert stops.longest == 0.9


def test_samples_are_refused():
    with pytest.raises(ProblemError, match="RK45 writes no samples"):
        integrate(problem(step_table()), (0.0, 1.0), [0.0], method="RK45", samples=Samples([0.5]))
