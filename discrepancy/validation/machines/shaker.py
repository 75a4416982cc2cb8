"""A voice-coil shaker: coil, moving mass and suspension, driven by a voltage; displacement in millimetres."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from discrepancy.validation.machines.excitation import sines, smooth_steps
from discrepancy.validation.machines.machine import Channel, Drive, Effect, Machine, Parameter, Start, actuator, sensor
from discrepancy.validation.machines.simulate import rk4

__all__ = ["MACHINE"]

Array = NDArray[np.float64]

ABOUT = """
A coil in a radial magnetic field moves a table on leaf springs. The voltage is prescribed, linear between rows.

    L di/dt = V - R i - K v
    m dv/dt = K i - c v - k x,   dx/dt = v

A laser reads the displacement in mm, a shunt the current.
"""

MODEL = '''
"""Voice-coil shaker."""

from multibody import Component, Input, Model, Parameter, State, Translation
from multibody.library import Mass, SpringDamper


class VoiceCoil(Component):
    """L · rate of current = voltage - R · current - K · velocity; force = K · current."""

    R = Parameter(3.2, "ohm", "resistance", min=1e-9)
    L = Parameter(4e-3, "H", "inductance", min=1e-9)
    K = Parameter(18.0, "N/A", "force constant")
    voltage = Input("V", "voltage on the coil")
    current = State("A", "current")
    rod = Translation("coil")

    def equations(self):
        self.der.current = (self.voltage - self.R * self.current - self.K * self.rod.velocity) / self.L
        self.rod.force = self.K * self.current


def build() -> Model:
    m = Model("shaker")
    coil = m.add("coil", VoiceCoil())
    table = m.add("table", Mass(m=1.4))
    springs = m.add("springs", SpringDamper(stiffness=5200.0, damping=6.0))
    m.connect(coil.rod, table.flange, springs.b)
    m.connect(springs.a, m.ground)
    m.input("amplifier.voltage", coil.voltage)
    return m
'''


def _excite(rng: np.random.Generator, t: Array) -> dict[str, Array]:
    return {"voltage": smooth_steps(rng, t, -8.0, 8.0, 0.5, 0.05) + sines(rng, t, 9.0, 2.0, 40.0)}


def _start(p: Any) -> list[Array]:
    return [p.current_0, p.place_0, p.speed_0, np.zeros_like(p.m)]


def _rates(x: Array, u: Any, w: Any, p: Any) -> list[Array]:
    i, s, v, yielding = x
    field = p.K * (1.0 - p.fading * s**2)
    spring = p.k * s + p.hardening * s**3 + p.level * yielding
    rub = p.coulomb * np.tanh(v / 2e-3)
    slip = (v - np.abs(v) * yielding) / p.reach
    return [
        (u["voltage"] - p.R * i - field * v) / p.L,
        v,
        (field * i + w["table"] - p.c * v - spring - rub) / p.m,
        slip,
    ]


def _observe(x: Array, u: Any, p: Any) -> dict[str, Array]:
    return {"current": x[0], "place": x[1]}


MACHINE = Machine(
    name="shaker",
    about=ABOUT,
    model=MODEL,
    parameters=(
        Parameter(name="R", stated=3.2, std=0.1, path="coil.R"),
        Parameter(name="L", stated=4e-3, std=4e-4, path="coil.L"),
        Parameter(name="K", stated=18.0, std=0.4, path="coil.K"),
        Parameter(name="m", stated=1.4, std=0.03, path="table.m"),
        Parameter(name="c", stated=6.0, std=2.0, path="springs.damping"),
        Parameter(name="k", stated=5200.0, std=150.0, path="springs.stiffness"),
    ),
    starts=(
        Start("current_0", 0.1, "coil.current"),
        Start("place_0", 5e-4, "table.position"),
        Start("speed_0", 0.02, "table.velocity"),
    ),
    channels=(
        Channel(name="current", column="current_mA", scale=1e3, output="coil.current", noise=8e-3, quantum=5e-3),
        Channel(name="place", column="table_mm", scale=1e3, output="table.position", noise=2e-5, quantum=1e-5),
    ),
    drives=(Drive(name="voltage", column="voltage_V", input="amplifier.voltage"),),
    effects=(
        Effect(
            name="hardening",
            strength="hardening",
            size=1e7,
            accept=("cubic_stiffness@springs*", "cubic_stiffness@table*"),
            signed=True,
            what="spring force k_3 x^3",
        ),
        Effect(
            name="dahl",
            strength="level",
            size=1.0,
            accept=("hysteresis@*", "coulomb_friction@*"),  # that gives way is the same law
            shape={"reach": (3e-4, 1e-3)},
            what="friction after Dahl, elastic over a fraction of a millimetre",
        ),
        Effect(name="rub", strength="coulomb", size=0.5, accept=("coulomb_friction@*",), what="dry friction"),
        sensor("current", "coil.current", "gain", 0.02),
        sensor("place", "table.position", "delay", 1e-3),
        actuator("voltage", "amplifier.voltage", "delay", 1e-3),
        Effect(
            name="fading", strength="fading", size=2e3, what="force constant that falls with the square of the place"
        ),
    ),
    constants={"reach": 5e-4},
    places={"table": 0.3},
    dt=2e-3,
    rows=1500,
    substeps=5,
    excite=_excite,
    start=_start,
    step=rk4(_rates),
    observe=_observe,
)
