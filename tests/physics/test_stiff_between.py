"""The stiff method between the ends of its steps, where kinks of a model fall and samples are taken."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from multibody.compile import native
from multibody.inputs.table import InputTable
from multibody.solvers import Automatic, NativeProblem, Rodas5P, integrate
from multibody.solvers.problem import Directions

RATE = 1e5  # 1/s

SOURCE = """
import math


def follow(t, x, u, p, dx):
    dx[0] = 1.0
    dx[1] = p[0] * (abs(x[0] - math.floor(x[0]) - 0.5) - x[1])


def follow_tangent(t, x, u, p, x_dot, u_dot, p_dot, out):
    out[0] = 0.0
    out[1] = p[0] * (math.copysign(1.0, x[0] - math.floor(x[0]) - 0.5) * x_dot[0] - x_dot[1])
"""


@pytest.fixture(scope="module")
def problem():
    """A state that follows a triangle of slope one and height a half, with a time constant of 10 microseconds."""
    module = native.load_source(SOURCE, "stiff_between")
    tangent = native.compile_tangent(module, "follow_tangent")
    return NativeProblem(
        rhs=native.compile_rhs(module, "follow"), p=(RATE,), table=InputTable.constant([]), n=2, tangent=tangent
    )


def exact(t):
    """Fall, then rise: each a lag behind the triangle, and after a corner what is left of the other lag."""
    phase = t % 1.0
    falls = phase < 0.5
    since = np.where(falls, phase, phase - 0.5)
    left = 2.0 * np.exp(-RATE * since)
    left[t < 0.5] = 0.0
    return np.where(falls, 0.5 - phase + (1.0 - left) / RATE, phase - 0.5 - (1.0 - left) / RATE)


@pytest.mark.parametrize("method", [Rodas5P, Automatic])
@pytest.mark.parametrize("rtol", [1e-4, 1e-5, 1e-6])
def test_corners_inside_a_step_are_seen_by_its_error(problem, method, rtol):
    """A fast motion set off in the middle of a step has died away at its end; samples must not show more of it."""
    times = np.linspace(0.0, 4.0, 40001)
    done = integrate(problem, (0.0, 4.0), exact_start(), times, method, rtol=rtol, atol=1e-3 * rtol)
    error = (done.y[1] - exact(times)) / (1e-3 * rtol + rtol * 0.5)
    assert done.success
    assert np.sqrt(np.mean(error**2)) < 1.0
    assert np.abs(error).max() < 30.0  # the largest of the six is 15.9, with Rodas5P at 1e-4; the error is a mean


def exact_start():
    """Phase zero, one lag behind."""
    return [0.0, 0.5 + 1.0 / RATE]


def test_stiffness_seen_at_the_very_end_is_no_fault(problem):
    """With directions the stiff method is tried on its own first; less may be left than an explicit step is long."""
    directions = Directions(
        x0_dot=np.ones((1, 2)),
        p_dot=np.zeros((1, 1)),
        channel=np.array([-1]),
        shape_t=np.array([0.0, 1.0]),
        shape=np.zeros((2, 1)),
    )
    carried = replace(problem, directions=directions)
    solver = Automatic(lambda t, y: y, 0.0, carried.initial(exact_start()), 1e-5, problem=carried, rtol=1e-4, atol=1e-7)
    solver._explicit_step = 3e-5
    assert solver._pace_alone() > 0.0
