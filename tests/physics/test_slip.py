"""Transmissions that creep: their slip under load, their limit, their loss."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from multibody import Model
from multibody.library import Constant, ForceSource, Inertia, Mass, Rack, SlippingGear, SlippingRack, TorqueSource

J, M, R = 0.02, 3.0, 0.1


def hoist(part: Any, *, torque: float = 0.0, force: float = 0.0, speed: float = 5.0) -> Model:
    """A drum under a torque, and a mass under a force on its rope."""
    m = Model("hoist")
    drive, load = m.add("drive", TorqueSource()), m.add("load", ForceSource())
    drum, mass = m.add("drum", Inertia(J=J, speed=speed)), m.add("mass", Mass(m=M, velocity=R * speed))
    rope = m.add("rope", part)
    m.connect(drive.flange, drum.flange, rope.a)
    m.connect(rope.b, mass.flange, load.flange)
    m.connect(m.add("t", Constant(unit="N*m", value=torque)).output, drive.torque)
    m.connect(m.add("f", Constant(unit="N", value=force)).output, load.force)
    return m


@pytest.mark.parametrize("speed", [5.0, -5.0, 0.0])
def test_the_slip_under_a_steady_load_is_that_of_the_closed_form(speed: float) -> None:
    """What drives and what brakes balance: the speed is steady but for the slip: creep · force · √(u² + v_s²)."""
    creep, v_s, force = 2e-3, 0.05, 10.0
    system = hoist(SlippingRack(radius=R, creep=creep, v_s=v_s), torque=R * force, force=-force, speed=speed).build()
    run = system.simulate(4.0, rtol=1e-9, atol=1e-12)
    surface = R * run["drum.speed"]
    assert run["rope.force"][-1] == pytest.approx(force, rel=1e-6)
    assert run["rope.slip"][-1] == pytest.approx(creep * force * np.hypot(surface[-1], v_s), rel=1e-6)
    assert surface[-1] - run["mass.velocity"][-1] == pytest.approx(run["rope.slip"][-1], rel=1e-9)


def test_without_creep_it_is_the_rigid_transmission() -> None:
    """The error falls in proportion to the creep."""
    rigid = hoist(Rack(radius=R), torque=1.0, force=-4.0).build().simulate(2.0, rtol=1e-10, atol=1e-12)
    errors = []
    for creep in (1e-3, 1e-4):
        part = SlippingRack(radius=R, creep=creep, v_s=0.1)
        run = hoist(part, torque=1.0, force=-4.0).build().simulate(2.0, rtol=1e-10, atol=1e-12)
        errors.append(abs(run["mass.velocity"][-1] - rigid["mass.velocity"][-1]))
    assert errors[1] == pytest.approx(0.1 * errors[0], rel=0.05)


def test_what_is_lost_is_the_force_times_the_slip() -> None:
    system = hoist(SlippingRack(radius=R, creep=0.05, v_s=0.05), torque=2.0, force=-7.0).build()
    run = system.simulate(1.0, rtol=1e-10, atol=1e-12)
    lost = np.trapezoid(run["rope.loss"], run.times)
    supplied = np.trapezoid(2.0 * run["drum.speed"] - 7.0 * run["mass.velocity"], run.times)
    kinetic = 0.5 * J * run["drum.speed"] ** 2 + 0.5 * M * run["mass.velocity"] ** 2
    assert np.all(run["rope.loss"] >= 0.0)
    assert lost > 0.01 * abs(supplied)
    assert supplied - lost == pytest.approx(kinetic[-1] - kinetic[0], rel=1e-3)


def test_a_slipping_gear_is_a_slipping_rack_without_metres() -> None:
    """With the ratio as 1/radius the equations are the same."""
    rack = hoist(SlippingRack(radius=R, creep=0.01, v_s=0.02), torque=1.5, force=-3.0).build().simulate(1.0)
    m = Model("belt")
    drive, load = m.add("drive", TorqueSource()), m.add("load", TorqueSource())
    fast, slow = m.add("fast", Inertia(J=J, speed=5.0)), m.add("slow", Inertia(J=M, speed=R * 5.0))
    belt = m.add("belt", SlippingGear(ratio=1.0 / R, creep=0.01, v_s=0.02))
    m.connect(drive.flange, fast.flange, belt.a)
    m.connect(belt.b, slow.flange, load.flange)
    m.connect(m.add("t", Constant(unit="N*m", value=1.5)).output, drive.torque)
    m.connect(m.add("f", Constant(unit="N*m", value=-3.0)).output, load.torque)
    turning = m.build().simulate(1.0)
    np.testing.assert_allclose(turning["slow.speed"], rack["mass.velocity"], rtol=1e-6)
    np.testing.assert_allclose(turning["belt.torque"], rack["rope.force"], rtol=1e-5)
