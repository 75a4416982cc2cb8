"""Masses, springs and dampers against their closed forms, and in the limits where they are simpler."""

from __future__ import annotations

import numpy as np
import pytest

from multibody import Model
from multibody.library import Damper, ForceSource, InclinedMass, Inertia, Mass, Pendulum, Rack, Spring, Weight

TIGHT = {"rtol": 1e-10, "atol": 1e-13}
# A global error a few hundred times the local tolerance is what an explicit method leaves after some ten
# periods.
CLOSE = 1e-7


def oscillator(m=2.0, k=50.0, c=0.0, **start):
    model = Model("oscillator")
    body = model.add("body", Mass(m=m, **start))
    spring, damper, push = (
        model.add(n, part)
        for n, part in (("spring", Spring(stiffness=k)), ("damper", Damper(damping=c)), ("push", ForceSource()))
    )
    for part in (spring, damper):
        model.connect(part.a, model.ground)
        model.connect(part.b, body.flange)
    model.connect(push.flange, body.flange)
    model.input("F", push.force, default=0.0)
    return model.build()


def test_free_vibration():
    run = oscillator(position=0.1, velocity=0.3).simulate(10.0, **TIGHT)
    w = 5.0
    expected = 0.1 * np.cos(w * run.times) + 0.3 / w * np.sin(w * run.times)
    np.testing.assert_allclose(run["body.position"], expected, atol=CLOSE)


def test_damped_vibration():
    m, k, c = 2.0, 50.0, 3.0
    run = oscillator(m, k, c, position=0.1).simulate(5.0, **TIGHT)
    d = c / (2.0 * m)
    w = np.sqrt(k / m - d**2)
    expected = 0.1 * np.exp(-d * run.times) * (np.cos(w * run.times) + d / w * np.sin(w * run.times))
    np.testing.assert_allclose(run["body.position"], expected, atol=CLOSE)


def test_forced_vibration_settles_to_the_frequency_response():
    m, k, c, force, w = 2.0, 50.0, 3.0, 4.0, 7.0
    response = force / (k - m * w**2 + 1j * c * w)
    # started on the settled solution, so that there is no transient
    start = {"body.position": response.imag, "body.velocity": (1j * w * response).imag}
    t = np.linspace(0.0, 5.0, 50001)
    run = oscillator(m, k, c).simulate(
        5.0, inputs={"F": (t, force * np.sin(w * t))}, initial=start, times=t[::100], **TIGHT
    )
    # straight lines between samples are off by (w·dt)²/8 = 6e-8 of the force
    np.testing.assert_allclose(
        run["body.position"], (response * np.exp(1j * w * run.times)).imag, atol=1e-6 * abs(response)
    )


def test_natural_frequency_and_damping_from_linearisation():
    m, k, c = 2.0, 50.0, 3.0
    values = np.linalg.eigvals(oscillator(m, k, c).jacobian("x", 0.0, np.zeros(2)))
    np.testing.assert_allclose(abs(values), np.sqrt(k / m), rtol=1e-12)
    np.testing.assert_allclose(values.real, -c / (2.0 * m), rtol=1e-12)


def test_maxwell_element_relaxes():
    """A spring and a damper in series: the node between them has no mass."""
    k, c = 50.0, 20.0
    model = Model("Maxwell")
    spring, damper = model.add("spring", Spring(stiffness=k)), model.add("damper", Damper(damping=c))
    held = model.add("held", Mass(position=0.1, free=False))
    model.connect(spring.a, model.ground)
    model.connect(spring.b, damper.a)
    model.connect(damper.b, held.flange)
    system = model.build()
    assert system.state_names == ("spring.b.position",)
    run = system.simulate(1.0, initial={"spring.b.position": 0.1}, **TIGHT)
    np.testing.assert_allclose(run["spring.b.position"], 0.1 * np.exp(-k / c * run.times), atol=CLOSE)


def test_momentum_is_kept_by_internal_forces():
    model = Model("pair")
    a, b = model.add("a", Mass(m=2.0, velocity=1.0)), model.add("b", Mass(m=3.0, velocity=-0.2, position=0.1))
    spring, damper = model.add("spring", Spring(stiffness=200.0)), model.add("damper", Damper(damping=4.0))
    for part in (spring, damper):
        model.connect(part.a, a.flange)
        model.connect(part.b, b.flange)
    # holds at any tolerance: the forces are equal and opposite at every stage
    run = model.build().simulate(3.0)
    momentum = 2.0 * run["a.velocity"] + 3.0 * run["b.velocity"]
    np.testing.assert_allclose(momentum, momentum[0], atol=1e-13)
    assert np.ptp(run["a.velocity"]) > 0.5  # and the masses did exchange it


def test_stiff_spring_tends_to_a_rigid_link():
    """Two masses on a spring of stiffness k move as one, up to a vibration of F·m_b/((m_a + m_b)·k)."""
    gaps = []
    for k in (1e4, 1e6):
        model = Model("stiff")
        a, b = model.add("a", Mass(m=1.0)), model.add("b", Mass(m=1.0))
        spring, push = model.add("spring", Spring(stiffness=k)), model.add("push", ForceSource())
        model.connect(spring.a, a.flange)
        model.connect(spring.b, b.flange)
        model.connect(push.flange, a.flange)
        model.input("F", push.force)
        run = model.build().simulate(1.0, inputs={"F": 2.0}, rtol=1e-9, atol=1e-12)
        # the centre of mass does not know of the spring at all
        middle = 0.5 * (run["a.position"] + run["b.position"])
        np.testing.assert_allclose(middle, 0.5 * run.times**2, atol=1e-8)
        gaps.append(np.max(abs(run["b.position"] - run["a.position"])))
        assert gaps[-1] <= 2.0 * (2.0 * 0.5 / k) * 1.001  # a sudden load reaches twice the static deflection
    assert gaps[0] / gaps[1] == pytest.approx(100.0, rel=0.01)


def test_free_fall_and_slope():
    model = Model("fall")
    model.add("up", InclinedMass(m=3.0, velocity=2.0))
    model.add("slope", InclinedMass(m=5.0, incline=0.3, g=9.81))
    run = model.build().simulate(1.5, **TIGHT)
    np.testing.assert_allclose(run["up.position"], 2.0 * run.times - 0.5 * 9.80665 * run.times**2, atol=1e-10)
    np.testing.assert_allclose(run["slope.velocity"], -9.81 * np.sin(0.3) * run.times, atol=1e-10)


def test_atwood_machine():
    """Two masses over a drum: a = g (m_1 − m_2)/(m_1 + m_2 + J/r²)."""
    m_1, m_2, J, r, g = 3.0, 2.0, 0.02, 0.1, 9.80665
    model = Model("Atwood")
    drum = model.add("drum", Inertia(J=J))
    for name, m, way in (("one", m_1, 1.0), ("two", m_2, -1.0)):
        load = model.add(name, Mass(m=m))
        rope = model.add(f"rope.{name}", Rack(radius=way * r))
        weight = model.add(f"weight.{name}", Weight(m=m, g=g))
        model.connect(rope.a, drum.flange)
        model.connect(rope.b, load.flange, weight.flange)
    system = model.build()
    assert len(system.states) == 2
    rate = system.rhs(0.0, system.start)[system.index("state", "drum.speed")]
    assert rate * r == pytest.approx(-g * (m_1 - m_2) / (m_1 + m_2 + J / r**2), rel=1e-12)


def test_pendulum_period_at_large_amplitude():
    """T = 4/ω₀ · K(sin²(amplitude/2)), with the complete elliptic integral K."""
    from scipy.special import ellipk

    J, m, arm, g, amplitude = 0.08, 1.0, 0.25, 9.81, 2.0
    model = Model("pendulum")
    model.add("p", Pendulum(J=J, m=m, arm=arm, g=g, angle=amplitude))
    period = 4.0 / np.sqrt(m * g * arm / J) * ellipk(np.sin(0.5 * amplitude) ** 2)
    run = model.build().simulate(3.0 * period, times=period * np.arange(4), **TIGHT)
    np.testing.assert_allclose(run["p.angle"], amplitude, atol=1e-6)
