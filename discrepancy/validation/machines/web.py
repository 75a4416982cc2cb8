"""A web between two driven rollers: unwinder, elastic web, winder, always turning one way."""

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
A paper web runs from one roller to another. Torques on both rollers are prescribed; r = 0.15 m.

    F = k (r b - r a) + d (r wb - r wa)            (tension)
    J_a dwa/dt = ta + r F - c_a wa
    J_b dwb/dt = tb - r F - c_b wb
"""

MODEL = '''
"""Web between two driven rollers."""

from multibody import Component, Model, Output, Parameter, Rotation
from multibody.library import Inertia, RotaryViscousFriction, TorqueSource


class Web(Component):
    """Tension = stiffness · stretch + damping · its rate, between the surfaces of two rollers."""

    stiffness = Parameter(None, "N*m/rad", "torque per angle between the rollers", min=0.0)
    damping = Parameter(0.0, "N*m*s/rad", "torque per difference of their speeds", min=0.0)
    radius = Parameter(0.15, "m", "radius of both", min=1e-9)
    a = Rotation("unwinder")
    b = Rotation("winder")
    tension = Output("N", "positive when stretched")

    def equations(self):
        torque = self.stiffness * (self.b.angle - self.a.angle) + self.damping * (self.b.speed - self.a.speed)
        self.tension = torque / self.radius
        self.a.torque = torque
        self.b.torque = -torque


def build() -> Model:
    m = Model("web")
    unwinder = m.add("unwinder", Inertia(J=0.5, speed=5.0))
    winder = m.add("winder", Inertia(J=0.35, speed=5.0))
    web = m.add("web", Web(stiffness=90.0, damping=1.2))
    unwinder_bearing = m.add("unwinder_bearing", RotaryViscousFriction(viscous=0.15))
    winder_bearing = m.add("winder_bearing", RotaryViscousFriction(viscous=0.12))
    brake = m.add("brake", TorqueSource())
    motor = m.add("motor", TorqueSource())
    m.connect(brake.flange, unwinder.flange, web.a, unwinder_bearing.b)
    m.connect(motor.flange, winder.flange, web.b, winder_bearing.b)
    m.connect(unwinder_bearing.a, winder_bearing.a, m.ground)
    m.input("unwinder.torque", brake.torque)
    m.input("winder.torque", motor.torque)
    return m
'''

RADIUS = 0.15


def _excite(rng: np.random.Generator, t: Array) -> dict[str, Array]:
    pull = smooth_steps(rng, t, 3.0, 9.0, 2.0, 0.3) + sines(rng, t, 0.8, 0.3, 4.0)
    return {"brake": -smooth_steps(rng, t, 1.0, 4.0, 1.5, 0.3), "motor": pull}


def _start(p: Any) -> list[Array]:
    zero = np.zeros_like(p.k)
    return [zero, p.stretch_0, 5.0 + p.unwinder_0, 5.0 + p.winder_0, zero, zero]


def _torque(x: Array, p: Any) -> Array:
    stretch = x[1] - x[0] - x[4]
    return np.asarray(p.k * stretch + p.d * (x[3] - x[2]) + p.sticky * (stretch - x[5]))


def _rates(x: Array, u: Any, w: Any, p: Any) -> list[Array]:
    a, b, wa, wb, crept, slow = x
    torque = _torque(x, p)
    rub = p.rub * np.tanh(wa / 0.01)
    wobble = p.wobble * np.cos(b + p.phase)
    down = u["brake"] + w["unwinder"] + torque - p.c_a * wa - rub
    up = u["motor"] + w["winder"] - torque - p.c_b * wb - p.drag * wb * np.abs(wb) + wobble
    return [wa, wb, down / p.J_a, up / p.J_b, p.creep * torque, (b - a - crept - slow) / 0.4]


def _observe(x: Array, u: Any, p: Any) -> dict[str, Array]:
    return {"unwinder": x[2], "winder": x[3], "tension": _torque(x, p) / RADIUS}


MACHINE = Machine(
    name="web",
    about=ABOUT,
    model=MODEL,
    parameters=(
        Parameter(name="J_a", stated=0.5, std=0.02, path="unwinder.J"),
        Parameter(name="J_b", stated=0.35, std=0.015, path="winder.J"),
        Parameter(name="k", stated=90.0, std=5.0, path="web.stiffness"),
        Parameter(name="d", stated=1.2, std=0.4, path="web.damping"),
        Parameter(name="c_a", stated=0.15, std=0.03, path="unwinder_bearing.viscous"),
        Parameter(name="c_b", stated=0.12, std=0.03, path="winder_bearing.viscous"),
    ),
    starts=(
        Start("stretch_0", 0.01, "winder.angle"),
        Start("unwinder_0", 0.2, "unwinder.speed"),
        Start("winder_0", 0.2, "winder.speed"),
    ),
    channels=(
        Channel(name="unwinder", column="unwinder_rad_s", output="unwinder.speed", noise=0.05),
        Channel(name="winder", column="winder_rad_s", output="winder.speed", noise=0.05),
        Channel(name="tension", column="tension_N", output="web.tension", noise=0.4, quantum=0.1),
    ),
    drives=(
        Drive(name="brake", column="unwinder_torque_Nm", input="unwinder.torque"),
        Drive(name="motor", column="winder_torque_Nm", input="winder.torque"),
    ),
    effects=(
        Effect(name="creep", strength="creep", size=5e-3, accept=("slip@web",), what="the web creeps under tension"),
        Effect(
            name="rub",
            strength="rub",
            size=0.3,
            accept=("coulomb_friction@unwinder*", "constant_force@unwinder*", "input_offset@unwinder.torque"),
            what="dry friction of the unwinder, which turns one way",
        ),
        Effect(name="fan", strength="drag", size=2e-3, accept=("quadratic_drag@winder*",), what="drag of the winder"),
        Effect(
            name="unbalance",
            strength="wobble",
            size=0.3,
            accept=("angle_harmonic@winder*", "position_dependent_force@winder*"),
            shape={"phase": (0.0, 6.28)},
            what="weight beside the winder's axis",
        ),
        sensor("tension", "web.tension", "gain", 0.05),
        sensor("tension", "web.tension", "drift", 0.1),
        Effect(name="sticky", strength="sticky", size=10.0, what="a web with memory: a second spring behind a damper"),
    ),
    constants={"phase": 0.0},
    places={"unwinder": 0.05, "winder": 0.05},
    dt=0.01,
    rows=1500,
    substeps=4,
    excite=_excite,
    start=_start,
    step=rk4(_rates),
    observe=_observe,
)
