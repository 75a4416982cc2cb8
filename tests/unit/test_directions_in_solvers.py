"""A solver that carries directions side by side gives, to the last bit, what it gives carrying them one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from multibody.simulate import input_table, native_problem
from multibody.solvers import Rodas5P, Samples, integrate
from multibody.solvers.automatic import Automatic
from multibody.solvers.problem import Directions
from multibody.solvers.transitions import transitions
from vtsdt.bench_model import build

TIME = np.linspace(0.0, 0.3, 76)


@pytest.fixture(scope="module")
def system():
    return build().build(outputs=["F_c", "i_q"])


def problem(system, count: int, channel: int = -1):
    """Directions in parameters and start states, one of them an input's."""
    rng = np.random.default_rng(count)
    n, n_p = len(system.states), len(system.parameters)
    moved = [system.index("parameter", name) for name in ("cabin.mass", "ropes.EA", "machine.K_T")]
    p_dot = np.zeros((count, n_p))
    p_dot[np.arange(min(3, count)), moved[: min(3, count)]] = 1.0
    channels = np.full(count, -1)
    channels[-1] = channel
    shape = np.zeros((TIME.size, count))
    shape[:, -1] = np.sin(20.0 * TIME)
    directions = Directions(1e-3 * rng.standard_normal((count, n)), p_dot, channels, TIME, shape)
    given = {"omega_ref": (TIME, 3.0 * np.sin(9.0 * TIME) ** 2), "tau_L": 0.0, "friction_c": 5.0, "friction_cw": 4.0}
    table = input_table(system, given)
    return native_problem(system, system.p, table, directions)


@pytest.mark.parametrize("count", [3, 15, 20, 37])
@pytest.mark.parametrize("method", [Automatic, Rodas5P])
def test_directions_in_lanes_are_each_of_them(system, count, method):
    given = problem(system, count, system.index("input", "tau_L"))
    found = []
    for in_lanes in (False, True):
        samples = Samples(TIME)
        whole = replace(given, in_lanes=in_lanes)
        assert (whole._wide() != (0, 0)) == in_lanes
        integrate(whole, (0.0, 0.3), system.start, samples=samples, method=method, rtol=1e-6, atol=1e-9)
        found.append(samples.states.copy())
    assert np.array_equal(*found)


def test_transitions_are_the_same(system):
    states = np.tile(system.start, (TIME.size, 1))
    given = replace(problem(system, 3), directions=None)
    found = [transitions(replace(given, in_lanes=s), TIME, states, [1], 2e-4) for s in (False, True)]
    for one, other in zip(*found, strict=True):
        assert np.array_equal(one, other)
