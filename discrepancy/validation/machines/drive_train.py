"""A drive train on a test bench: motor, torque shaft, brake; dry friction after LuGre, speeds in turns a minute."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from discrepancy.validation.machines.excitation import sines, smooth_steps
from discrepancy.validation.machines.machine import Channel, Drive, Effect, Machine, Parameter, Start, sensor
from discrepancy.validation.machines.simulate import rk4

__all__ = ["MACHINE"]

Array = NDArray[np.float64]

ABOUT = """
A motor turns a brake through a slender shaft with a torque sensor in it. The torque of the motor is prescribed.

    T = k (a - b) + d (wa - wb)                    (torque of the shaft)
    J_m dwa/dt = torque - c_m wa - T
    J_b dwb/dt = T - c_b wb - T_c sgn(wb)

Both speeds are in turns a minute; the torque sensor reads T.
"""

MODEL = '''
"""Drive train on a test bench."""

from multibody import Component, Model, Output, Parameter, Rotation
from multibody.library import Inertia, RotaryCoulombFriction, RotaryViscousFriction, TorqueSource


class Shaft(Component):
    """Torque = stiffness · twist + damping · rate of twist."""

    stiffness = Parameter(None, "N*m/rad", "torque per twist", min=0.0)
    damping = Parameter(0.0, "N*m*s/rad", "torque per rate of twist", min=0.0)
    a = Rotation("brake side")
    b = Rotation("motor side")
    torque = Output("N*m", "positive when the motor side is ahead")

    def equations(self):
        self.torque = self.stiffness * (self.b.angle - self.a.angle) + self.damping * (self.b.speed - self.a.speed)
        self.a.torque = self.torque
        self.b.torque = -self.torque


def build() -> Model:
    m = Model("drive train")
    motor = m.add("motor", Inertia(J=0.02))
    motor_bearing = m.add("motor_bearing", RotaryViscousFriction(viscous=0.012))
    shaft = m.add("shaft", Shaft(stiffness=160.0, damping=0.06))
    brake = m.add("brake", Inertia(J=0.07))
    brake_bearing = m.add("brake_bearing", RotaryViscousFriction(viscous=0.03))
    dry = m.add("dry", RotaryCoulombFriction(coulomb=0.7, v_s=0.005))
    source = m.add("source", TorqueSource())
    m.connect(source.flange, motor.flange, motor_bearing.b, shaft.b)
    m.connect(shaft.a, brake.flange, brake_bearing.b, dry.b)
    m.connect(motor_bearing.a, brake_bearing.a, dry.a, m.ground)
    m.input("motor.torque", source.torque)
    return m
'''

SIGMA = 7000.0  # N·m/rad, stiffness of the bristles: presliding of a tenth of a milliradian
SIGMA_1 = 7.0  # N·m·s/rad, their damping: a sixth of the critical one, so that the brake comes to rest
CREEP = 0.03  # rad/s, speed above which that damping has gone


def _excite(rng: np.random.Generator, t: Array) -> dict[str, Array]:
    return {"torque": smooth_steps(rng, t, -5.0, 5.0, 0.8, 0.1) + sines(rng, t, 1.5, 0.5, 20.0)}


def _start(p: Any) -> list[Array]:
    zero = np.zeros_like(p.k)
    return [p.twist_0, zero, p.motor_0, p.brake_0, zero]


def _shaft(x: Array, p: Any) -> Array:
    twist = x[0] - x[1]
    loose = twist - np.clip(twist, -0.5 * p.gap, 0.5 * p.gap)
    return np.asarray(p.k * (1.0 + p.joint * np.cos(2.0 * x[0])) * loose + p.d * (x[2] - x[3]))


def _rates(x: Array, u: Any, w: Any, p: Any) -> list[Array]:
    a, _, wa, wb, z = x
    torque = _shaft(x, p)
    ripple = p.cosine * np.cos(p.order * a + p.phase)
    brake = (
        torque
        - p.c_b * wb
        - SIGMA * z
        - SIGMA_1 * wb * np.exp(-((wb / CREEP) ** 2))
        - p.drag * wb * np.abs(wb)
        + w["brake"]
    )
    motor = u["torque"] + ripple + w["motor"] - p.c_m * wa - torque
    return [wa, wb, motor / p.J_m, brake / p.J_b, np.zeros_like(z)]


_MOTION = rk4(_rates)


def _yielded(x: Array, p: Any, h: float) -> Array:
    """The bristles after a time, exactly for a constant speed: they are far stiffer than the motion at high speed."""
    speed = x[3]
    level = p.T_c + p.stribeck * np.exp(-((speed / p.v_stribeck) ** 2))
    slid = level * np.sign(speed) / SIGMA
    bent = np.where(np.abs(speed) < 1e-9, x[4], slid + (x[4] - slid) * np.exp(-SIGMA * np.abs(speed) / level * h))
    return np.stack([*x[:4], bent])


def _step(x: Array, drives: Any, w: Any, p: Any, h: float) -> Array:
    return _yielded(_MOTION(_yielded(x, p, 0.5 * h), drives, w, p, h), p, 0.5 * h)


def _observe(x: Array, u: Any, p: Any) -> dict[str, Array]:
    return {"motor": x[2], "brake": x[3], "torque": _shaft(x, p)}


MACHINE = Machine(
    name="drive_train",
    about=ABOUT,
    model=MODEL,
    parameters=(
        Parameter(name="J_m", stated=0.02, std=6e-4, path="motor.J"),
        Parameter(name="J_b", stated=0.07, std=2e-3, path="brake.J"),
        Parameter(name="k", stated=160.0, std=8.0, path="shaft.stiffness"),
        Parameter(name="d", stated=0.06, std=0.02, path="shaft.damping"),
        Parameter(name="c_m", stated=0.012, std=3e-3, path="motor_bearing.viscous"),
        Parameter(name="c_b", stated=0.03, std=8e-3, path="brake_bearing.viscous"),
        Parameter(name="T_c", stated=0.7, std=0.15, path="dry.coulomb"),
    ),
    starts=(
        Start("twist_0", 2e-3, "motor.angle"),
        Start("motor_0", 0.2, "motor.speed"),
        Start("brake_0", 0.2, "brake.speed"),
    ),
    channels=(
        Channel(name="motor", column="motor_rpm", scale=30.0 / np.pi, output="motor.speed", noise=0.15),
        Channel(name="brake", column="brake_rpm", scale=30.0 / np.pi, output="brake.speed", noise=0.15),
        Channel(name="torque", column="shaft_Nm", output="shaft.torque", noise=0.03, quantum=0.01),
    ),
    drives=(Drive(name="torque", column="motor_torque_Nm", input="motor.torque"),),
    effects=(
        Effect(
            name="play", strength="gap", size=5e-3, accept=("backlash@shaft",), what="play in the shaft's couplings"
        ),
        Effect(
            name="stribeck",
            strength="stribeck",
            size=0.3,
            accept=("stribeck_friction@dry*", "stribeck_friction@brake*"),
            shape={"v_stribeck": (1.0, 5.0)},
            what="LuGre with a Gaussian Stribeck peak",
        ),
        Effect(
            name="fan",
            strength="drag",
            size=1e-3,
            accept=("quadratic_drag@brake*", "quadratic_drag@dry*"),
            what="drag of the brake's fan",
        ),
        Effect(
            name="cogging",
            strength="cosine",
            size=0.2,
            accept=("angle_harmonic@motor*", "position_dependent_force@motor*"),
            shape={"order": (6.0, 6.0), "phase": (0.0, 6.28)},
            what="six periods a turn of the motor",
        ),
        sensor("torque", "shaft.torque", "gain", 0.03),
        sensor("brake", "brake.speed", "delay", 2e-3),
        Effect(name="joint", strength="joint", size=0.05, what="stiffness of the shaft that varies twice a turn"),
    ),
    constants={"v_stribeck": 2.0, "order": 6.0, "phase": 0.0},
    places={"brake": 0.05, "motor": 0.05},
    dt=4e-3,
    rows=1500,
    substeps=8,
    excite=_excite,
    start=_start,
    step=_step,
    observe=_observe,
)
