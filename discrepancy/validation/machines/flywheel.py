"""A flywheel energy store, spun up by a known torque and left to coast; friction after Tustin, with exact rest."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from discrepancy.validation.machines.excitation import smooth_steps
from discrepancy.validation.machines.machine import Channel, Drive, Effect, Machine, Parameter, Start, actuator, sensor

__all__ = ["MACHINE"]

Array = NDArray[np.float64]

ABOUT = """
A steel flywheel on two bearings. A machine on the same shaft gives a known torque, prescribed, linear between rows.

    J dw/dt = torque - b w - T_c sgn(w)

The tachometer reads in turns a minute.
"""

MODEL = '''
"""Flywheel on two bearings."""

from multibody import Model
from multibody.library import Inertia, RotaryCoulombFriction, RotaryViscousFriction, TorqueSource


def build() -> Model:
    m = Model("flywheel")
    wheel = m.add("wheel", Inertia(J=0.85))
    bearing = m.add("bearing", RotaryViscousFriction(viscous=0.004))
    dry = m.add("dry", RotaryCoulombFriction(coulomb=0.35, v_s=0.02))
    motor = m.add("motor", TorqueSource())
    m.connect(wheel.flange, bearing.b, dry.b, motor.flange)
    m.connect(bearing.a, dry.a, m.ground)
    m.input("motor.torque", motor.torque)
    return m
'''


def _excite(rng: np.random.Generator, t: Array) -> dict[str, Array]:
    """Spin up, hold, reverse."""
    return {"torque": smooth_steps(rng, t, -9.0, 9.0, 3.0, 0.4)}


def _start(p: Any) -> list[Array]:
    """At rest, or nearly so."""
    return [p.speed_0]


def _step(x: Array, drives: Any, w: Any, p: Any, h: float) -> Array:
    """Half a step of friction, a step of torque, half a step of friction; friction alone cannot turn the wheel back."""
    u = drives(0.5)

    def slowed(speed: Array) -> Array:
        size = np.abs(speed)
        level = p.T_c + p.breakaway * np.exp(-size / p.v_stribeck)
        level = level * (1.0 + p.heating * np.log1p(size / 30.0)) + p.drag * size**2
        return np.sign(speed) * np.maximum(size - 0.5 * h * level / p.J, 0.0)

    speed = slowed(x[0])
    torque = u["torque"] + w["shaft"] + p.pull
    half = torque - p.b * (speed + 0.5 * h * (torque - p.b * speed) / p.J)
    return np.stack([slowed(speed + h * half / p.J)])


def _observe(x: Array, u: Any, p: Any) -> dict[str, Array]:
    """Speed."""
    return {"speed": x[0]}


MACHINE = Machine(
    name="flywheel",
    about=ABOUT,
    model=MODEL,
    parameters=(
        Parameter(name="J", stated=0.85, std=0.02, path="wheel.J"),
        Parameter(name="b", stated=0.004, std=0.001, path="bearing.viscous"),
        Parameter(name="T_c", stated=0.35, std=0.07, path="dry.coulomb"),
    ),
    starts=(Start("speed_0", 0.3, "wheel.speed"),),
    channels=(Channel(name="speed", column="speed_rpm", scale=30.0 / np.pi, output="wheel.speed", noise=0.05),),
    drives=(Drive(name="torque", column="torque_Nm", input="motor.torque"),),
    effects=(
        Effect(
            name="windage",
            strength="drag",
            size=5e-4,
            accept=("quadratic_drag@*",),
            what="torque -c w|w|",
        ),
        Effect(
            name="breakaway",
            strength="breakaway",
            size=0.3,
            accept=("stribeck_friction@*",),
            shape={"v_stribeck": (0.8, 3.0)},
            what="friction that falls exponentially with speed (Tustin)",
        ),
        Effect(
            name="pull",
            strength="pull",
            size=0.1,
            accept=("constant_force@*", "input_offset@motor.torque"),
            signed=True,
            what="a constant torque",
        ),
        sensor("speed", "wheel.speed", "delay", 0.02),
        actuator("torque", "motor.torque", "delay", 0.02, also=("sensor_delay@wheel.speed",)),
        Effect(
            name="heating", strength="heating", size=0.3, what="dry friction that grows with the logarithm of speed"
        ),
    ),
    constants={"v_stribeck": 1.5},
    places={"shaft": 0.05},
    dt=0.02,
    rows=1000,
    excite=_excite,
    start=_start,
    step=_step,
    observe=_observe,
)
