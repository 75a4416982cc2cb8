"""A mirror scanner under a fast sampled controller on a noisy, quantised angle; angles in milliradians."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from discrepancy.validation.machines.excitation import smooth_steps
from discrepancy.validation.machines.machine import Channel, Drive, Effect, Machine, Parameter, Start, sensor
from discrepancy.validation.machines.simulate import rk4

__all__ = ["MACHINE"]

Array = NDArray[np.float64]

ABOUT = """
A galvanometer turns a mirror on a torsion bar. The controller is sampled once a row (20 kHz), and its torque is held:

    e = 900 (ref - angle_measured) - speed_measured;   I <- I + 0.004 e dt;   torque = 1.6e-5 e + I

    J dw/dt = torque - b w - k angle

The angle is in mrad; the torque is measured by the current, 0.011 N m/A.
"""

MODEL = '''
"""Mirror scanner, closed loop from the reference."""

from multibody import Model
from multibody.library import (
    AngleSensor,
    Delay,
    Gain,
    Inertia,
    PositionController,
    RotaryViscousFriction,
    SpeedSensor,
    TorqueSource,
    TorsionSpring,
)

TICK = 5e-5


def build() -> Model:
    m = Model("scanner")
    # The sum is updated before it is used: half a tick of the integral gain on top of the proportional one.
    controller = m.add(
        "controller",
        PositionController(
            position_unit="rad", output_unit="N*m", k_position=900.0, k_speed=1.6e-5 + 0.002 * TICK, k_i=0.004
        ),
    )
    hold = m.add("hold", Delay(input_unit="N*m", order=2, delay=0.5 * TICK))
    motor = m.add("motor", TorqueSource())
    mirror = m.add("mirror", Inertia(J=6e-9))
    bar = m.add("bar", TorsionSpring(stiffness=4e-3))
    air = m.add("air", RotaryViscousFriction(viscous=1e-6))
    angle = m.add("encoder", AngleSensor())
    speed = m.add("tacho", SpeedSensor())
    meter = m.add("meter", Gain(input_unit="N*m", output_unit="A", k=1.0 / 0.011))
    m.connect(mirror.flange, motor.flange, bar.b, air.b, angle.flange, speed.flange)
    m.connect(bar.a, air.a, m.ground)
    m.connect(angle.angle, controller.position)
    m.connect(speed.speed, controller.speed)
    m.connect(controller.output, hold.input, meter.input)
    m.connect(hold.output, motor.torque)
    m.input("reference", controller.reference)
    return m
'''

TICK = 5e-5


def _excite(rng: np.random.Generator, t: Array) -> dict[str, Array]:
    reference = smooth_steps(rng, t, -0.1, 0.1, 0.02, 0.006)
    return {"reference": reference - reference[0]}


def _start(p: Any) -> list[Array]:
    return [p.angle_0, p.speed_0, np.zeros_like(p.J)]


def _control(memory: Any, seen: Any, u: Any, p: Any) -> tuple[Any, dict[str, Array]]:
    e = 900.0 * (u["reference"] - seen["angle"]) - seen["speed"]
    memory = (0.0 if memory is None else memory) + 0.004 * TICK * e
    return memory, {"torque": 1.6e-5 * e + memory}


def _rates(x: Array, u: Any, w: Any, p: Any) -> list[Array]:
    angle, speed, bristle = x
    bar = p.k * angle + p.hard * angle**3 + p.grease * bristle
    torque = u["torque"] * (1.0 - p.fringe * angle**2) + w["mirror"]
    rub = p.rub * np.tanh(speed / 0.2)
    drag = p.b * speed + p.drag * speed * np.abs(speed)
    return [speed, (torque - bar - drag - rub) / p.J, (speed - np.abs(speed) * bristle) / p.reach]


def _observe(x: Array, u: Any, p: Any) -> dict[str, Array]:
    return {"angle": x[0], "speed": x[1], "current": u.get("torque", 0.0 * x[0]) / 0.011}


MACHINE = Machine(
    name="scanner",
    about=ABOUT,
    model=MODEL,
    parameters=(
        Parameter(name="J", stated=6e-9, std=2e-10, path="mirror.J"),
        Parameter(name="b", stated=1e-6, std=3e-7, path="air.viscous"),
        Parameter(name="k", stated=4e-3, std=3e-4, path="bar.stiffness"),
    ),
    starts=(Start("angle_0", 5e-4, "mirror.angle"), Start("speed_0", 0.1, "mirror.speed")),
    channels=(
        Channel(name="angle", column="angle_mrad", scale=1e3, output="mirror.angle", noise=5e-5, quantum=2e-5),
        Channel(name="speed", column="speed_rad_s", output="mirror.speed", noise=0.1),
        Channel(name="current", column="current_mA", scale=1e3, output="meter.output", noise=2e-3, quantum=1e-3),
    ),
    drives=(Drive(name="reference", column="reference_mrad", scale=1e3, input="reference"),),
    effects=(
        Effect(
            name="hard",
            strength="hard",
            size=0.05,
            accept=("cubic_stiffness@*",),
            signed=True,
            what="torsion bar with k_3 angle^3",
        ),
        Effect(
            name="grease",
            strength="grease",
            size=2e-5,
            accept=("hysteresis@*", "coulomb_friction@*"),  # that gives way is the same law
            shape={"reach": (5e-3, 2e-2)},
            what="friction of rolling elements, elastic over some milliradians (Dahl)",
        ),
        Effect(name="rub", strength="rub", size=1e-5, accept=("coulomb_friction@*",), what="dry friction"),
        Effect(name="air", strength="drag", size=1e-8, accept=("quadratic_drag@*",), what="drag of the mirror"),
        sensor("current", "meter.output", "gain", 0.02),
        sensor("current", "meter.output", "offset", 0.01),
        Effect(name="fringe", strength="fringe", size=1.0, what="torque constant that falls towards the ends"),
    ),
    constants={"reach": 1e-2},
    places={"mirror": 2e-6},
    dt=TICK,
    rows=1500,
    substeps=4,
    excite=_excite,
    start=_start,
    step=rk4(_rates),
    observe=_observe,
    control=_control,
)
