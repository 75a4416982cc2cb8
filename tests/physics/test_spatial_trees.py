"""Trees of bodies against equations written by hand: arms, cart and pole, rotors, gears, friction."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from multibody import Frame, Model
from multibody.library import (
    Crank,
    Damper,
    Gear,
    Inertia,
    PositionSource,
    RotaryViscousFriction,
    Spring,
    TorqueSource,
)
from multibody.library.spatial import FrameSensor, Link, RigidBody, World

G = 9.80665
ONLY = {
    name: {n: n == name for n in ("x", "y", "z", "roll", "pitch", "yaw")}
    for name in ("x", "y", "z", "roll", "pitch", "yaw")
}
TIGHT = {"rtol": 1e-11, "atol": 1e-13}
UPPER = {"mass": 1.5, "com_z": -0.3, "tip_z": -0.7, "I_xx": 0.02, "I_yy": 0.03, "I_zz": 0.015}
FORE = {"mass": 0.9, "com_z": -0.25, "I_xx": 0.012, "I_yy": 0.01, "I_zz": 0.005}


def two_link_arm(**starts: float) -> Model:
    model = Model("two-link arm")
    upper = model.add("upper", Link(**UPPER, **ONLY["pitch"], pitch_start=starts.get("upper", 0.0)))
    fore = model.add("fore", Link(**FORE, **ONLY["pitch"], pitch_start=starts.get("fore", 0.0)))
    model.connect(fore.parent, upper.tip)
    return model


def test_double_pendulum():
    """Absolute angles a, b: the equations of any textbook, with moments of inertia of the links."""
    length, c1, c2, m1, m2 = 0.7, 0.3, 0.25, 1.5, 0.9

    def rates(t: float, y: np.ndarray) -> list[float]:
        a, b, da, db = y
        s = m2 * length * c2
        matrix = np.array(
            [[0.03 + m1 * c1**2 + m2 * length**2, s * np.cos(a - b)], [s * np.cos(a - b), 0.01 + m2 * c2**2]]
        )
        right = [
            -s * np.sin(a - b) * db**2 - (m1 * c1 + m2 * length) * G * np.sin(a),
            s * np.sin(a - b) * da**2 - m2 * c2 * G * np.sin(b),
        ]
        return [da, db, *np.linalg.solve(matrix, right)]

    run = two_link_arm(upper=1.4, fore=0.6).build().simulate(2.0, **TIGHT)
    exact = solve_ivp(rates, (0, 2), [1.4, 2.0, 0, 0], method="DOP853", t_eval=run.times, rtol=1e-12, atol=1e-13).y
    # two integrators at 1e-11, their errors grown by the pendulum's sensitivity (about e^5 in 2 s)
    np.testing.assert_allclose(run["upper.pitch"], exact[0], atol=1e-7)
    np.testing.assert_allclose(run["upper.pitch"] + run["fore.pitch"], exact[1], atol=1e-7)
    energy = run["energy.stored"]
    assert np.ptp(energy) < 1e-8 * np.ptp(run["upper.potential_energy"])


def cart_pole(**cart: object) -> Model:
    model = Model("cart and pole")
    model.add("cart", RigidBody(mass=2.0, **ONLY["x"], **cart))
    model.add(
        "pole",
        RigidBody(mass=0.5, com_z=-0.4, I_yy=0.03, I_xx=0.03, I_zz=0.002, **ONLY["pitch"], pitch_start=2.5),
    )
    model.connect("pole.parent", "cart.origin")
    return model


def test_cart_and_pole():
    """(M+m) x'' = m c (q'' cos q − q'² sin q); (I + m c²) q'' = m c x'' cos q − m g c sin q."""

    def rates(t: float, y: np.ndarray) -> list[float]:
        _, q, v, w = y
        mc = 0.5 * 0.4
        matrix = np.array([[2.5, -mc * np.cos(q)], [-mc * np.cos(q), 0.03 + mc * 0.4]])
        return [v, w, *np.linalg.solve(matrix, [-mc * np.sin(q) * w**2, -mc * G * np.sin(q)])]

    run = cart_pole().build().simulate(2.0, **TIGHT)
    exact = solve_ivp(rates, (0, 2), [0, 2.5, 0, 0], method="DOP853", t_eval=run.times, rtol=1e-12, atol=1e-13).y
    np.testing.assert_allclose(run["cart.x"], exact[0], atol=1e-8)
    np.testing.assert_allclose(run["pole.pitch"], exact[1], atol=1e-8)
    assert np.ptp(run["energy.stored"]) < 1e-8 * np.ptp(run["pole.potential_energy"])


def test_driven_cart_tells_the_force_that_the_drive_needs():
    model = cart_pole()
    model.add("drive", PositionSource())
    model.connect("drive.flange", "cart.x_axis")
    for name in ("position", "velocity", "acceleration"):
        model.input(name, f"drive.{name}", default=0.0)
    model.output("force", "drive.flange.reaction")
    system = model.build(compiled=False)
    assert system.state_names == ("pole.pitch", "pole.pitch_rate")
    q, w, a = 0.8, 1.3, 0.7
    u = system.u.copy()
    u[system.index("input", "acceleration")] = a
    rates = system.rhs(0.0, np.array([q, w]), u)
    mc = 0.5 * 0.4
    turned = (mc * a * np.cos(q) - mc * G * np.sin(q)) / (0.03 + mc * 0.4)
    assert rates[1] == pytest.approx(turned, rel=1e-13)
    force = system.outputs_at(0.0, np.array([q, w]), u)[system.index("output", "force")]
    assert force == pytest.approx(2.5 * a - mc * (turned * np.cos(q) - w**2 * np.sin(q)), rel=1e-13)


def test_floating_chain_keeps_momentum():
    """Three bodies, floating, with a universal, a spherical and a sliding joint, without gravity."""

    class Hub(RigidBody):
        arm = Frame("shoulder", offset=(0.3, 0.1, -0.2), angles=(0.3, -0.4, 0.9))
        side = Frame("rail", offset=(-0.2, 0.0, 0.1), angles=(None, 0.5, None))

    def sized(mass: float, k: float) -> dict[str, float]:
        return {
            "mass": mass,
            "com_x": 0.1 * k,
            "com_y": 0.05,
            "com_z": -0.2,
            "I_xx": 0.3 * k,
            "I_yy": 0.25 * k,
            "I_zz": 0.4 * k,
            "I_xy": 0.05 * k,
            "I_yz": -0.06 * k,
        }

    model = Model("floating chain")
    model.add("world", World(gravity_z=0.0))
    model.add("hub", Hub(**sized(3.0, 1.0), w_x_start=0.5, w_y_start=1.0, w_z_start=-0.7, v_x_start=0.2))
    model.add(
        "arm",
        Link(
            **sized(1.0, 0.4),
            tip_x=0.4,
            tip_z=0.1,
            x=False,
            y=False,
            z=False,
            roll=False,
            pitch_rate_start=2.0,
            yaw_rate_start=-1.0,
            yaw_start=0.4,
        ),
    )
    model.add("hand", RigidBody(**sized(0.5, 0.2), x=False, y=False, z=False, w_x_start=1.0, w_z_start=2.0))
    model.add("slider", RigidBody(**sized(0.8, 0.3), **ONLY["z"], v_z_start=0.6))
    model.connect("arm.parent", "hub.arm")
    model.connect("hand.parent", "arm.tip")
    model.connect("slider.parent", "hub.side")
    names = ("hub", "arm", "hand", "slider")
    for n in names:
        model.add(f"see_{n}", FrameSensor())
        model.connect(f"see_{n}.frame", f"{n}.com")
    for n in names:
        for q in [f"r{i}{j}" for i in "123" for j in "123"]:
            model.output(f"{n}_{q}", f"{n}.com.{q}")
    run = model.build().simulate(1.5, times=np.linspace(0, 1.5, 16), **TIGHT)
    linear, angular = np.zeros((16, 3)), np.zeros((16, 3))
    for n in names:
        values = model.components[n].values
        inertia = np.array([[values[f"I_{''.join(sorted(a + b))}"] for b in "xyz"] for a in "xyz"])
        p, v, w = (np.stack([run[f"see_{n}.{s}{a}"] for a in "xyz"], 1) for s in ("", "v_", "w_"))
        rotation = np.array([[run[f"{n}_r{i}{j}"] for j in "123"] for i in "123"]).transpose(2, 0, 1)
        linear += values["mass"] * v
        angular += values["mass"] * np.cross(p, v) + np.einsum("tij,tj->ti", rotation, w @ inertia)
    assert np.ptp(run["slider.z"]) > 0.3
    assert np.abs(linear - linear[0]).max() < 1e-8 * np.abs(linear).max()
    assert np.abs(angular - angular[0]).max() < 1e-8 * np.abs(angular).max()
    assert np.ptp(run["energy.stored"]) < 1e-8 * run["energy.stored"][0]


def test_order_of_components_does_not_matter():
    model = Model("other order")
    model.add("fore", Link(**FORE, **ONLY["pitch"], pitch_start=0.6))
    model.add("upper", Link(**UPPER, **ONLY["pitch"], pitch_start=1.4))
    model.connect("fore.parent", "upper.tip")
    swapped, plain = model.build(compiled=False), two_link_arm(upper=1.4, fore=0.6).build(compiled=False)
    assert swapped.state_names[:2] == ("fore.pitch", "fore.pitch_rate")
    np.testing.assert_allclose(swapped.rhs(0, swapped.start)[[2, 3, 0, 1]], plain.rhs(0, plain.start), rtol=1e-12)


def test_unbalance_force_is_m_e_omega_squared():
    model = Model("rotor")
    model.add("world", World(gravity_z=0.0))
    shaft = {
        **ONLY["roll"],
        "mass": 5.0,
        "I_xx": 0.1,
        "I_yy": 0.1,
        "I_zz": 0.1,
        "reactions": True,
        "roll_rate_start": 100.0,
    }
    model.add("shaft", Link(**shaft, tip_x=0.2))
    model.add(
        "disk",
        RigidBody(
            mass=2.0,
            com_y=1e-3,
            I_xx=0.02,
            I_yy=0.01,
            I_zz=0.01,
            reactions=True,
            **dict.fromkeys(ONLY, False),
        ),
    )
    model.connect("disk.parent", "shaft.tip")
    run = model.build().simulate(0.1, **TIGHT)
    y, z = run["shaft.joint_force_y"], run["shaft.joint_force_z"]
    # bearings hold the disk on its circle: towards the axis, turning with the shaft
    np.testing.assert_allclose(np.hypot(y, z), 2.0 * 1e-3 * 100.0**2, rtol=1e-9)
    np.testing.assert_allclose(np.unwrap(np.arctan2(-z, -y)), 100.0 * run.times, atol=1e-7)
    # its lever to the bearing at the origin
    np.testing.assert_allclose(run["shaft.joint_moment_z"], 0.2 * y, atol=1e-8)


def test_flexible_rotor_bends_as_jeffcott_says():
    """Disk on springs that turn with the shaft: y = m e ω² / (k − m ω²) below the critical speed."""
    model = Model("Jeffcott rotor")
    model.add("world", World(gravity_z=0.0))
    model.add("shaft", Link(mass=1.0, I_xx=0.1, I_yy=0.1, I_zz=0.1, **ONLY["roll"], roll_rate_start=60.0))
    free = {**dict.fromkeys(ONLY, False), "y": True, "z": True}
    model.add("disk", RigidBody(mass=2.0, com_y=1e-4, I_xx=1e4, I_yy=1e4, I_zz=1e4, **free))
    model.connect("disk.parent", "shaft.tip")
    for axis in "yz":
        model.add(f"spring_{axis}", Spring(stiffness=2e4))
        model.add(f"damper_{axis}", Damper(damping=100.0))
        for part in (f"spring_{axis}", f"damper_{axis}"):
            model.connect(f"{part}.a", model.ground)
            model.connect(f"{part}.b", f"disk.{axis}_axis")
    run = model.build().simulate(2.5, rtol=1e-10, atol=1e-13)
    w = run["shaft.roll_rate"][-1]
    # damping turns with the shaft: forward whirl dies at c/2m·(1 − ω/ω_c) = 10/s, e^(-25) of it is left
    assert run["disk.y"][-1] == pytest.approx(2.0 * 1e-4 * w**2 / (2e4 - 2.0 * w**2), rel=1e-6)


def test_gear_between_two_shafts():
    model = Model("geared shafts")
    model.add("pinion", RigidBody(mass=1.0, I_xx=0.02, I_yy=0.015, I_zz=0.015, **ONLY["roll"]))
    model.add("wheel", RigidBody(mass=4.0, I_xx=0.3, I_yy=0.2, I_zz=0.2, **ONLY["roll"]))
    model.add("rotor", Inertia(J=0.005))
    model.add("motor", TorqueSource())
    model.add("mesh", Gear(ratio=3.0))
    model.connect("motor.flange", "rotor.flange", "pinion.roll_axis", "mesh.a")
    model.connect("mesh.b", "wheel.roll_axis")
    model.input("torque", "motor.torque", default=1.2)
    model.output("tooth", "mesh.b.reaction")
    system = model.build(compiled=False)
    assert len(system.states) == 2
    rate = system.rhs(0.0, system.start)[1]
    own, other = 0.02 + 0.005, 0.3
    first = "pinion" in system.state_names[0]
    combined = own + other / 9.0
    expected = 1.2 / combined if first else 1.2 / combined / 3.0
    assert abs(rate) == pytest.approx(expected, rel=1e-12)
    # the gear turns the wheel: its torque there is all that the wheel's inertia asks for
    tooth = system.outputs_at(0.0, system.start)[system.index("output", "tooth")]
    assert abs(tooth) == pytest.approx(0.3 * 1.2 / combined / 3.0, rel=1e-12)


def test_friction_in_a_joint_and_places_for_effects():
    model = two_link_arm(upper=1.0, fore=0.5)
    model.add("bearing", RotaryViscousFriction(viscous=0.2))
    model.connect("bearing.a", model.ground)
    model.connect("bearing.b", "fore.pitch_axis")
    system = model.build(probes=True, energy=True)
    names = {n for p in system.places for n in (p.name, *p.also)}
    assert {"upper.pitch", "fore.pitch", "bearing"} <= names
    run = system.simulate(2.0, inputs={n: 0.0 for n in system.input_names}, **TIGHT)
    stored, lost = run["energy.stored"], run["energy.lost"]
    assert lost[-1] > 0.5
    assert np.abs(stored + lost - stored[0]).max() < 1e-8 * lost[-1]


def test_probe_on_an_axis_is_a_force_between_parent_and_child():
    system = two_link_arm(upper=0.3, fore=0.2).build(probes=True, compiled=False)
    u = system.u.copy()
    u[system.index("input", "probe.fore.pitch")] = 2.0
    pushed = system.rhs(0.0, system.start, u) - system.rhs(0.0, system.start)
    upper, fore = 0.03 + 1.5 * 0.3**2, 0.01 + 0.9 * 0.25**2
    s = 0.9 * 0.7 * 0.25 * np.cos(0.2)
    matrix = np.array([[upper + 0.9 * 0.7**2 + fore + 2 * s, fore + s], [fore + s, fore]])
    np.testing.assert_allclose(pushed[[1, 3]], np.linalg.solve(matrix, [0.0, 2.0]), rtol=1e-12)


def test_rigidly_attached_body_adds_its_inertia():
    """A payload with nothing free on a tip is the same as one body with the sum of masses and moments."""
    model = two_link_arm(upper=0.4, fore=0.9)
    model.add(
        "payload",
        RigidBody(mass=0.4, com_x=0.05, I_yy=0.002, I_xx=0.002, I_zz=0.002, **dict.fromkeys(ONLY, False)),
    )
    model.connect("payload.parent", "fore.tip")
    loaded = model.with_values({"fore.tip_z": -0.5}).build(compiled=False)
    total, com = 0.9 + 0.4, np.array([0.4 * 0.05, 0.9 * -0.25 + 0.4 * -0.5]) / 1.3
    inertia = (0.01 + 0.9 * np.sum((com - [0.0, -0.25]) ** 2)) + (0.002 + 0.4 * np.sum((com - [0.05, -0.5]) ** 2))
    single = (
        two_link_arm(upper=0.4, fore=0.9)
        .with_values(
            {
                "fore.mass": total,
                "fore.com_x": com[0],
                "fore.com_z": com[1],
                "fore.I_yy": inertia,
                "fore.I_xx": inertia,
                "fore.I_zz": 0.01,
            }
        )
        .build(compiled=False)
    )
    x = np.array([0.4, 1.0, 0.9, -2.0])
    np.testing.assert_allclose(loaded.rhs(0, x), single.rhs(0, x), rtol=1e-12)


def test_tree_jacobian_against_differences():
    system = two_link_arm().build(compiled=False)
    x, h = np.array([0.4, 1.0, 0.9, -2.0]), 1e-6
    exact = system.jacobian("x", 0.0, x)
    for k in range(4):
        step = np.zeros(4)
        step[k] = h
        slope = (system.rhs(0.0, x + step) - system.rhs(0.0, x - step)) / (2 * h)
        np.testing.assert_allclose(exact[:, k], slope, atol=1e-6)  # rounding 1e-15 · 100 / 1e-6, with room


def test_crank_drives_a_cart_that_carries_a_pole():
    """A joint that follows another through a nonlinear transmission: mass, velocity products and energy."""
    model = Model("crank, cart and pole")
    wheel = {"mass": 1.0, "I_xx": 0.05, "I_yy": 0.05, "I_zz": 0.05}
    model.add("wheel", RigidBody(**wheel, **ONLY["roll"], roll_start=0.5, roll_rate_start=8.0))
    model.add("cart", RigidBody(mass=0.4, **ONLY["x"]))
    model.add("pole", RigidBody(mass=0.3, com_z=-0.3, I_xx=0.01, I_yy=0.01, I_zz=0.01, **ONLY["pitch"]))
    model.connect("pole.parent", "cart.origin")
    model.add("crank", Crank(radius=0.1, rod=0.4))
    model.connect("crank.a", "wheel.roll_axis")
    model.connect("crank.b", "cart.x_axis")
    run = model.build().simulate(2.0, **TIGHT)
    assert run.system.state_names == ("wheel.roll", "wheel.roll_rate", "pole.pitch", "pole.pitch_rate")
    assert np.ptp(run["wheel.roll_rate"]) > 0.5
    assert np.ptp(run["energy.stored"]) < 1e-8 * run["energy.stored"][0]


def test_bodies_on_the_ground_do_not_touch_each_other_in_the_equations():
    model = Model("two bodies")
    for name in ("a", "b"):
        model.add(name, RigidBody(mass=2.0, com_x=0.1, I_xx=0.3, I_yy=0.4, I_zz=0.5))
    pattern = model.build(compiled=False).sparsity
    assert not pattern[:12, 12:].any()
    assert not pattern[12:, :12].any()
    assert pattern[6:12, 3:6].any()
