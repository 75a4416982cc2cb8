"""Forces between frames and sensors on frames: energy, momentum, statics, what an accelerometer feels."""

from __future__ import annotations

import numpy as np
import pytest

from multibody import Frame, Model
from multibody.library.spatial import (
    FixedFrame,
    FrameForce,
    FrameSensor,
    FrameSpring,
    LineForce,
    RigidBody,
    World,
)

G = 9.80665
TIGHT = {"rtol": 1e-11, "atol": 1e-13}
LOCKED = dict.fromkeys(("x", "y", "z", "roll", "pitch", "yaw"), False)
SOLID = {"mass": 2.0, "com_x": 0.05, "com_z": 0.1, "I_xx": 0.03, "I_yy": 0.04, "I_zz": 0.05}


class Block(RigidBody):
    corner = Frame("corner", offset=(0.2, -0.1, 0.15), angles=(0.2, None, -0.5))
    eye = Frame("eye", offset=(None, None, -0.3))


def world_momentum(run, names: tuple[str, ...], model: Model) -> tuple[np.ndarray, np.ndarray]:
    linear, angular = 0.0, 0.0
    for n in names:
        v = model.components[n].values
        p, s, w = (np.stack([run[f"see_{n}.{k}{a}"] for a in "xyz"], 1) for k in ("", "v_", "w_"))
        rotation = np.array([[run[f"{n}_r{i}{j}"] for j in "123"] for i in "123"]).transpose(2, 0, 1)
        spin = w * [v["I_xx"], v["I_yy"], v["I_zz"]]
        linear = linear + v["mass"] * s
        angular = angular + v["mass"] * np.cross(p, s) + np.einsum("tij,tj->ti", rotation, spin)
    return linear, angular


def two_blocks(element) -> Model:
    model = Model("two blocks")
    model.add("world", World(gravity_z=0.0))
    model.add("left", Block(**SOLID, w_x_start=0.5, v_y_start=0.2))
    model.add("right", Block(**SOLID, x_start=0.5, y_start=0.1, roll_start=0.3, w_z_start=-0.8))
    model.add("joint", element)
    model.connect("joint.a", "left.corner")
    model.connect("joint.b", "right.eye")
    for n in ("left", "right"):
        model.add(f"see_{n}", FrameSensor())
        model.connect(f"see_{n}.frame", f"{n}.com")
        for q in [f"r{i}{j}" for i in "123" for j in "123"]:
            model.output(f"{n}_{q}", f"{n}.com.{q}")
    return model


@pytest.mark.parametrize(
    "element",
    [
        FrameSpring(
            stiffness_x=30.0,
            stiffness_y=50.0,
            stiffness_z=70.0,
            stiffness_roll=4.0,
            stiffness_pitch=5.0,
            stiffness_yaw=6.0,
            damping_x=1.0,
            damping_y=0.5,
            damping_z=2.0,
            damping_roll=0.1,
            damping_pitch=0.3,
            damping_yaw=0.2,
        ),
        FrameSpring(stiffness_x=30.0, stiffness_y=50.0, stiffness_z=70.0, damping_y=3.0, turns=False),
        LineForce(stiffness=80.0, damping=1.5, length=0.2),
        LineForce(stiffness=80.0, damping=1.5, length=0.2, pushes=False),
    ],
    ids=["bushing", "bushing without turns", "strut", "rope"],
)
def test_inner_forces_keep_momentum_and_balance_energy(element):
    model = two_blocks(element)
    run = model.build(energy=True).simulate(1.0, times=np.linspace(0, 1, 21), **TIGHT)
    linear, angular = world_momentum(run, ("left", "right"), model)
    assert np.abs(linear - linear[0]).max() < 1e-8
    assert np.abs(angular - angular[0]).max() < 1e-8
    stored, lost = run["energy.stored"], run["energy.lost"]
    assert lost[-1] > 1e-3
    assert np.abs(stored + lost - stored[0]).max() < 1e-8 * stored[0]


def test_rope_hangs_goes_slack_and_never_pushes():
    model = Model("rope")
    model.add("load", RigidBody(mass=1.0, **{**LOCKED, "z": True}, z_start=-1.0, v_z_start=3.0))
    model.add("rope", LineForce(stiffness=500.0, damping=5.0, length=1.0, pushes=False))
    model.add("hook", FixedFrame(x=1e-3))
    model.connect("rope.a", "hook.frame")
    model.connect("rope.b", "load.origin")
    run = model.build().simulate(3.0, rtol=1e-9, atol=1e-11)
    assert run["rope.tension"].min() == 0.0
    slack = run["rope.tension"] == 0.0
    assert slack.sum() > 20
    np.testing.assert_allclose(run["load.a_z"][slack], -G, rtol=1e-12)
    settled = model.build().equilibrium(guess={"load.z": -1.01})
    assert settled["load.z"] == pytest.approx(-(1.0 + G / 500.0), rel=1e-5)


def test_bushing_carries_weight_and_moment_of_an_offset_load():
    model = Model("console")
    model.add("plate", RigidBody(mass=2.0, com_x=0.1, I_xx=0.01, I_yy=0.01, I_zz=0.02))
    model.add(
        "bushing",
        FrameSpring(
            stiffness_x=1e4,
            stiffness_y=1e4,
            stiffness_z=1e4,
            stiffness_roll=1e4,
            stiffness_pitch=1e4,
            stiffness_yaw=1e4,
        ),
    )
    model.connect("bushing.a", model.ground)
    model.connect("bushing.b", "plate.origin")
    rest = model.build(compiled=False).equilibrium()
    assert rest["plate.z"] == pytest.approx(-2.0 * G / 1e4, rel=1e-9)
    # weight at +x turns the plate to positive pitch; the lever shortens by cos(2e-4)
    assert rest["plate.pitch"] == pytest.approx(2.0 * G * 0.1 / 1e4, rel=1e-7)


def test_force_that_follows_the_frame_and_force_in_the_world():
    for follows, expected in ((False, [3.0, 0.0]), (True, [3.0 * np.cos(0.4), 3.0 * np.sin(0.4)])):
        model = Model("thruster")
        model.add("world", World(gravity_z=0.0))
        model.add(
            "body",
            RigidBody(mass=1.0, x=True, y=True, z=False, roll=False, pitch=False, yaw=False, yaw_start=0.4),
        )
        model.add("jet", FrameForce(follows=follows))
        model.connect("jet.frame", "body.origin")
        model.input("thrust", "jet.force_x", default=3.0)
        system = model.build(compiled=False)
        np.testing.assert_allclose(system.rhs(0.0, system.start)[2:], expected, rtol=1e-14, atol=1e-15)


def test_accelerometer_feels_tilt_at_rest():
    tilt = 0.1
    for remove, upright in ((False, 0.0), (True, G)):
        model = Model("tilted table")
        model.add("table", RigidBody(mass=1.0, **LOCKED, pitch_start=tilt))
        model.add("sensor", FrameSensor(remove_gravity=remove))
        model.connect("sensor.frame", "table.origin")
        system = model.build(compiled=False)
        y = dict(zip(system.output_names, system.outputs_at(0.0, system.start), strict=True))
        assert y["sensor.pitch"] == pytest.approx(tilt, rel=1e-12)
        assert y["sensor.felt_x"] == pytest.approx(-G * np.sin(tilt), rel=1e-12)
        assert y["sensor.felt_z"] == pytest.approx(G * np.cos(tilt) - upright, rel=1e-12)


def test_motion_at_a_frame_against_differences_of_its_position():
    model = Model("tumbling block")
    model.add("block", Block(**SOLID, w_x_start=1.0, w_y_start=2.0, w_z_start=-1.5, v_x_start=0.5, roll_start=0.3))
    model.add(
        "arm",
        Block(**SOLID, **{**LOCKED, "yaw": True, "roll": True}, yaw_rate_start=2.0, roll_rate_start=-1.0),
    )
    model.connect("arm.parent", "block.corner")
    model.add("sensor", FrameSensor())
    model.connect("sensor.frame", "arm.corner")
    h = 1e-3
    run = model.build().simulate(4 * h, times=h * np.arange(5), **TIGHT)
    for axis in "xyz":
        p = run[f"sensor.{axis}"]
        # fourth order: h⁴ · fifth derivative (about 1e2) = 1e-10; second differences divide rounding by h²
        assert run[f"sensor.v_{axis}"][2] == pytest.approx((p[0] - 8 * p[1] + 8 * p[3] - p[4]) / (12 * h), abs=1e-8)
        second = (-p[0] + 16 * p[1] - 30 * p[2] + 16 * p[3] - p[4]) / (12 * h**2)
        assert run[f"sensor.a_{axis}"][2] == pytest.approx(second, abs=1e-6)


def test_frame_turned_against_the_body_gives_the_axis_of_the_joint():
    """A hinge about x, made from a free yaw on a frame that is pitched by a quarter turn."""

    class Base(RigidBody):
        hinge = Frame("hinge", offset=(None, None, None), angles=(None, np.pi / 2, None))

    model = Model("hinge")
    model.add("base", Base(mass=1.0, **LOCKED))
    model.add(
        "door",
        RigidBody(mass=1.0, com_x=0.3, I_xx=0.1, I_yy=0.1, I_zz=0.2, **{**LOCKED, "yaw": True}, yaw_start=0.5),
    )
    model.connect("door.parent", "base.hinge")
    system = model.build(compiled=False)
    # the door's x axis points down at yaw 0, so this is a hanging pendulum
    assert system.rhs(0.0, system.start)[1] == pytest.approx(-G * 0.3 * np.sin(0.5) / (0.2 + 0.09), rel=1e-12)
