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


@pytest.mark.parametrize("of", ["rhs_tangent", "outputs_tangent"])
def test_all_directions_at_once_are_each_of_them(cabin, of):
    tangent = getattr(cabin, of)
    wide = along_directions(tangent, 8)
    assert wide is not None
    rng = np.random.default_rng(0)
    rows = len(cabin.states) if of == "rhs_tangent" else len(cabin.outputs)
    for _ in range(20):
        x = cabin.start + 1e-3 * rng.standard_normal(len(cabin.states))
        u, p = np.array([310.0 + rng.standard_normal()]), cabin.p.copy()
        p[cabin.index("parameter", "cabin_guide.right_deviation")] = 2e-3
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
    assert along_directions(Lift.reference(profile=True).build(outputs=["z_c"]).rhs_tangent, 40) is None  # tables
