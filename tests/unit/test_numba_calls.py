"""Functions of a system are called from functions that a user compiles with numba."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError

from multibody import Model
from multibody.library import Mass, Spring


@pytest.fixture(scope="module")
def system():
    model = Model("oscillator")
    body, spring = model.add("body", Mass(m=2.0, position=0.1)), model.add("spring", Spring(stiffness=100.0))
    model.connect(spring.a, model.ground)
    model.connect(spring.b, body.flange)
    return model.build()


def test_rates_and_outputs_are_those_that_python_gets(system):
    rhs, outputs = system.rhs, system.outputs_at

    @njit
    def both(t, x, u, p):
        return rhs(t, x, u, p), outputs(t, x, u, p)

    x = np.array([0.3, -0.7])
    rates, values = both(0.0, x, system.u, system.p)
    np.testing.assert_array_equal(rates, system.rhs(0.0, x))
    np.testing.assert_array_equal(values, system.outputs_at(0.0, x))
    np.testing.assert_array_equal(rates, both.py_func(0.0, x, system.u, system.p)[0])


def test_functions_that_write_and_tangents_are_called_as_in_python(system):
    rhs, tangent = system.rhs_function, system.rhs_tangent

    @njit
    def both(t, x, u, p, x_dot, u_dot, p_dot):
        dx, out = np.empty(x.size), np.empty(x.size)
        rhs(t, x, u, p, dx)
        tangent(t, x, u, p, x_dot, u_dot, p_dot, out)
        return dx, out

    x, rng = np.array([0.3, -0.7]), np.random.default_rng(1)
    seeds = rng.normal(size=2), rng.normal(size=system.u.size), rng.normal(size=system.p.size)
    for t in (0, 0.5):
        for compiled, plain in zip(
            both(t, x, system.u, system.p, *seeds), both.py_func(t, x, system.u, system.p, *seeds), strict=True
        ):
            np.testing.assert_array_equal(compiled, plain)


def test_a_function_can_be_given_as_an_argument(system):
    @njit
    def apply(f, x, u, p):
        return f(0.0, x, u, p)

    x = np.array([0.3, -0.7])
    np.testing.assert_array_equal(apply(system.rhs, x, system.u, system.p), system.rhs(0.0, x))


def test_an_array_that_is_not_contiguous_is_refused_with_the_remedy(system):
    rhs = system.rhs

    @njit
    def sliced(x, u, p):
        return rhs(0.0, x[::2], u, p)

    with pytest.raises(TypingError, match="contiguous arrays of float64"):
        sliced(np.zeros(4), system.u, system.p)


def test_a_system_that_is_not_compiled_says_so(system):
    rhs = system.model.build(compiled=False).rhs

    @njit
    def call(x, u, p):
        return rhs(0.0, x, u, p)

    with pytest.raises(TypeError, match="rhs is not compiled"):
        call(np.zeros(2), system.u, system.p)
