"""The exponential method: exact along the fast motion, of fourth order beside it, honest without one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from multibody.compile import native
from multibody.inputs.table import InputTable
from multibody.solvers import Directions, DormandPrince54, Exponential43, NativeProblem, ProblemError, integrate

# Two masses on springs with a damper between them, p[0] its rate, p[1] a cubic part of the first spring, and a push.
SOURCE = """
import math


def pair(t, x, u, p, dx):
    between = p[0] * (x[1] - x[3])
    dx[0] = x[1]
    dx[1] = -100.0 * x[0] - p[1] * x[0] ** 3 - between + u[0]
    dx[2] = x[3]
    dx[3] = -400.0 * x[2] + between


def pair_tangent(t, x, u, p, x_dot, u_dot, p_dot, out):
    between = p[0] * (x_dot[1] - x_dot[3])
    out[0] = x_dot[1]
    out[1] = -100.0 * x_dot[0] - 3.0 * p[1] * x[0] * x[0] * x_dot[0] - between + u_dot[0]
    out[2] = x_dot[3]
    out[3] = -400.0 * x_dot[2] + between
"""
START = [0.01, 0.0, -0.02, 0.0]


def problem(rate, cubic=0.0, table=None, directions=None):
    text = native.load_source(SOURCE, "test_exponential")
    table = table or InputTable.constant({"push": 0.0})
    return NativeProblem(
        rhs=native.compile_rhs(text, "pair"),
        p=np.array([rate, cubic]),
        table=table,
        n=4,
        tangent=native.compile_tangent(text, "pair_tangent"),
        directions=directions,
    )


def exact(rate, t):
    matrix = np.array([[0, 1, 0, 0], [-100, -rate, 0, rate], [0, 0, 0, 1], [0, rate, -400, -rate]], dtype=float)
    return expm(matrix * t) @ START


@pytest.mark.parametrize("rate", [0.0, 10.0, 1e3, 1e6])
def test_a_linear_system_at_every_stiffness(rate) -> None:
    """Also without damper, where nothing stands out, and 1e6 times stiffer than anything else."""
    run = integrate(problem(rate), (0.0, 1.0), START, [1.0], Exponential43, rtol=1e-7, atol=1e-11)
    assert run.y[:, -1] == pytest.approx(exact(rate, 1.0), abs=2e-7)


def test_stiffness_costs_nothing() -> None:
    """Evaluations at a rate of 1e6/s are those at 1e3/s, where the explicit method needs 50 times as many."""
    count = {
        (method, rate): integrate(problem(rate, 1e5), (0.0, 1.0), START, [1.0], method, rtol=1e-5, atol=1e-9).nfev
        for method in (Exponential43, DormandPrince54)
        for rate in (1e3, 1e6)
    }
    assert count[Exponential43, 1e6] < 1.5 * count[Exponential43, 1e3]
    assert count[DormandPrince54, 1e6] > 50 * count[Exponential43, 1e6]


@pytest.mark.parametrize("rate", [1.0, 2e3])
def test_the_order_is_four(rate) -> None:
    """Steps of one size: halving it divides the error by about sixteen, with and without a fast motion."""
    errors = []
    fine = integrate(problem(rate, 1e5), (0.0, 1.0), START, [1.0], DormandPrince54, rtol=1e-12, atol=1e-15).y[:, -1]
    for step in (0.01, 0.005):
        loose = {"rtol": 1e3, "atol": 1e3, "max_step": step, "first_step": step}
        run = integrate(problem(rate, 1e5), (0.0, 1.0), START, [1.0], Exponential43, **loose)
        errors.append(np.abs(run.y[:, -1] - fine).max())
    assert 12.0 < errors[0] / errors[1] < 24.0


def test_samples_lie_on_the_path_of_the_fast_motion() -> None:
    """The damper's force is its rate times a small difference: an interpolated state must not spoil it."""
    rate, t = 1e6, np.linspace(0.2, 1.0, 37)
    run = integrate(problem(rate), (0.0, 1.0), START, t, Exponential43, rtol=1e-6, atol=1e-10)
    true = np.array([exact(rate, each) for each in t]).T
    force, wanted = rate * (run.y[1] - run.y[3]), rate * (true[1] - true[3])
    assert np.abs(force - wanted).max() < 1e-3 * np.abs(wanted).max()
    cubic = integrate(problem(rate), (0.0, 1.0), START, None, Exponential43, dense_output=True, rtol=1e-6, atol=1e-10)
    assert cubic.sol(t) == pytest.approx(true, abs=1e-5)


def test_steps_end_where_an_input_jumps() -> None:
    times = np.array([0.0, 0.3, 0.3 + 1e-9, 1.0])
    table = InputTable.from_columns(times, {"push": np.array([0.0, 0.0, 5.0, 5.0])}, "linear", {})
    runs = [
        integrate(problem(1e4, table=table), (0.0, 1.0), START, [1.0], m, rtol=1e-7, atol=1e-11).y[:, -1]
        for m in (Exponential43, DormandPrince54)
    ]
    assert runs[0] == pytest.approx(runs[1], abs=1e-6)


def test_events_are_found() -> None:
    run = integrate(
        problem(3e3), (0.0, 1.0), START, None, Exponential43, events=lambda t, x: x[0], rtol=1e-6, atol=1e-10
    )
    with_explicit = integrate(
        problem(3e3), (0.0, 1.0), START, None, DormandPrince54, events=lambda t, x: x[0], rtol=1e-8, atol=1e-12
    )
    assert run.t_events[0] == pytest.approx(with_explicit.t_events[0], abs=1e-5)


def test_directions_are_refused() -> None:
    directions = Directions(x0_dot=np.zeros((1, 4)), p_dot=np.array([[1.0, 0.0]]))
    with pytest.raises(ProblemError, match="take DormandPrince54 or Rodas5P"):
        integrate(problem(1e3, directions=directions), (0.0, 1.0), START, [1.0], Exponential43)
