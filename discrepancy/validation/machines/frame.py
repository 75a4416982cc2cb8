"""A two-storey frame on a shaking table; hysteresis after Bouc and Wen, displacements in millimetres."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from discrepancy.validation.machines.excitation import sines
from discrepancy.validation.machines.machine import Channel, Drive, Effect, Machine, Parameter, Start, actuator, sensor
from discrepancy.validation.machines.simulate import rk4
from multibody.base.gravity import STANDARD_GRAVITY

__all__ = ["MACHINE"]

Array = NDArray[np.float64]

ABOUT = """
Two storeys on columns stand on a table that shakes. Positions are relative to the table; a is its acceleration.

    m_1 dv_1/dt = -k_1 x_1 - c_1 v_1 + k_2 (x_2 - x_1) + c_2 (v_2 - v_1) - m_1 a
    m_2 dv_2/dt = -k_2 (x_2 - x_1) - c_2 (v_2 - v_1) - m_2 a
"""

MODEL = '''
"""Two-storey frame on a shaking table."""

from multibody import Component, Input, Model, Parameter, Translation
from multibody.library import SpringDamper


class Storey(Component):
    """A mass whose position is relative to the table."""

    m = Parameter(100.0, "kg", "mass", min=1e-9)
    table = Input("m/s**2", "acceleration of the table")
    flange = Translation("floor", inertia="m")

    def equations(self):
        self.flange.force = -self.m * self.table


def build() -> Model:
    m = Model("frame")
    lower = m.add("lower", Storey(m=120.0))
    upper = m.add("upper", Storey(m=90.0))
    columns = m.add("columns", SpringDamper(stiffness=42000.0, damping=60.0))
    posts = m.add("posts", SpringDamper(stiffness=30000.0, damping=40.0))
    m.connect(columns.b, lower.flange, posts.a)
    m.connect(posts.b, upper.flange)
    m.connect(columns.a, m.ground)
    m.input("table.acceleration", lower.table, upper.table)
    return m
'''


def _excite(rng: np.random.Generator, t: Array) -> dict[str, Array]:
    envelope = np.sin(np.pi * np.clip(t / t[-1], 0.0, 1.0)) ** 0.5
    return {"table": envelope * sines(rng, t, 3.0, 0.4, 8.0, 9)}


def _start(p: Any) -> list[Array]:
    zero = np.zeros_like(p.m_1)
    return [p.lower_0, p.upper_0, p.lower_speed_0, p.upper_speed_0, zero, zero]


def _rates(x: Array, u: Any, w: Any, p: Any) -> list[Array]:
    x1, x2, v1, v2, z, spent = x
    dz = v1 / p.reach * (1.0 - np.abs(z) * (0.5 * np.sign(v1 * z) + 0.5))
    k_1 = p.k_1 / (1.0 + p.damage * spent)
    drift, rate = x2 - x1, v2 - v1
    lower = k_1 * x1 + p.c_1 * v1 + p.softening * x1**3 + p.level * z
    upper = (p.k_2 + p.sway * x1) * drift + p.c_2 * rate + p.cross * drift**3 + p.rub * np.tanh(rate / 1e-3)
    a = u["table"]
    return [v1, v2, (upper - lower + w["lower"]) / p.m_1 - a, (w["upper"] - upper) / p.m_2 - a, dz, np.abs(v1)]


def _observe(x: Array, u: Any, p: Any) -> dict[str, Array]:
    return {"lower": x[0], "upper": x[1]}


MACHINE = Machine(
    name="frame",
    about=ABOUT,
    model=MODEL,
    parameters=(
        Parameter(name="m_1", stated=120.0, std=2.0, path="lower.m"),
        Parameter(name="m_2", stated=90.0, std=1.5, path="upper.m"),
        Parameter(name="k_1", stated=42000.0, std=1500.0, path="columns.stiffness"),
        Parameter(name="k_2", stated=30000.0, std=1200.0, path="posts.stiffness"),
        Parameter(name="c_1", stated=60.0, std=20.0, path="columns.damping"),
        Parameter(name="c_2", stated=40.0, std=15.0, path="posts.damping"),
    ),
    starts=(
        Start("lower_0", 5e-4, "lower.position"),
        Start("upper_0", 5e-4, "upper.position"),
        Start("lower_speed_0", 5e-3, "lower.velocity"),
        Start("upper_speed_0", 5e-3, "upper.velocity"),
    ),
    channels=(
        Channel(name="lower", column="lower_mm", scale=1e3, output="lower.position", noise=2e-4, quantum=5e-5),
        Channel(name="upper", column="upper_mm", scale=1e3, output="upper.position", noise=2e-4, quantum=5e-5),
    ),
    drives=(
        Drive(name="table", column="table [g]", scale=1.0 / STANDARD_GRAVITY, unit="g_0", input="table.acceleration"),
    ),
    effects=(
        Effect(
            name="bouc_wen",
            strength="level",
            size=30.0,
            accept=("hysteresis@columns*", "hysteresis@lower*"),
            shape={"reach": (1e-3, 4e-3)},
            what="hysteresis of the columns after Bouc and Wen",
        ),
        Effect(
            name="softening",
            strength="softening",
            size=2e6,
            accept=("cubic_stiffness@columns*", "cubic_stiffness@lower*"),
            signed=True,
            what="columns' force k_3 x^3",
        ),
        Effect(
            name="cross",
            strength="cross",
            size=2e6,
            accept=("cubic_stiffness@posts*",),
            signed=True,
            what="posts' force k_3 x^3",
        ),
        Effect(
            name="joint",
            strength="rub",
            size=10.0,
            accept=("coulomb_friction@posts*",),
            what="dry friction between the storeys",
        ),
        sensor("upper", "upper.position", "gain", 0.02),
        actuator("table", "table.acceleration", "delay", 5e-3),
        Effect(
            name="damage",
            strength="damage",
            size=0.05,
            accept=("stiffness_drift@columns*",),
            what="stiffness that falls with the way travelled, and so with time",
        ),
        Effect(
            name="sway",
            strength="sway",
            size=2e5,
            signed=True,
            what="stiffness of the posts that depends on where the lower floor is",
        ),
    ),
    constants={"reach": 2e-3},
    places={"lower": 8.0, "upper": 8.0},
    dt=0.01,
    rows=1500,
    substeps=4,
    excite=_excite,
    start=_start,
    step=rk4(_rates),
    observe=_observe,
)
