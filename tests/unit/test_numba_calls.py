"""Functions of a system are called from functions that a user compiles with numba."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

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


def test_the_example_of_the_page_gives_the_variance_that_it_expects(capsys):
    page = (Path(__file__).resolve().parents[2] / "docs" / "howto" / "numba.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    names: dict[str, object] = {"__name__": "example"}
    exec(compile(code, "numba.md", "exec"), names)
    # of 2000 runs the variance is known to within 1/sqrt(1000), and the steps add less than that
    assert np.var(names["ends"]) == pytest.approx(names["expected"], rel=0.1)
    assert "variance of the velocity" in capsys.readouterr().out


def test_a_cached_function_of_a_user_follows_the_model(system, tmp_path):
    """As the page says: where the model's function is a local name, an edited model makes another key."""
    (tmp_path / "own.py").write_text(
        "from numba import njit\n\n\ndef make(rhs):\n    @njit(cache=True)\n    def first(x, u, p):\n"
        "        return rhs(0.0, x, u, p)[1]\n\n    return first\n"
    )
    code = (
        "import sys, numpy as np; sys.path.insert(0, sys.argv[1]); from own import make; "
        "from multibody import Model; from multibody.library import Mass, Spring, SpringDamper; "
        "part = Spring(stiffness=4.0) if sys.argv[2] == 'spring' else SpringDamper(stiffness=4.0, damping=2.0); "
        "m = Model('m'); b = m.add('b', Mass(m=1.0)); s = m.add('s', part); m.connect(s.a, m.ground); "
        "m.connect(s.b, b.flange); s = m.build(); f = make(s.rhs); "
        "print(f(np.array([0.0, 1.0]), s.u, s.p), sum(f.stats.cache_hits.values()))"
    )

    def run(kind):
        words = [sys.executable, "-c", code, str(tmp_path), kind]
        return subprocess.run(words, capture_output=True, text=True, check=True).stdout.split()

    kinds = ("spring", "spring", "damper")
    assert [tuple(map(float, run(kind))) for kind in kinds] == [(0.0, 0.0), (0.0, 1.0), (-2.0, 0.0)]
