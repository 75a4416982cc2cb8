"""A tangent along many directions at once is the tangent along each of them."""

from __future__ import annotations

import numpy as np
import pytest

from multibody.directions import along_directions, widened
from vtsdt.lift import Lift
from vtsdt.parameters import LiftParameters


@pytest.fixture(scope="module")
def cabin():
    return Lift.cabin(LiftParameters.bench().straightened()).build(outputs=["z_c", "zdd_c", "fric_c"])


@pytest.fixture(scope="module")
def reference():
    return Lift.reference(profile=True).build(outputs=["z_c", "zdd_c", "fric_c"])


@pytest.mark.parametrize("of", ["rhs_tangent", "outputs_tangent"])
@pytest.mark.parametrize("machine", ["cabin", "reference"])  # the rails of the latter are tables
def test_all_directions_at_once_are_each_of_them(machine, of, request):
    system = request.getfixturevalue(machine)
    tangent = getattr(system, of)
    wide = along_directions(tangent, 8)
    assert wide is not None
    rng = np.random.default_rng(0)
    rows = len(system.states) if of == "rhs_tangent" else len(system.outputs)
    for _ in range(20):
        x = system.start + 1e-3 * rng.standard_normal(len(system.states))
        u, p = system.u + 310.0 * (machine == "cabin") + rng.standard_normal(len(system.inputs)), system.p.copy()
        if machine == "cabin":
            p[system.index("parameter", "cabin_guide.right_deviation")] = 2e-3
        else:
            x[system.index("state", "cabin.z")] = rng.uniform(0.1, 2.0)
        directions = [rng.standard_normal((size, 8)) for size in (x.size, u.size, p.size)]
        out = wide(0.0, x, u, p, *directions, np.empty((rows, 8)))
        for j in range(8):
            one = tangent(0.0, x, u, p, *(np.ascontiguousarray(d[:, j]) for d in directions), np.empty(rows))
            np.testing.assert_allclose(out[:, j], one, rtol=1e-12, atol=1e-12 * np.abs(one).max())


def test_texts_that_cannot_be_parted_stay_as_they_are():
    head = "def f(t, x, u, p, x_dot, u_dot, p_dot, out):\n"
    for body in (
        "    for i in range(2):\n        out[i] = x_dot[i]",
        "    out[0] = g(p_dot, 1)",  # the whole array of directions handed on
    ):
        assert widened(head + body, "f", 4) is None


def test_a_name_with_two_values_keeps_each_where_it_is_read():
    text = """
def f(t, x, u, p, x_dot, u_dot, p_dot, out):
    a = x[0]
    b = 3.0 * a
    a = 2.0 * a
    out[0] = a * x_dot[0] + b * x_dot[1]"""
    found: dict = {}
    exec(widened(text, "f", 4), found)
    directions, out = np.arange(8.0), np.zeros(4)
    found["f"](0.0, np.array([5.0, 0.0]), None, None, directions, None, None, out)
    assert np.array_equal(out, 10.0 * directions[:4] + 15.0 * directions[4:])
