"""Circuits, motors and transmissions against their closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from multibody import Model
from multibody.library import (
    PMSM,
    Capacitor,
    Crank,
    CurrentSensor,
    DCMotor,
    DCMotorDrive,
    ForceSource,
    Gear,
    Inductor,
    Inertia,
    Mass,
    Resistor,
    RotaryViscousFriction,
    Screw,
    TorqueSource,
    VoltageSource,
)

TIGHT = {"rtol": 1e-10, "atol": 1e-13}


def series(*parts):
    """A voltage source and parts in a row; the last one ends at the ground."""
    model = Model("circuit")
    source = model.add("source", VoltageSource())
    model.input("V", source.voltage)
    model.connect(source.n, model.ground)
    last = source.p
    for k, part in enumerate(parts):
        part = model.add(f"part{k}", part)
        model.connect(last, part.p)
        last = part.n
    model.connect(last, model.ground)
    return model.build(energy=True)


def test_rl_circuit():
    run = series(Resistor(R=2.0), Inductor(L=0.1)).simulate(0.3, inputs={"V": 6.0}, **TIGHT)
    np.testing.assert_allclose(run["part1.current"], 3.0 * (1.0 - np.exp(-20.0 * run.times)), atol=1e-8)


def test_rc_circuit_and_its_lost_half_of_the_energy():
    run = series(Resistor(R=100.0), Capacitor(C=1e-3)).simulate(4.0, inputs={"V": 6.0}, **TIGHT)
    np.testing.assert_allclose(run["part1.voltage"], 6.0 * (1.0 - np.exp(-10.0 * run.times)), atol=1e-8)
    half = 0.5 * 1e-3 * 6.0**2  # whatever the resistance, charging loses as much as it stores
    assert run["energy.lost"][-1] == pytest.approx(half, rel=1e-7)
    assert run["energy.supplied"][-1] == pytest.approx(2.0 * half, rel=1e-7)


def test_rlc_rings_at_its_frequency():
    L, C = 0.1, 1e-3
    run = series(CurrentSensor(), Inductor(L=L), Capacitor(C=C)).simulate(0.5, inputs={"V": 1.0}, **TIGHT)
    w = 1.0 / np.sqrt(L * C)
    np.testing.assert_allclose(run["part2.voltage"], 1.0 - np.cos(w * run.times), atol=1e-7)
    np.testing.assert_allclose(run["part0.current"], C * w * np.sin(w * run.times), atol=1e-8)


def test_series_resistors_divide_the_voltage():
    system = series(Resistor(R=1.0), Resistor(R=2.0), Resistor(R=3.0))
    y = system.outputs_at(0.0, system.start, np.array([12.0]))
    for k in range(3):
        assert y[system.index("output", f"part{k}.current")] == pytest.approx(2.0, rel=1e-14)


def motor(part, **wiring):
    model = Model("motor")
    machine = model.add("motor", part)
    rotor = model.add("rotor", Inertia(J=2e-3))
    drag = model.add("drag", RotaryViscousFriction(viscous=1e-3))
    model.connect(drag.a, model.ground)
    model.connect(machine.flange, rotor.flange, drag.b)
    if isinstance(part, DCMotor):
        source = model.add("source", VoltageSource())
        model.connect(source.p, machine.p)
        model.connect(source.n, machine.n, model.ground)
        model.input("V", source.voltage)
    else:
        model.input("V", machine.voltage)
    return model.build()


R, L, K, J, D = 1.2, 3e-3, 0.08, 2e-3, 1e-3


def test_dc_motor_steady_state_and_time_constants():
    system = motor(DCMotor(R=R, L=L, k_t=K))
    run = system.simulate(10.0, inputs={"V": 12.0}, rtol=1e-9, atol=1e-12)
    speed = 12.0 * K / (R * D + K**2)
    assert run["rotor.speed"][-1] == pytest.approx(speed, rel=1e-7)
    assert run["motor.current"][-1] == pytest.approx(D * speed / K, rel=1e-6)
    values = np.sort(np.linalg.eigvals(system.jacobian("x", 0.0, system.start)).real)
    # J L s² + (J R + L D) s + R D + K² = 0, and the angle's integrator
    expected = np.sort([0.0, *np.roots([J * L, J * R + L * D, R * D + K**2])])
    np.testing.assert_allclose(values, expected, rtol=1e-9)


def test_motor_without_inductance_has_the_mechanical_time_constant():
    system = motor(DCMotorDrive(R=R, k_t=K, inductive=False))
    run = system.simulate(1.0, inputs={"V": 12.0}, **TIGHT)
    rate = (R * D + K**2) / (R * J)
    expected = 12.0 * K / (R * D + K**2) * (1.0 - np.exp(-rate * run.times))
    np.testing.assert_allclose(run["rotor.speed"], expected, rtol=1e-7, atol=1e-8)


def test_pmsm_in_balance():
    """At constant speed: V_q = R i_q + ω_e ψ, V_d = −ω_e L_q i_q for i_d = 0, and torque 3/2·p·ψ·i_q."""
    p, psi, L_d, L_q, i_q, speed = 4.0, 0.06, 2e-3, 3e-3, 5.0, 30.0
    model = Model("servo")
    servo = model.add("servo", PMSM(R=R, L_d=L_d, L_q=L_q, psi=psi, pole_pairs=p, i_q=i_q))
    rotor = model.add("rotor", Inertia(J=J, speed=speed))
    drag = model.add("drag", RotaryViscousFriction(viscous=1.5 * p * psi * i_q / speed))
    model.connect(drag.a, model.ground)
    model.connect(servo.flange, rotor.flange, drag.b)
    model.input("V_d", servo.V_d)
    model.input("V_q", servo.V_q)
    system = model.build()
    u = np.array([-p * speed * L_q * i_q, R * i_q + p * speed * psi])
    assert system.input_names == ("V_d", "V_q")
    rates = system.rhs(0.0, system.start, u)
    moving = [k for k, name in enumerate(system.state_names) if name != "rotor.angle"]
    np.testing.assert_allclose(rates[moving], 0.0, atol=1e-9)


def geared(gear, load, **start):
    """A motor rotor behind a transmission with a load, both pushed from outside."""
    model = Model("geared")
    rotor = model.add("rotor", Inertia(J=0.01, **start))
    body = model.add("load", load)
    gear = model.add("gear", gear)
    drive = model.add("drive", TorqueSource())
    push = model.add("push", TorqueSource() if isinstance(load, Inertia) else ForceSource())
    model.connect(rotor.flange, gear.a, drive.flange)
    model.connect(body.flange, gear.b, push.flange)
    model.input("T", drive.torque)
    model.input("F", push.torque if isinstance(load, Inertia) else push.force)
    return model.build(energy=True)


def acceleration(system, T, F):
    k = system.index("output", "rotor.acceleration")
    return system.outputs_at(0.0, system.start, np.array([T, F]))[k]


@pytest.mark.parametrize(
    ("gear", "load", "n"),
    [
        (Gear(ratio=5.0), Inertia(J=2.0), 5.0),
        (Gear(ratio=-5.0), Inertia(J=2.0), -5.0),
        (Screw(lead=0.02), Mass(m=80.0), 2.0 * np.pi / 0.02),
    ],
)
def test_reflected_inertia(gear, load, n):
    system = geared(gear, load)
    inertia = 0.01 + (2.0 if isinstance(load, Inertia) else 80.0) / n**2
    assert len(system.states) == 4  # two of motion and two of energy: the transmission took two away
    assert acceleration(system, 0.3, 0.7) == pytest.approx((0.3 + 0.7 / n) / inertia, rel=1e-12)


@pytest.mark.parametrize("speed", [2.0, -2.0])
@pytest.mark.parametrize(("T", "F"), [(1.0, 0.0), (-1.0, 0.0), (0.0, 5.0), (0.0, -5.0), (1.0, -20.0)])
def test_lossy_gear_follows_the_power(T, F, speed):
    """Both directions of rotation and of power; the torque M on b solves a linear equation on each branch."""
    n, eta, J_a, J_b = 5.0, 0.8, 0.01, 2.0
    # v_s far below the speed, so that tanh is 1 to the last bit
    system = geared(Gear(ratio=n, efficiency=eta, v_s=1e-3), Inertia(J=J_b), speed=speed)
    solutions = []
    for factor, way in ((1.0 / eta, 1.0), (eta, -1.0)):
        # J_a·n·α = T − factor·M/n and J_b·α = M + F
        M = (T - J_a * n / J_b * F) / (J_a * n / J_b + factor / n)
        if M * speed * way > 0.0:
            solutions.append(n * (M + F) / J_b)
    assert len(solutions) == 1
    assert acceleration(system, T, F) == pytest.approx(solutions[0], rel=1e-10)


def test_efficiency_one_is_the_ideal_gear():
    lossy = geared(Gear(ratio=5.0, efficiency=1.0), Inertia(J=2.0), speed=1.0)
    assert acceleration(lossy, 1.0, 2.0) == pytest.approx(
        acceleration(geared(Gear(ratio=5.0), Inertia(J=2.0), speed=1.0), 1.0, 2.0), rel=1e-12
    )
    ideal = geared(Gear(ratio=5.0), Inertia(J=2.0))
    assert "implicit" not in ideal.texts["rhs"]  # the ideal gear needs no implicit equation


def test_an_ideal_gear_can_be_copied_with_losses():
    gear = Gear(ratio=5.0).copy(efficiency=0.9)
    assert gear.faults == []
    assert gear.options["lossy"] is True
    assert gear.copy(ratio=4.0).values == {"ratio": 4.0, "efficiency": 0.9, "v_s": 0.01}


def test_lossy_screw_lifts_and_lowers_with_its_efficiency():
    """At constant speed the power that leaves is efficiency times what enters, in both directions."""
    eta, lead, weight, speed = 0.6, 0.01, 400.0, 20.0
    for way in (1.0, -1.0):
        system = geared(Screw(lead=lead, efficiency=eta, v_s=1e-6), Mass(m=40.0), speed=way * speed)
        # lifting takes weight·lead/2π/η at the screw, lowering leaves weight·lead/2π·η
        balance = weight * lead / (2.0 * np.pi) * (1.0 / eta if way > 0.0 else eta)
        assert acceleration(system, balance, -weight) == pytest.approx(0.0, abs=1e-9)


def test_crank_moves_as_its_geometry_says():
    r, rod, speed = 0.1, 0.3, 4.0
    model = Model("crank")
    wheel = model.add("wheel", Inertia(J=0.5, speed=speed))
    crank = model.add("crank", Crank(radius=r, rod=rod))
    slider = model.add("slider", Mass(m=2.0))
    model.connect(wheel.flange, crank.a)
    model.connect(crank.b, slider.flange)
    system = model.build()
    run = system.simulate(3.0, rtol=1e-10, atol=1e-12)
    angle = run["wheel.angle"]
    np.testing.assert_allclose(
        run["slider.position"], r * np.cos(angle) + np.sqrt(rod**2 - (r * np.sin(angle)) ** 2), atol=1e-12
    )
    # nothing brakes it: the kinetic energy of both stays, although the speed of the wheel varies
    along = np.sqrt(rod**2 - (r * np.sin(angle)) ** 2)
    slope = -r * np.sin(angle) - r**2 * np.sin(angle) * np.cos(angle) / along
    kinetic = 0.5 * (0.5 + 2.0 * slope**2) * run["wheel.speed"] ** 2
    np.testing.assert_allclose(kinetic, kinetic[0], rtol=1e-8)
    assert np.ptp(run["wheel.speed"]) > 0.05
