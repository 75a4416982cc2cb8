"""A road vehicle on a test track: traction force in kilonewtons, speed in km/h, long records at a slow rate."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from discrepancy.validation.machines.excitation import smooth_steps
from discrepancy.validation.machines.machine import Channel, Drive, Effect, Machine, Parameter, Start, actuator, sensor
from discrepancy.validation.machines.simulate import rk4

__all__ = ["MACHINE"]

Array = NDArray[np.float64]

ABOUT = """
A van drives along a straight, level track, always forwards. The traction force at the wheels is recorded.

    m dv/dt = F - F_r - c v,   ds/dt = v

The speed is in km/h, the way by satellite in m.
"""

MODEL = '''
"""Van on a straight track."""

from multibody import Model
from multibody.library import CoulombFriction, ForceSource, Mass, ViscousFriction


def build() -> Model:
    m = Model("vehicle")
    van = m.add("van", Mass(m=2100.0, velocity=15.0))
    tyres = m.add("tyres", CoulombFriction(coulomb=240.0, v_s=0.05))
    losses = m.add("losses", ViscousFriction(viscous=14.0))
    traction = m.add("traction", ForceSource())
    m.connect(van.flange, tyres.b, losses.b, traction.flange)
    m.connect(tyres.a, losses.a, m.ground)
    m.input("traction.force", traction.force)
    return m
'''


def _excite(rng: np.random.Generator, t: Array) -> dict[str, Array]:
    target = smooth_steps(rng, t, 10.0, 28.0, 15.0, 6.0)
    return {
        "force": 240.0 + 14.0 * target + 2100.0 * np.gradient(target, t) + 500.0 * (target[0] - 15.0) * np.exp(-t / 4.0)
    }


def _start(p: Any) -> list[Array]:
    zero = np.zeros_like(p.m)
    return [zero, 15.0 + p.speed_0, zero]


def _rates(x: Array, u: Any, w: Any, p: Any) -> list[Array]:
    s, v, warm = x
    rolling = p.F_r * (1.0 - p.warming * warm) * np.tanh(v / 0.05)
    force = (
        u["force"]
        + w["body"]
        - rolling
        - p.c * v
        - p.drag * v * np.abs(v)
        + p.slope
        - p.driveline * np.abs(u["force"]) * v / 25.0
        + p.wind * np.sin(s / p.length)
    )
    return [v, force / p.m, (np.abs(v) / 25.0 - warm) / 40.0]


def _observe(x: Array, u: Any, p: Any) -> dict[str, Array]:
    return {"way": x[0], "speed": x[1]}


MACHINE = Machine(
    name="vehicle",
    about=ABOUT,
    model=MODEL,
    parameters=(
        Parameter(name="m", stated=2100.0, std=40.0, path="van.m"),
        Parameter(name="F_r", stated=240.0, std=40.0, path="tyres.coulomb"),
        Parameter(name="c", stated=14.0, std=4.0, path="losses.viscous"),
    ),
    starts=(Start("speed_0", 0.3, "van.velocity"),),
    channels=(
        Channel(name="speed", column="speed [km/h]", scale=3.6, output="van.velocity", noise=0.03, quantum=0.01 / 3.6),
        Channel(name="way", column="way_m", output="van.position", noise=0.5),
    ),
    drives=(Drive(name="force", column="traction_kN", scale=1e-3, input="traction.force"),),
    effects=(
        Effect(name="air", strength="drag", size=0.5, accept=("quadratic_drag@*",), what="drag c v^2"),
        Effect(
            name="hills",
            strength="wind",
            size=50.0,
            accept=("angle_harmonic@*", "position_dependent_force@*"),
            shape={"length": (30.0, 60.0)},
            what="a track that rises and falls",
        ),
        sensor("speed", "van.velocity", "gain", 0.01),
        sensor("speed", "van.velocity", "delay", 0.3),
        actuator("force", "traction.force", "gain", 0.05),
        actuator("force", "traction.force", "delay", 0.3),
        Effect(
            name="warming",
            strength="warming",
            size=0.2,
            accept=("friction_drift@tyres*", "friction_drift@van*"),
            what="tyres that roll more easily as they warm up",
        ),
        Effect(name="driveline", strength="driveline", size=0.02, what="loss with the traction force times the speed"),
    ),
    constants={"length": 45.0, "slope": 0.0},
    places={"body": 20.0},
    dt=0.1,
    rows=1200,
    substeps=2,
    excite=_excite,
    start=_start,
    step=rk4(_rates),
    observe=_observe,
)
