"""A tangent along several directions at once is the tangent along each of them."""

from __future__ import annotations

import numpy as np
import pytest

from multibody.compile.native import TANGENT_ARRAYS, compile_text
from multibody.compile.vector_mode import along_directions
from vtsdt.files.parameters import LiftParameters
from vtsdt.lift.lift import Lift


def _systems():
    bench = LiftParameters.bench()
    yield "cabin", Lift.cabin(bench.straightened()).build(outputs=["z_c", "zdd_c", "fric_c"])
    yield "one dimension: branches and kernels", Lift.one_dimensional(bench).build(outputs=["F_c", "i_q"])
    yield "tables", Lift.reference(profile=True).build(outputs=["z_c"])


@pytest.mark.parametrize("count", [3, 4, 8, 12])  # less than a vector of the widest kind, and more
@pytest.mark.parametrize("of", ["rhs_tangent", "outputs_tangent"])
def test_all_directions_at_once_are_each_of_them(of, count):
    for name, system in _systems():
        tangent = getattr(system, of)
        wide = along_directions(tangent, count)
        assert wide is not None, name
        rng = np.random.default_rng(0)
        rows = len(system.states) if of == "rhs_tangent" else len(system.outputs)
        for _ in range(5):
            x = system.start + 1e-3 * rng.standard_normal(len(system.states))
            directions = [rng.standard_normal((size, count)) for size in (x.size, system.u.size, system.p.size)]
            out = wide(0.0, x, system.u, system.p, *directions, np.empty((rows, count)))
            for j in range(count):
                each = (np.ascontiguousarray(d[:, j]) for d in directions)
                one = tangent(0.0, x, system.u, system.p, *each, np.empty(rows))
                np.testing.assert_allclose(out[:, j], one, rtol=1e-12, atol=1e-12 * np.abs(one).max(), err_msg=name)


def test_a_direction_as_an_index_is_outside_the_subset():
    text = "def f(t, x, u, p, x_dot, u_dot, p_dot, out):\n    out[0] = p[int(x_dot[0])]\n"
    tangent = compile_text(text, "f", "f", TANGENT_ARRAYS)
    assert along_directions(tangent, 4) is None


def test_a_tangent_along_several_directions_can_be_sent_to_another_process():
    import pickle

    system = Lift.cabin().build(outputs=["z_c"])
    wide = along_directions(system.rhs_tangent, 4)
    assert wide is not None
    again = pickle.loads(pickle.dumps(wide))
    ones = [np.ones((size, 4)) for size in (len(system.states), system.u.size, system.p.size)]
    arguments = (0.0, system.start, system.u, system.p, *ones)
    rows = (len(system.states), 4)
    np.testing.assert_array_equal(again(*arguments, np.empty(rows)), wide(*arguments, np.empty(rows)))
