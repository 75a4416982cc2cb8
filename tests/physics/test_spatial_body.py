"""One rigid body in space against closed forms: fall, free rotation, pendulum, locked motions."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from multibody import Frame, Model, Parameter
from multibody.declare.rigid_body import COORDINATES
from multibody.library.spatial import FixedFrame, FrameForce, FrameSpring, RigidBody, World

G = 9.80665
BLOCK = {
    "mass": 2.0,
    "com_x": 0.1,
    "com_y": -0.05,
    "com_z": 0.2,
    "I_xx": 0.3,
    "I_yy": 0.4,
    "I_zz": 0.5,
    "I_xy": 0.02,
    "I_xz": -0.03,
    "I_yz": 0.05,
}
TENSOR = np.array([[0.3, 0.02, -0.03], [0.02, 0.4, 0.05], [-0.03, 0.05, 0.5]])
COM = np.array([0.1, -0.05, 0.2])
TIGHT = {"rtol": 1e-11, "atol": 1e-13}


def alone(body: RigidBody, *more: tuple[str, object]) -> Model:
    model = Model("one body")
    model.add("body", body)
    for name, component in more:
        model.add(name, component)
    return model


def locked(*names: str) -> dict[str, bool]:
    return dict.fromkeys(names, False)


def attitude(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """R = Rz(yaw) Ry(pitch) Rx(roll), multiplied out numerically."""
    cx, sx, cy, sy, cz, sz = (f(a) for a in (roll, pitch, yaw) for f in (np.cos, np.sin))
    rx = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    ry = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    rz = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return rz @ ry @ rx


def test_state_order_is_that_of_the_papers_table():
    assert alone(RigidBody(**BLOCK)).build().state_names == tuple(
        f"body.{n}" for n in ("x", "y", "z", "roll", "pitch", "yaw", "v_x", "v_y", "v_z", "w_x", "w_y", "w_z")
    )


def test_free_fall_with_spin_moves_the_centre_of_mass_on_a_parabola():
    spin = {"w_x_start": 1.0, "w_y_start": -2.0, "w_z_start": 0.5, "v_x_start": 0.3, "v_z_start": 2.0}
    system = alone(RigidBody(**BLOCK, **spin)).build()
    run = system.simulate(1.0, times=np.linspace(0, 1, 5), **TIGHT)
    place = np.array(
        [
            [run[f"body.{a}"][k] for a in "xyz"] + attitude(*(run[f"body.{a}"][k] for a in COORDINATES[3:])) @ COM
            for k in range(5)
        ]
    )
    v0 = np.array([0.3, 0.0, 2.0]) + np.cross([1.0, -2.0, 0.5], COM)
    t = run.times[:, None]
    exact = COM + v0 * t + 0.5 * np.array([0.0, 0.0, -G]) * t**2
    # ten times the integrator's relative tolerance over a path of 5 m
    assert np.abs(place - exact).max() < 1e-9


def test_torque_free_rotation_keeps_energy_and_angular_momentum():
    model = alone(
        RigidBody(**BLOCK | {"com_x": 0.0, "com_y": 0.0, "com_z": 0.0}, w_x_start=0.02, w_y_start=3.0, w_z_start=0.1),
        ("world", World(gravity_z=0.0)),
    )
    run = model.build().simulate(4.0, **TIGHT)
    energy = run["energy.stored"]
    w = np.stack([run[f"body.w_{a}"] for a in "xyz"], axis=1)
    angles = [run[f"body.{a}"] for a in COORDINATES[3:]]
    momentum = np.array([attitude(*a) @ TENSOR @ w_k for *a, w_k in zip(*angles, w, strict=True)])
    assert np.ptp(w[:, 0]) > 1.0  # the intermediate axis is unstable: the body does tumble
    assert np.ptp(energy) < 1e-8 * energy[0]
    assert np.abs(momentum - momentum[0]).max() < 1e-8 * np.linalg.norm(momentum[0])


def test_euler_equations_term_by_term():
    """v̇ and ω̇ of the full body against Eqs. 1 and 2 solved numerically, forces at the origin."""
    model = alone(RigidBody(**BLOCK), ("push", FrameForce()))
    model.connect("push.frame", "body.origin")
    for k, name in enumerate(("force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z")):
        model.input(name, f"push.{name}", default=1.0 + k)
    system = model.build(compiled=False)
    rng = np.random.default_rng(4)
    x = rng.normal(size=12) * 0.7
    rates = system.rhs(0.0, x)
    rotation, w, m = attitude(*x[3:6]), x[9:12], 2.0
    force, moment = np.array([1.0, 2.0, 3.0 - m * G]), np.array([4.0, 5.0, 6.0])
    arm = rotation @ COM
    moment = moment + np.cross(arm, [0.0, 0.0, -m * G])
    skew = np.array([[0, -arm[2], arm[1]], [arm[2], 0, -arm[0]], [-arm[1], arm[0], 0]])
    inertia, w_world = rotation @ TENSOR @ rotation.T, rotation @ w
    # unknowns: acceleration of the origin and angular acceleration, world axes
    left = np.block([[m * np.eye(3), -m * skew], [m * skew, inertia - m * skew @ skew]])
    swing = np.cross(w_world, np.cross(w_world, arm))
    right = np.concatenate(
        [force - m * swing, moment - np.cross(w_world, inertia @ w_world) - m * np.cross(arm, swing)]
    )
    solved = np.linalg.solve(left, right)
    np.testing.assert_allclose(rates[6:9], solved[:3], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(rates[9:12], rotation.T @ solved[3:], rtol=1e-12, atol=1e-12)
    # angle rates against a difference of the rotation matrix along the motion
    h = 1e-6
    ahead, behind = (attitude(*(x[3:6] + s * h * rates[3:6])) for s in (1, -1))
    turned = rotation.T @ (ahead - behind) / (2 * h)
    np.testing.assert_allclose([turned[2, 1], turned[0, 2], turned[1, 0]], w, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_physical_pendulum_has_the_exact_period(axis):
    """θ'' = −(m g c / I_O) sin θ: quarter period K(sin²(θ0/2)) / ω0, motion by elliptic functions."""
    start, c = 2.0, 0.4
    model = alone(
        RigidBody(
            mass=1.7,
            com_z=-c,
            I_xx=0.08,
            I_yy=0.08,
            I_zz=0.01,
            **{f"{axis}_start": start},
            **locked(*(n for n in COORDINATES if n != axis)),
        )
    )
    w0, k2 = np.sqrt(1.7 * G * c / (0.08 + 1.7 * c**2)), np.sin(start / 2) ** 2
    period = 4 * ellipk(k2) / w0
    run = model.build().simulate(period, times=np.linspace(0, period, 9), **TIGHT)
    sn = ellipj(ellipk(k2) - w0 * run.times, k2)[0]
    exact = 2 * np.arcsin(np.sqrt(k2) * sn)
    assert np.abs(run[f"body.{axis}"] - exact).max() < 1e-9  # integrator tolerance times a hundred, over one period
    assert run[f"body.{axis}"][-1] == pytest.approx(start, abs=1e-9)


def test_vertical_motion_alone_is_one_division():
    system = alone(RigidBody(mass=3.0, **locked("x", "y", "roll", "pitch", "yaw"))).build()
    assert system.state_names == ("body.z", "body.v_z")
    text = system.texts["rhs"]
    assert "sin" not in text
    assert "com" not in text.replace("# ", "")
    assert system.rhs(0.0, np.zeros(2))[1] == pytest.approx(-G, rel=1e-15)


@pytest.mark.parametrize(
    "free", list(itertools.product((True, False), repeat=6)), ids=lambda f: "".join("01"[v] for v in f)
)
def test_every_subset_is_the_projection_of_the_full_body(free):
    """Each of the 64 subsets obeys d'Alembert with the full body's energy, written independently."""
    rng = np.random.default_rng(sum(v << k for k, v in enumerate(free)))
    at = rng.uniform(-0.8, 0.8, size=6)
    options = dict(zip(COORDINATES, free, strict=True))
    body = RigidBody(**BLOCK, **options, **{f"{n}_start": v for n, v in zip(COORDINATES, at, strict=True)})
    model = alone(
        body,
        (
            "anchor",
            FrameSpring(
                stiffness_x=40.0,
                stiffness_y=60.0,
                stiffness_z=500.0,
                stiffness_roll=3.0,
                stiffness_pitch=4.0,
                stiffness_yaw=5.0,
            ),
        ),
    )
    model.connect("anchor.a", model.ground)
    model.connect("anchor.b", "body.origin")
    system = model.build(compiled=False, outputs=["energy.stored"])
    count = sum(free)
    assert len(system.states) == 2 * count
    if not count:
        return
    x = system.start.copy()
    x[count:] = rng.normal(size=count)
    rates = system.rhs(0.0, x)

    def place(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return q[:3] + attitude(*q[3:]) @ COM, attitude(*q[3:])

    def energy(q: np.ndarray) -> float:
        k = np.array([40.0, 60.0, 500.0, 3.0, 4.0, 5.0])
        return float(2.0 * G * place(q)[0][2] + 0.5 * k @ q**2)

    def speeds(q: np.ndarray, dq: np.ndarray, h: float = 1e-5) -> np.ndarray:
        (p1, r1), (p0, r0) = place(q + h * dq), place(q - h * dq)
        spin = attitude(*q[3:]).T @ (r1 - r0) / (2 * h)
        return np.concatenate([(p1 - p0) / (2 * h), [spin[2, 1], spin[0, 2], spin[1, 0]]])

    index = [k for k in range(6) if free[k]]
    columns = np.zeros((6, count))
    for c, k in enumerate(index):
        columns[k, c] = 1.0
    dq = np.zeros(6)
    dq[index] = rates[:count]
    ddq = np.zeros(6)
    h = 1e-5
    ahead = system.rhs(0.0, x + h * rates)[:count]
    behind = system.rhs(0.0, x - h * rates)[:count]
    ddq[index] = (ahead - behind) / (2 * h)
    jacobian = np.stack([speeds(at, columns[:, c]) for c in range(count)], axis=1)
    step = 1e-4  # speeds on the path q + t·dq + t²/2·ddq, half a step ahead and behind
    change = (
        speeds(at + step * dq + 0.5 * step**2 * ddq, dq + step * ddq)
        - speeds(at - step * dq + 0.5 * step**2 * ddq, dq - step * ddq)
    ) / (2 * step)
    w = speeds(at, dq)[3:]
    needed = jacobian[:3].T @ (2.0 * change[:3]) + jacobian[3:].T @ (TENSOR @ change[3:] + np.cross(w, TENSOR @ w))
    slope = np.array(
        [(energy(at + h * columns[:, c]) - energy(at - h * columns[:, c])) / (2 * h) for c in range(count)]
    )
    run = system.simulate(
        0.03,
        initial=dict(zip(system.state_names, x, strict=True)),
        method="RK45",
        step=0.03,
        rtol=1e-9,
        atol=1e-11,
    )
    assert np.ptp(run["energy.stored"]) < 1e-7 * np.abs(run["energy.stored"]).max()
    # d'Alembert: differences of second order with steps of 1e-4 leave about 1e-7 of forces of order 1e2
    np.testing.assert_allclose(needed, -slope, atol=2e-5 * max(1.0, np.abs(slope).max()))


@pytest.mark.parametrize(
    "free", [("x", "pitch"), ("z", "roll", "yaw"), ("x", "y", "z", "roll", "pitch", "yaw"), ("pitch", "yaw")]
)
def test_energy_is_conserved_whatever_is_free(free):
    starts = {"v_x_start": 0.4} if "x" in free else {}
    starts |= {"pitch_start": 0.5} if "pitch" in free else {"roll_start": 0.5}
    starts |= {"yaw_rate_start": 2.0} if "yaw" in free and len(free) < 6 else {}
    starts |= {"w_z_start": 2.0, "w_x_start": 1.0} if len(free) == 6 else {}
    model = alone(
        RigidBody(**BLOCK, **starts, **locked(*(n for n in COORDINATES if n not in free))),
        (
            "anchor",
            FrameSpring(
                stiffness_x=40.0,
                stiffness_y=60.0,
                stiffness_z=500.0,
                stiffness_roll=30.0,
                stiffness_pitch=40.0,
                stiffness_yaw=50.0,
            ),
        ),
    )
    model.connect("anchor.a", model.ground)
    model.connect("anchor.b", "body.com")
    run = model.build().simulate(2.0, **TIGHT)
    energy = run["energy.stored"]
    assert np.ptp(run["body.kinetic_energy"]) > 0.1
    assert np.ptp(energy) < 1e-8 * max(1.0, np.abs(energy).max())


def test_locked_motions_are_the_limit_of_stiff_springs():
    """Slow motion of a body held by stiff springs tends to that of the body with these motions locked."""
    held = ("x", "y", "roll", "yaw")
    spring = {
        "stiffness_x": 1e7,
        "stiffness_y": 1e7,
        "stiffness_roll": 1e6,
        "stiffness_yaw": 1e6,
        "damping_x": 1e3,
        "damping_y": 1e3,
        "damping_roll": 300.0,
        "damping_yaw": 300.0,
    }
    runs = []
    for options in (locked(*held), {}):
        model = alone(
            RigidBody(**BLOCK, **options, pitch_start=0.3),
            ("anchor", FrameSpring(**spring, stiffness_z=800.0, stiffness_pitch=6.0)),
        )
        model.connect("anchor.a", model.ground)
        model.connect("anchor.b", "body.origin")
        runs.append(model.build().simulate(1.0, method="auto", rtol=1e-8, atol=1e-10))
    # the springs give way by force/stiffness = 20 N / 1e7 N/m; pitch couples to them in the same proportion
    assert np.abs(runs[0]["body.pitch"] - runs[1]["body.pitch"]).max() < 2e-5
    assert np.abs(runs[0]["body.z"] - runs[1]["body.z"]).max() < 2e-5


class Car(RigidBody):
    hitch = Frame("rope hitch", offset=(0.0, 0.0, 0.6))
    low_left = Frame("shoe", offset=("-gauge", None, 0.05))
    low_right = Frame("shoe", offset=("gauge", None, 0.05))
    gauge = Parameter(0.25, "m", "half the distance of the shoes")


def test_symmetric_load_moves_nothing_sideways():
    model = alone(
        Car(mass=30.0, com_z=0.3, I_xx=1.5, I_yy=1.3, I_zz=0.9),
        *(
            (f"shoe_{s}", FrameSpring(stiffness_x=1e4, stiffness_y=1e4, stiffness_z=100.0, turns=False))
            for s in ("left", "right")
        ),
        ("rope", FrameForce()),
    )
    for side, x in (("left", -0.25), ("right", 0.25)):
        model.add(f"rail_{side}", FixedFrame(x=x, z=0.05))
        model.connect(f"rail_{side}.frame", f"shoe_{side}.a")
        model.connect(f"shoe_{side}.b", f"body.low_{side}")
    model.connect("rope.frame", "body.hitch")
    model.input("tension", "rope.force_z")
    run = model.build().simulate(1.0, inputs={"tension": 350.0}, rtol=1e-9)
    assert run["body.z"][-1] > 0.5
    for name in ("x", "y", "roll", "pitch", "yaw"):
        assert np.abs(run[f"body.{name}"]).max() < 1e-12  # rounding only: nothing in the equations drives it


def test_jacobian_against_differences():
    model = alone(
        RigidBody(**BLOCK),
        (
            "anchor",
            FrameSpring(
                stiffness_x=40.0,
                stiffness_y=60.0,
                stiffness_z=50.0,
                stiffness_roll=3.0,
                stiffness_pitch=4.0,
                stiffness_yaw=5.0,
                damping_x=1.0,
                damping_y=2.0,
                damping_z=3.0,
                damping_roll=0.1,
                damping_pitch=0.2,
                damping_yaw=0.3,
            ),
        ),
    )
    model.connect("anchor.a", model.ground)
    model.connect("anchor.b", "body.com")
    system = model.build(compiled=False)
    x, h = np.random.default_rng(7).normal(size=12) * 0.4, 1e-6
    exact = system.jacobian("x", 0.0, x)
    for k in range(12):
        step = np.zeros(12)
        step[k] = h
        slope = (system.rhs(0.0, x + step) - system.rhs(0.0, x - step)) / (2 * h)
        # second differences of forces of order 1e2 at h = 1e-6: rounding 1e-8 relative
        np.testing.assert_allclose(exact[:, k], slope, atol=1e-5 * (1 + np.abs(slope).max()))
