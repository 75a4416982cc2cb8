"""The lift's components against closed forms: a shoe pressed by hand, ropes, pulley, support, motor, control."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from multibody import Model
from multibody.library.spatial import RigidBody
from vtsdt.files.parameters import LiftParameters
from vtsdt.lift.lift import Lift
from vtsdt.parts.car import Car
from vtsdt.parts.guide import GuidingSystem, face, face_power, shoe, shoe_power
from vtsdt.parts.machine import mount
from vtsdt.parts.rope import rope

G = 9.80665
BENCH = LiftParameters.bench()


def test_a_shoe_pressed_by_hand_gives_the_spring_force_of_eq_3_and_the_friction_of_eq_4():
    K, L_g, mu, depth = 1.0e4, 0.5e-3, 0.2, 0.8e-3
    f_x, f_y, f_z, normal = shoe(1.0, depth + L_g, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, K, 50.0, L_g, 5e-5, mu, 0.01)
    assert f_x == pytest.approx(-K * depth, rel=1e-12)
    assert f_y == 0.0
    assert normal == pytest.approx(K * depth, rel=1e-12)
    assert f_z == pytest.approx(-mu * K * depth, rel=1e-12)  # tanh(100) is 1 to rounding


def test_a_rail_that_comes_nearer_by_its_deviation_presses_as_a_shoe_that_goes_to_it():
    arguments = (0.0, 0.0, 0.0, 0.0, 0.3)
    contact = (1e4, 0.0, 0.5e-3, 5e-5, 0.1, 0.01)
    for way in (-1.0, 1.0):
        by_rail = shoe(way, *arguments, 1.2e-3, 0.0, 0.0, 0.0, *contact)
        by_body = shoe(way, way * 1.2e-3, *arguments[1:], 0.0, 0.0, 0.0, 0.0, *contact)
        assert by_rail == pytest.approx(by_body, rel=1e-12)
        assert by_rail[0] == pytest.approx(-way * 1e4 * 0.7e-3, rel=1e-12)


def test_within_its_clearance_a_shoe_feels_nothing():
    assert shoe(1.0, 0.4e-3, -0.4e-3, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1e4, 50.0, 0.5e-3, 5e-5, 0.2, 0.01) == (
        0.0,
        0.0,
        0.0,
        0.0,
    )


@pytest.mark.parametrize("rate", [-5.0, -0.05, 0.05, 5.0])
def test_a_flange_never_pulls_and_closes_without_a_jump(rate):
    depths = np.linspace(-1e-4, 1e-3, 20001)
    forces = np.array([face(d, rate, 1e4, 120.0, 5e-5) for d in depths])
    assert forces.min() == 0.0
    assert forces[depths <= 0.0].max() == 0.0
    # continuous: between neighbours no more than the steepest slope, K + 1.5 C |rate| / ramp
    assert np.abs(np.diff(forces)).max() <= (1e4 + 1.5 * 120.0 * abs(rate) / 5e-5) * np.diff(depths)[0] * 1.001


def test_power_of_a_contact_is_stored_lost_or_done_by_the_rail():
    rng = np.random.default_rng(3)
    for _ in range(200):
        way = float(rng.choice([-1.0, 1.0]))
        x, y, d_x, d_y = rng.normal(0.0, 1e-3, 4)
        v_x, v_y, v_z, s_x, s_y = rng.normal(0.0, 0.05, 5)
        contact = (1e4, 120.0, 0.5e-3, 5e-5)
        f_x, f_y, _, _ = shoe(way, x, y, v_x, v_y, v_z, d_x, s_x, d_y, s_y, *contact, 0.0, 0.01)
        at = (d_x, s_x, d_y, s_y, *contact, f_x, f_y)
        _, heat, work = shoe_power(way, x, y, v_x, v_y, v_z, *at)
        step = 1e-8
        moved = [
            (way, x + w * v_x, y + w * v_y, v_x, v_y, v_z, d_x + w * s_x * v_z, s_x, d_y + w * s_y * v_z)
            for w in (-step, step)
        ]
        stored = [shoe_power(*place, *at[3:])[0] for place in moved]
        rate = (stored[1] - stored[0]) / (2 * step)
        # central differences of an energy of 1e-2 J over 2e-8 s: rounding leaves 1e-10 W, its bend less
        assert -(f_x * v_x + f_y * v_y) + work == pytest.approx(rate + heat, abs=1e-8)


def test_heat_of_a_flange_is_not_negative():
    for rate in np.linspace(-20.0, 20.0, 81):
        for depth in (1e-6, 2e-5, 1e-4):
            assert face_power(depth, rate, 1e4, 120.0, 5e-5)[1] >= 0.0


def test_friction_goes_as_tanh_and_against_the_travel():
    for v in (-0.4, -0.005, 0.005, 0.4):
        f = shoe(1.0, 2e-3, 0.0, 0.0, 0.0, v, 0.0, 0.0, 0.0, 0.0, 1e4, 0.0, 1e-3, 5e-5, 0.3, 0.01)
        assert f[2] == pytest.approx(-0.3 * 10.0 * math.tanh(v / 0.01), rel=1e-12)


def test_rope_tension_is_ea_over_l_times_stretch_along_the_straight_line():
    fx, fy, fz, tension, energy, heat = rope(0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.4, 0.0, 0.499, 0.0, 1e5, 10.0)
    assert tension == pytest.approx(1e5 / 0.499 * 0.001, rel=1e-9)
    assert (fx, fy, fz) == pytest.approx((-0.6 * tension, 0.0, 0.8 * tension), rel=1e-12)
    assert energy == pytest.approx(0.5 * 1e5 / 0.499 * 0.001**2, rel=1e-9)
    assert heat == 0.0


def test_a_slack_rope_does_not_push_and_damping_does_not_make_it_push():
    assert rope(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.01, 0.0, 1e5, 10.0)[3] == 0.0
    assert rope(0.0, 0.0, 0.0, 0.0, 0.0, 50.0, 1.0, 0.0, 0.999, 0.0, 1e5, 1e3)[3] == 0.0


def test_four_mounts_resist_tilt_with_four_k_times_distance_squared():
    k, a, b, tilt = 2.5e5, 0.16, 0.14, 1e-3
    moments = [mount(x, y, 0.0, 0.0, tilt, 0.0, 0.0, 0.0, k, 0.0)[2] for x in (-a, a) for y in (-b, b)]
    assert sum(moments) == pytest.approx(-4.0 * k * a * a * tilt, rel=1e-12)


def test_at_rest_support_ropes_and_motor_carry_what_statics_says():
    lift = Lift.one_dimensional()
    rest = lift.equilibrium()
    p = BENCH
    lengths = p.ropes.L_0_c + p.ropes.L_0_cw
    weight = (p.cabin.mass + p.counterweight.mass + p.support.mass + p.ropes.lambda_m * lengths) * G
    assert rest["support.plate_position"] == pytest.approx(-weight / (4 * p.support.stiffness), rel=1e-9)
    unbalanced = (p.cabin.mass - p.counterweight.mass + p.ropes.lambda_m * (p.ropes.L_0_c - p.ropes.L_0_cw)) * G
    torque = -p.pulley.R_p * unbalanced
    assert rest["machine.i_q"] == pytest.approx(torque / (p.motor.gear * p.motor.K_T), rel=1e-9)
    pull = (p.cabin.mass + p.counterweight.mass + p.ropes.lambda_m * lengths) * G
    tilt = (p.support.arm * pull - torque) / (4 * p.support.stiffness * p.support.mount_x**2)
    assert rest["support.tilt_B_angle"] == pytest.approx(tilt, rel=1e-9)
    stretch = p.cabin.mass * G * p.ropes.L_0_c / p.ropes.EA
    rim = rest["support.plate_position"] - p.support.arm * rest["support.tilt_B_angle"]
    assert rest["cabin.z"] == pytest.approx(rim - stretch, abs=1e-12)


def test_a_symmetric_lift_does_not_move_sideways():
    body = dataclasses.replace(BENCH.cabin, com=(0.0, 0.0, 0.3))
    other = dataclasses.replace(BENCH.counterweight, com=(0.0, 0.0, 0.25))
    lift = Lift.reference(dataclasses.replace(BENCH.straightened(), cabin=body, counterweight=other))
    run = lift.trip("up", until=3.0)
    for side in ("cabin", "counterweight"):
        for name in ("x", "y", "roll", "pitch", "yaw"):
            # symmetric forces: what remains is what Newton's method left in the state at rest (rates below 1e-9)
            assert np.abs(run[f"{side}.{name}"]).max() < 1e-9
    assert np.abs(run["Nsum_c"]).max() == 0.0


def test_a_payload_adds_its_weight_where_it_stands():
    load = (10.0, 0.05, 0.0, 0.1)
    rest = Lift.one_dimensional(payload=load).equilibrium()
    empty = Lift.one_dimensional().equilibrium()
    lost = BENCH.pulley.R_p * load[0] * G / (BENCH.motor.gear * BENCH.motor.K_T)
    assert empty["machine.i_q"] - rest["machine.i_q"] == pytest.approx(lost, rel=1e-6)


def test_one_shoe_body_on_rails_settles_at_weight_over_stiffness():
    model = Model("body pressed sideways")
    body = model.add(
        "body",
        Car(
            mass=5.0,
            I_xx=1.0,
            I_yy=1.0,
            I_zz=1.0,
            shoe_x=0.2,
            shoe_low=-0.1,
            shoe_high=0.1,
            z=False,
            roll=False,
            pitch=False,
            yaw=False,
        ),
    )
    guide = model.add(
        "guide", GuidingSystem(right_curved=False, stiffness=1e4, damping=200.0, clearance=1e-3, mu=0.1, half_gauge=0.2)
    )
    for place in ("left_low", "left_high", "right_low", "right_high"):
        model.connect(getattr(guide, place), getattr(body, place))
    from multibody.library.spatial import FrameForce

    hand = model.add("hand", FrameForce())
    model.connect(hand.frame, body.origin)
    model.input("push", hand.force_x)
    rest = model.build().equilibrium(inputs={"push": 30.0}, guess={"body.x": 1.1e-3})
    assert rest["body.x"] == pytest.approx(1e-3 + 30.0 / (2 * 1e4), rel=1e-9)  # two shoes on the right rail


def test_accelerometer_on_a_tilted_floor_feels_the_cosine():
    from vtsdt.parts.car import Accelerometer

    model = Model("tilted")
    body = model.add(
        "body",
        Car(
            mass=1.0,
            shoe_x=0.2,
            shoe_low=0.0,
            shoe_high=0.5,
            accelerometer_pitch=0.02,
            **dict.fromkeys(("x", "y", "z", "roll", "pitch", "yaw"), False),
        ),
    )
    sensor = model.add("sensor", Accelerometer(offset=0.1))
    model.connect(sensor.frame, body.accelerometer)
    model.add("mass", RigidBody(mass=1.0, x=False, y=False, roll=False, pitch=False, yaw=False))
    system = model.build()
    y = system.outputs_at(0.0, system.start)
    assert y[system.index("output", "sensor.reading")] == pytest.approx(G * (math.cos(0.02) - 1.0) + 0.1, rel=1e-9)
