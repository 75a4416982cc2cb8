"""A diaphragm valve with packing that sticks and slips (Karnopp); air pressure in bar, stem in millimetres."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from discrepancy.validation.machines.excitation import sines, smooth_steps
from discrepancy.validation.machines.machine import Channel, Drive, Effect, Machine, Parameter, Start, sensor

__all__ = ["MACHINE"]

Array = NDArray[np.float64]

ABOUT = """
Air on a diaphragm pushes a stem against a spring. The pressure is measured and is the input.

    m dv/dt = A p - k (x + x_0) - b v - F_c sgn(v),   dx/dt = v;   A = 0.02 m^2, x_0 = 20 mm
"""

MODEL = '''
"""Diaphragm valve."""

from multibody import Component, Input, Model, Parameter, Translation
from multibody.library import CoulombFriction, Mass, Spring, ViscousFriction


class Diaphragm(Component):
    """Force = area · pressure."""

    area = Parameter(0.02, "m**2", "area", min=1e-9)
    pressure = Input("Pa", "pressure above the atmosphere")
    stem = Translation("stem")

    def equations(self):
        self.stem.force = self.area * self.pressure


def build() -> Model:
    m = Model("valve")
    diaphragm = m.add("diaphragm", Diaphragm())
    stem = m.add("stem", Mass(m=2.5, position=0.02))
    spring = m.add("spring", Spring(stiffness=60000.0, length=-0.02))
    oil = m.add("oil", ViscousFriction(viscous=900.0))
    packing = m.add("packing", CoulombFriction(coulomb=120.0, v_s=2e-5))
    m.connect(diaphragm.stem, stem.flange, spring.b, oil.b, packing.b)
    m.connect(spring.a, oil.a, packing.a, m.ground)
    m.input("air.pressure", diaphragm.pressure)
    return m
'''

AREA, PRELOAD = 0.02, 0.02
REST = 1e-4  # m/s, half the band in which the stem counts as resting


def _excite(rng: np.random.Generator, t: Array) -> dict[str, Array]:
    steps = smooth_steps(rng, t, -0.6e5, 0.6e5, 1.0, 0.6) + sines(rng, t, 0.12e5, 0.3, 3.0)
    return {"pressure": 1.2e5 + steps - steps[0]}


def _start(p: Any) -> list[Array]:
    zero = np.zeros_like(p.m)
    return [0.02 + p.place_0, zero, zero]


def _step(x: Array, drives: Any, w: Any, p: Any, h: float) -> Array:
    """Semi-implicit Euler; inside the band of rest the stem stays while the packing can hold it."""
    u = drives(0.5)
    s, v, rested = x
    push = AREA * u["pressure"] - p.k * (s + PRELOAD) - p.bend * (s - 0.02) ** 3 + w["stem"] + p.flow
    speed = np.abs(v)
    level = p.F_c * (1.0 + p.uneven * (s - 0.02) / 0.02)
    slow = p.breakaway * np.exp(-speed / p.v_stribeck)
    aged = p.ageing * np.log1p(rested / 0.1)
    holds = (speed < REST) & (np.abs(push) <= level + slow + aged)
    way = np.where(speed < REST, np.sign(push), np.sign(v))
    moving = (v + h * (push - way * (level + slow)) / p.m) / (1.0 + h * p.b / p.m)
    turned = (speed >= REST) & (moving * v < 0.0)
    v = np.where(holds | turned, 0.0, moving)
    return np.stack([s + h * v, v, np.where(np.abs(v) < REST, rested + h, 0.0)])


def _observe(x: Array, u: Any, p: Any) -> dict[str, Array]:
    return {"stem": x[0]}


MACHINE = Machine(
    name="valve",
    about=ABOUT,
    model=MODEL,
    parameters=(
        Parameter(name="k", stated=60000.0, std=1200.0, path="spring.stiffness"),
        Parameter(name="b", stated=900.0, std=250.0, path="oil.viscous"),
        Parameter(name="F_c", stated=120.0, std=25.0, path="packing.coulomb"),
    ),
    starts=(Start("place_0", 5e-4, "stem.position"),),
    channels=(Channel(name="stem", column="stem_mm", scale=1e3, output="stem.position", noise=5e-5, quantum=1e-5),),
    drives=(Drive(name="pressure", column="air_bar", scale=1e-5, input="air.pressure"),),
    effects=(
        Effect(
            name="stiction",
            strength="breakaway",
            size=60.0,
            accept=("stribeck_friction@*",),
            shape={"v_stribeck": (2e-3, 8e-3)},
            what="packing with more friction at low speed",
        ),
        Effect(
            name="flow",
            strength="flow",
            size=20.0,
            accept=("constant_force@*", "input_offset@air.pressure"),
            signed=True,
            what="a constant force of the flow",
        ),
        Effect(
            name="bend",
            strength="bend",
            size=2e7,
            accept=("cubic_stiffness@*",),
            signed=True,
            what="spring that bends about the middle of the stroke",
        ),
        Effect(
            name="uneven",
            strength="uneven",
            size=0.2,
            accept=("position_dependent_friction@*",),
            signed=True,
            what="packing friction that changes along the stroke",
        ),
        sensor("stem", "stem.position", "delay", 0.02),
        Effect(
            name="ageing", strength="ageing", size=20.0, what="a hold that grows with the logarithm of the time at rest"
        ),
    ),
    constants={"v_stribeck": 4e-3, "m": 2.5},
    places={"stem": 5.0},
    dt=0.01,
    rows=800,
    substeps=30,
    excite=_excite,
    start=_start,
    step=_step,
    observe=_observe,
)
