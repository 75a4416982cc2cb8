"""Trees of bodies against MuJoCo, built from the same parameters: accelerations, trajectories, energy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation as Turn

from multibody import Frame, Model
from multibody.library.spatial import Link, RigidBody

mujoco = pytest.importorskip("mujoco", reason="needs MuJoCo: pip install -e '.[peers]'")

LENGTHS, ANGLES = ("x", "y", "z"), ("roll", "pitch", "yaw")
AXES = dict(zip((*LENGTHS, *ANGLES), ("1 0 0", "0 1 0", "0 0 1") * 2, strict=True))
LOCKED = dict.fromkeys((*LENGTHS, *ANGLES), False)


class Hub(RigidBody):
    shoulder = Frame("shoulder", offset=(0.3, 0.1, -0.2), angles=(0.3, -0.4, 0.9))
    rail = Frame("rail", offset=(-0.2, None, 0.1), angles=(None, 0.5, None))


def peer(model: Model) -> tuple[object, list[str]]:
    """Return MuJoCo's model of the same machine, and our state names in the order of its coordinates."""
    components = {n: c for n, c in model.components.items() if isinstance(c, RigidBody)}
    hangs = {}
    for ends in model.connections:
        child = next(e for e in ends if e.endswith(".parent"))
        hangs[child.rpartition(".")[0]] = next(e for e in ends if e != child)
    order: list[str] = []

    def element(name: str) -> str:
        body = components[name]
        place, quat = "0 0 0", "1 0 0 0"
        if name in hangs:
            owner, _, port = hangs[name].rpartition(".")
            holder = components[owner]
            frame = holder.declarations[port]
            place = " ".join(repr(holder.values.get(p or "", 0.0)) for p in frame.offset_names)
            roll, pitch, yaw = (holder.values.get(p or "", 0.0) for p in frame.angle_names)
            x, y, z, w = Turn.from_euler("ZYX", [yaw, pitch, roll]).as_quat().tolist()
            quat = f"{w!r} {x!r} {y!r} {z!r}"
        v = body.values
        inertia = " ".join(repr(v[f"I_{e}"]) for e in ("xx", "yy", "zz", "xy", "xz", "yz"))
        text = f'<body name="{name}" pos="{place}" quat="{quat}">'
        com = " ".join(repr(v[f"com_{a}"]) for a in LENGTHS)
        text += f'<inertial mass="{v["mass"]!r}" pos="{com}" fullinertia="{inertia}"/>'
        if len(body.free) == 6:
            text += "<freejoint/>"
            order.extend(f"{name}.{c}" for c in (*LENGTHS, *ANGLES))
        else:
            for c in (*LENGTHS, *reversed(ANGLES)):
                if c in body.free:
                    text += f'<joint type="{"slide" if c in LENGTHS else "hinge"}" axis="{AXES[c]}"/>'
                    order.append(f"{name}.{c}")
        text += "".join(element(n) for n in components if n in hangs and hangs[n].rpartition(".")[0] == name)
        return text + "</body>"

    bodies = "".join(element(n) for n in components if n not in hangs)
    xml = (
        '<mujoco><compiler angle="radian" inertiafromgeom="false"/>'
        '<option gravity="0 0 -9.80665" integrator="RK4" timestep="2e-4"><flag contact="disable"/></option>'
        f"<worldbody>{bodies}</worldbody></mujoco>"
    )
    return mujoco.MjModel.from_xml_string(xml), order


def double_pendulum() -> Model:
    model = Model("double pendulum")
    only = {**LOCKED, "pitch": True}
    model.add(
        "upper",
        Link(mass=1.5, com_z=-0.3, tip_z=-0.7, I_xx=0.02, I_yy=0.03, I_zz=0.015, **only, pitch_start=1.4),
    )
    model.add(
        "fore",
        Link(mass=0.9, com_z=-0.25, com_x=0.02, I_xx=0.012, I_yy=0.01, I_zz=0.005, **only, pitch_start=0.6),
    )
    model.connect("fore.parent", "upper.tip")
    return model


def cart_pole() -> Model:
    model = Model("cart and pole")
    model.add("cart", RigidBody(mass=2.0, I_xx=0.1, I_yy=0.1, I_zz=0.1, **{**LOCKED, "x": True}, v_x_start=0.3))
    model.add(
        "pole",
        RigidBody(
            mass=0.5,
            com_z=-0.4,
            I_yy=0.03,
            I_xx=0.03,
            I_zz=0.002,
            **{**LOCKED, "pitch": True},
            pitch_start=2.5,
        ),
    )
    model.connect("pole.parent", "cart.origin")
    return model


def solid(mass: float, k: float) -> dict[str, float]:
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
        "I_xz": 0.02 * k,
    }


def branched(floating: bool) -> Model:
    """Hub with an arm on a universal joint, a forearm, and a slider with a wheel on a tilted rail."""
    model = Model("branched")
    free = {} if floating else {**LOCKED, "z": True, "roll": True}
    model.add("hub", Hub(**solid(3.0, 1.0), **free, roll_start=0.2))
    model.add(
        "arm",
        Link(
            **solid(1.0, 0.4),
            tip_x=0.4,
            tip_z=0.1,
            **{**LOCKED, "pitch": True, "yaw": True},
            pitch_start=0.3,
            yaw_start=-0.4,
            pitch_rate_start=1.0,
        ),
    )
    model.add("fore", Link(**solid(0.5, 0.2), **{**LOCKED, "roll": True, "y": True}, y_start=0.05))
    model.add("slider", Link(**solid(0.8, 0.3), **{**LOCKED, "z": True}, tip_x=0.1))
    model.add("wheel", RigidBody(**solid(0.4, 0.1), **{**LOCKED, "yaw": True}, yaw_rate_start=5.0))
    for child, frame in (
        ("arm", "hub.shoulder"),
        ("fore", "arm.tip"),
        ("slider", "hub.rail"),
        ("wheel", "slider.tip"),
    ):
        model.connect(f"{child}.parent", frame)
    return model


def to_peer(model: Model, system, order: list[str], x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return MuJoCo's qpos and qvel for one of our states."""
    value = dict(zip(system.state_names, x, strict=True))
    qpos: list[float] = []
    qvel: list[float] = []
    for name in order:
        owner, _, c = name.rpartition(".")
        body = model.components[owner]
        floating = len(body.free) == 6
        if floating and c in ANGLES:
            if c == "roll":
                a = Turn.from_euler("ZYX", [value[f"{owner}.{n}"] for n in ("yaw", "pitch", "roll")]).as_quat()
                qpos += [a[3], a[0], a[1], a[2]]
        else:
            qpos.append(value[name])
        qvel.append(value[f"{owner}.{body.speed_name(c)}"])
    return np.array(qpos), np.array(qvel)


@pytest.mark.parametrize(
    "make",
    [double_pendulum, cart_pole, lambda: branched(False), lambda: branched(True)],
    ids=["double pendulum", "cart and pole", "branched", "branched and floating"],
)
def test_accelerations_at_random_states(make):
    model = make()
    system = model.build(compiled=False)
    theirs, order = peer(model)
    data = mujoco.MjData(theirs)
    rng = np.random.default_rng(11)
    speeds = []
    for n in order:
        owner, _, c = n.rpartition(".")
        speeds.append(system.index("state", f"{owner}.{model.components[owner].speed_name(c)}"))
    for _ in range(5):
        x = rng.uniform(-1.0, 1.0, size=len(system.states))
        data.qpos[:], data.qvel[:] = to_peer(model, system, order, x)
        mujoco.mj_forward(theirs, data)
        ours = system.rhs(0.0, x)[speeds]
        # double precision on both sides, condition of the mass matrix about 1e3
        np.testing.assert_allclose(ours, data.qacc, rtol=1e-9, atol=1e-9 * np.abs(data.qacc).max())


@pytest.mark.parametrize(
    "make",
    [double_pendulum, cart_pole, lambda: branched(False)],
    ids=["double pendulum", "cart and pole", "branched"],
)
def test_trajectory_over_the_first_seconds(make):
    model = make()
    system = model.build()
    theirs, order = peer(model)
    data = mujoco.MjData(theirs)
    data.qpos[:], data.qvel[:] = to_peer(model, system, order, system.start)
    steps = 100  # one record every 100 · 2e-4 s
    shown = [data.qpos.copy()]
    for _ in range(100):
        for _ in range(steps):
            mujoco.mj_step(theirs, data)
        shown.append(data.qpos.copy())
    run = system.simulate(2.0, times=np.linspace(0, 2, 101), rtol=1e-11, atol=1e-13)
    ours = np.stack([run[n] for n in order], axis=1)
    np.testing.assert_allclose(ours, np.array(shown), atol=1e-6)
    stored = run["energy.stored"]
    assert np.ptp(stored) < 1e-8 * max(np.ptp(run[f"{n.rpartition('.')[0]}.potential_energy"]) for n in order)
