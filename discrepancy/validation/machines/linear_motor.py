"""A linear-motor stage under a sampled controller; friction by Moreau's time stepping, micrometres."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from discrepancy.validation.machines.excitation import smooth_steps
from discrepancy.validation.machines.machine import Channel, Drive, Effect, Machine, Parameter, Start, sensor

__all__ = ["MACHINE"]

Array = NDArray[np.float64]

ABOUT = """
A linear motor moves a slide along a rail. The controller is sampled once a row, and its force is held:

    e = v_ref + 25 (x_ref - x_measured) - v_measured;   I <- I + 2000 e dt;   F = 180 e + I

    m dv/dt = F - b v - F_c sgn(v)

The scale reads micrometres, the tachometer m/s. The force is measured by the motor's current, 32 N/A.
"""

MODEL = '''
"""Linear-motor stage, closed loop from the reference."""

from multibody import Model
from multibody.library import (
    CoulombFriction,
    Delay,
    ForceSource,
    Gain,
    Mass,
    PositionController,
    PositionSensor,
    VelocitySensor,
    ViscousFriction,
)

TICK = 2e-3


def build() -> Model:
    m = Model("linear motor")
    # The sum is updated before it is used: half a tick of the integral gain on top of the proportional one.
    controller = m.add(
        "controller",
        PositionController(
            position_unit="m",
            output_unit="N",
            feedforward=True,
            k_position=25.0,
            k_speed=180.0 + 1000.0 * TICK,
            k_i=2000.0,
        ),
    )
    hold = m.add("hold", Delay(input_unit="N", order=2, delay=0.5 * TICK))
    motor = m.add("motor", ForceSource())
    slide = m.add("slide", Mass(m=11.0))
    rail = m.add("rail", ViscousFriction(viscous=35.0))
    dry = m.add("dry", CoulombFriction(coulomb=9.0, v_s=1e-5))
    scale = m.add("scale", PositionSensor())
    tacho = m.add("tacho", VelocitySensor())
    meter = m.add("meter", Gain(input_unit="N", output_unit="A", k=1.0 / 32.0))
    m.connect(slide.flange, motor.flange, rail.b, dry.b, scale.flange, tacho.flange)
    m.connect(rail.a, dry.a, m.ground)
    m.connect(scale.position, controller.position)
    m.connect(tacho.velocity, controller.speed)
    m.connect(controller.output, hold.input, meter.input)
    m.connect(hold.output, motor.force)
    m.input("reference.position", controller.reference)
    m.input("reference.speed", controller.reference_speed)
    return m
'''

TICK = 2e-3
PITCH = 0.032  # m, of the magnets


def _excite(rng: np.random.Generator, t: Array) -> dict[str, Array]:
    fine = np.arange(t[0], t[-1] + 1e-9, TICK)
    place = smooth_steps(rng, fine, -0.1, 0.1, 0.7, 0.45)
    place -= place[0]  # the slide waits at the reference
    return {"place": place, "speed": np.gradient(place, TICK)}


def _start(p: Any) -> list[Array]:
    return [p.place_0, p.speed_0]


def _control(memory: Any, seen: Any, u: Any, p: Any) -> tuple[Any, dict[str, Array]]:
    e = u["speed"] + 25.0 * (u["place"] - seen["place"]) - seen["speed"]
    memory = (0.0 if memory is None else memory) + 2000.0 * TICK * e
    return memory, {"force": 180.0 * e + memory}


def _step(x: Array, drives: Any, w: Any, p: Any, h: float) -> Array:
    """Half a step of motion, a step of forces with the friction's impulse bounded, half a step of motion."""
    u = drives(0.5)
    s = x[0] + 0.5 * h * x[1]
    ripple = p.cogging * np.sin(2.0 * np.pi * s / PITCH + p.phase)
    force = u["force"] * (1.0 + p.reluctance * np.sin(4.0 * np.pi * s / PITCH)) + ripple + w["slide"] + p.pull
    decay = p.b / p.m
    free = (x[1] * (1.0 - 0.5 * h * decay) + h * force / p.m) / (1.0 + 0.5 * h * decay)
    level = p.F_c * (1.0 + p.uneven * s / 0.15) + np.where(free > 0.0, p.forward, 0.0)
    v = np.sign(free) * np.maximum(np.abs(free) - h * level / p.m, 0.0)
    return np.stack([s + 0.5 * h * v, v])


def _observe(x: Array, u: Any, p: Any) -> dict[str, Array]:
    return {"place": x[0], "speed": x[1], "current": u.get("force", 0.0 * x[0]) / 32.0}


MACHINE = Machine(
    name="linear_motor",
    about=ABOUT,
    model=MODEL,
    parameters=(
        Parameter(name="m", stated=11.0, std=0.3, path="slide.m"),
        Parameter(name="b", stated=35.0, std=9.0, path="rail.viscous"),
        Parameter(name="F_c", stated=9.0, std=2.0, path="dry.coulomb"),
    ),
    starts=(Start("place_0", 1e-4, "slide.position"), Start("speed_0", 2e-3, "slide.velocity")),
    channels=(
        Channel(name="place", column="slide_um", scale=1e6, output="slide.position", noise=2e-6, quantum=1e-6),
        Channel(name="speed", column="slide_m_s", output="slide.velocity", noise=5e-4),
        Channel(name="current", column="motor_A", output="meter.output", noise=0.02, quantum=0.01),
    ),
    drives=(
        Drive(name="place", column="reference_um", scale=1e6, input="reference.position"),
        Drive(name="speed", column="reference_m_s", input="reference.speed"),
    ),
    effects=(
        Effect(
            name="cogging",
            strength="cogging",
            size=2.0,
            accept=("angle_harmonic@*", "position_dependent_force@*"),
            shape={"phase": (0.0, 6.28)},
            what="a force with the period of the magnets, 32 mm",
        ),
        Effect(
            name="one_way",
            strength="forward",
            size=2.0,
            accept=("asymmetric_coulomb_friction@*",),
            what="dry friction that is larger forwards",
        ),
        Effect(
            name="uneven",
            strength="uneven",
            size=0.2,
            accept=("position_dependent_friction@*",),
            signed=True,
            what="dry friction that changes along the rail",
        ),
        Effect(
            name="pull", strength="pull", size=1.0, accept=("constant_force@*",), signed=True, what="a constant pull"
        ),
        sensor("current", "meter.output", "gain", 0.02),
        Effect(
            name="reluctance",
            strength="reluctance",
            size=0.05,
            what="force constant that varies along the rail with half the magnets' period",
        ),
    ),
    constants={"phase": 0.0},
    places={"slide": 0.5},
    dt=TICK,
    rows=1500,
    substeps=10,
    excite=_excite,
    start=_start,
    step=_step,
    observe=_observe,
    control=_control,
)
