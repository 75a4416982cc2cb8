"""A solver that carries directions side by side gives, to the last bit, what it gives carrying them one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from multibody import Component, Model, Parameter, Translation
from multibody import library as lib
from multibody.solvers import DormandPrince54, Rodas5P, Samples, integrate
from multibody.solvers.automatic import Automatic
from multibody.solvers.problem import Directions
from multibody.system.simulate import input_table, native_problem
from vtsdt.rig.models import build

TIME = np.linspace(0.0, 0.3, 76)
TICKS = np.linspace(0.0, 3.0, 3001)


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
    directions = Directions(
        x0_dot=1e-3 * rng.standard_normal((count, n)), p_dot=p_dot, channel=channels, shape_t=TIME, shape=shape
    )
    given = {"omega_ref": (TIME, 3.0 * np.sin(9.0 * TIME) ** 2), "tau_L": 0.0, "friction_c": 5.0, "friction_cw": 4.0}
    table = input_table(system, given)
    return native_problem(system, system.p, table, directions)


@pytest.mark.parametrize("count", [1, 3, 15, 20, 37])
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


class Ramp(Component):
    """A force that is zero until a time, and then grows."""

    slope = Parameter(0.0, "N/s", "how fast it grows")
    start = Parameter(1.0003, "s", "when it begins")
    flange = Translation("what it pushes")

    def equations(self):
        self.flange.force = -self.slope * max(self.time - self.start, 0.0)


@pytest.mark.parametrize("start", np.linspace(0.3, 2.5, 12))
@pytest.mark.parametrize("method", [Automatic, Rodas5P, DormandPrince54])
def test_a_direction_that_begins_at_a_kink_is_carried_on(method, start):
    """The derivative of x by the slope is what a ramp does to a damped oscillator."""
    model = Model("pushed")
    body, ramp = model.add("body", lib.Mass(m=2.0)), model.add("ramp", Ramp())
    spring = model.add("spring", lib.SpringDamper(stiffness=8e4, damping=300.0))
    model.connect(ramp.flange, body.flange, spring.b)
    model.connect(spring.a, model.ground)
    system = model.build(outputs=["body.position"])
    p_dot = np.zeros((1, len(system.p)))
    p_dot[0, system.index("parameter", "ramp.slope")] = 1.0
    directions = Directions(
        x0_dot=np.zeros((1, 2)), p_dot=p_dot, channel=np.array([-1]), shape_t=np.zeros(1), shape=np.zeros((1, 1))
    )
    p = system.parameter_vector({"ramp.start": start})
    given, samples = native_problem(system, p, input_table(system, {}), directions), Samples(TICKS)
    found = integrate(given, (0.0, 3.0), system.start, samples=samples, method=method, rtol=1e-6, atol=1e-9)
    assert found.status == 0, found.message
    fine = np.linspace(0.0, 3.0, 30001)
    exact = lsim((1.0, [2.0, 300.0, 8e4]), np.maximum(fine - start, 0.0), fine)[1][::10]
    assert np.abs(samples.states[:, 2]) == pytest.approx(exact, abs=1e-4 * np.max(exact))
