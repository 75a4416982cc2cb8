"""End stops, play and ropes: nothing pulls that cannot pull, nothing jumps, and the limit cases are right."""

from __future__ import annotations

import numpy as np
import pytest

from multibody import Model
from multibody.library import Backlash, EndStop, Mass, PositionSource, RopeSegment, WoundRope, laws


def bounce(damping):
    """A mass that flies at 2 m/s against a stop at 10 mm."""
    model = Model("bounce")
    ball = model.add("ball", Mass(m=0.5, velocity=2.0))
    stop = model.add("stop", EndStop(stiffness=2e4, damping=damping, limit=0.01))
    model.connect(stop.a, model.ground)
    model.connect(stop.b, ball.flange)
    return model.build(energy=True)


def test_elastic_stop_returns_the_speed_after_half_a_period():
    # contact lasts π·√(m/k) = 15.7 ms
    contact = np.pi * np.sqrt(0.5 / 2e4)
    times = np.array([0.0, 0.005, 0.005 + 0.5 * contact, 0.005 + contact, 0.005 + 2.0 * contact])
    run = bounce(0.0).simulate(times[-1], times=times, rtol=1e-10, atol=1e-13)
    assert run["ball.velocity"][2] == pytest.approx(0.0, abs=1e-6)
    assert run["ball.position"][2] - 0.01 == pytest.approx(2.0 * np.sqrt(0.5 / 2e4), rel=1e-7)
    np.testing.assert_allclose(run["ball.velocity"][3:], -2.0, rtol=1e-7)


def test_damped_stop_never_pulls_and_loses_what_it_should():
    run = bounce(40.0).simulate(0.05, rtol=1e-9, atol=1e-12)
    force = run["stop.force"]
    assert force.min() == 0.0
    assert force.max() > 100.0
    assert -2.0 < run["ball.velocity"][-1] < -0.5
    balance = run["energy.stored"] + run["energy.lost"]
    np.testing.assert_allclose(balance, balance[0], rtol=1e-7)


def test_contact_force_is_continuous_and_between_its_bounds():
    rng = np.random.default_rng(3)
    for depth, rate in rng.uniform(-1.0, 1.0, (500, 2)):
        force = laws.contact(depth, rate, 10.0, 30.0)
        assert 0.0 <= force <= 2.0 * 10.0 * max(depth, 0.0)
    # at first touch the force vanishes however fast the hit is
    assert laws.contact(1e-12, 1e3, 10.0, 30.0) <= 2e-11


def joined(gap, **start):
    model = Model("play")
    a, b = model.add("a", Mass(m=1.0, velocity=1.0)), model.add("b", Mass(m=2.0, **start))
    play = model.add("play", Backlash(gap=gap, stiffness=5e3))
    model.connect(play.a, a.flange)
    model.connect(play.b, b.flange)
    return model.build()


def test_play_is_free_until_it_is_used_up():
    # a moves towards b at 1 m/s and has half the gap, 0.1 m, before contact
    run = joined(0.2).simulate(0.3, times=np.array([0.0, 0.05, 0.0999, 0.3]), rtol=1e-10, atol=1e-13)
    np.testing.assert_array_equal(run["b.velocity"][:3], 0.0)
    np.testing.assert_allclose(run["a.position"][:3], run.times[:3], atol=1e-12)
    # an elastic impact: b leaves with 2 m_a/(m_a + m_b) of the speed
    assert run["b.velocity"][3] == pytest.approx(2.0 / 3.0, rel=1e-6)


def test_play_without_a_gap_is_a_spring():
    w = np.sqrt(5e3 * (1.0 + 1.0 / 2.0))
    run = joined(0.0).simulate(0.2, rtol=1e-10, atol=1e-13)
    expected = -1.0 / w * np.sin(w * run.times)
    np.testing.assert_allclose(run["b.position"] - run["a.position"], expected, atol=1e-8)


@pytest.mark.parametrize("method", ["DormandPrince54", "LSODA"])
def test_no_step_jumps_over_a_gap(method):
    """Bounces of a mass in a gap of 1 mm: each reverses the speed, so the energy tells if one was missed."""
    model = Model("rattle")
    ball = model.add("ball", Mass(m=1.0, velocity=0.5))
    play = model.add("play", Backlash(gap=1e-3, stiffness=1e6))
    model.connect(play.a, model.ground)
    model.connect(play.b, ball.flange)
    run = model.build().simulate(0.5, method=method, rtol=1e-8, atol=1e-11)
    assert np.max(abs(run["ball.position"])) < 0.5e-3 + 0.5 * np.sqrt(1.0 / 1e6) * 1.01
    assert np.max(abs(run["ball.velocity"])) == pytest.approx(0.5, rel=1e-3)


def test_rope_pulls_and_never_pushes():
    model = Model("rope")
    load = model.add("load", Mass(m=1.0, velocity=1.0))
    rope = model.add("rope", RopeSegment(EA=1e3, length=1.0, damping=5.0))
    model.connect(rope.a, load.flange)  # to a fixed point ahead of the load: slack as the load approaches
    model.connect(rope.b, model.ground)
    run = model.build().simulate(3.0, initial={"load.position": -1.05}, rtol=1e-9, atol=1e-12)
    tension = run["rope.tension"]
    assert tension.min() == 0.0
    assert tension.max() > 10.0
    slack = -run["load.position"] < 1.0
    assert slack.any()
    np.testing.assert_array_equal(tension[slack], 0.0)


def test_wound_rope_holds_its_stretch_when_both_ends_follow():
    """If the upper end and the free length grow alike, the load stays where it was in balance."""
    model = Model("winding")
    rope = model.add("rope", WoundRope(EA=1e4))
    end = model.add("end", PositionSource())
    model.connect(rope.b, end.flange)
    model.connect(rope.a, model.add("load", Mass(m=1.0, free=False, position=-1.001)).flange)
    model.input("L", rope.length)
    model.input("L_rate", rope.length_rate)
    for name in ("position", "velocity", "acceleration"):
        model.input(name, f"end.{name}")
    system = model.build()
    u = {"L": 1.0, "L_rate": 0.0, "position": 0.0, "velocity": 0.0, "acceleration": 0.0}
    moved = u | {"L": 1.5, "L_rate": 0.2, "position": 0.5, "velocity": 0.2}
    read = [
        system.outputs_at(0.0, system.start, np.array([values[n] for n in system.input_names]))[
            system.index("output", "rope.tension")
        ]
        for values in (u, moved)
    ]
    assert read[0] == pytest.approx(1e4 * 0.001)
    assert read[1] == pytest.approx(1e4 / 1.5 * 0.001)  # the same stretch over a longer rope
