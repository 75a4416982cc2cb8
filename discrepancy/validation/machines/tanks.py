"""Two water tanks in a row, emptied through orifices (Torricelli); litres a minute, centimetres."""

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
A pump fills the upper tank; it drains into the lower one, and that into the sump. A = 0.02 m^2 each.

    A dh_1/dt = q - a_1 sqrt(2 g h_1)
    A dh_2/dt = a_1 sqrt(2 g h_1) - a_2 sqrt(2 g h_2)
"""

MODEL = '''
"""Two tanks in a row."""

import math

from multibody import Component, Input, Model, Parameter, State


class Tanks(Component):
    """Two tanks with orifices in their floors."""

    area = Parameter(0.02, "m**2", "area of each tank", min=1e-9)
    a_1 = Parameter(6e-5, "m**2", "orifice of the upper tank", min=0.0)
    a_2 = Parameter(6.5e-5, "m**2", "orifice of the lower tank", min=0.0)
    flow = Input("m**3/s", "flow of the pump")
    upper = State("m", "level of the upper tank", 0.25)
    lower = State("m", "level of the lower tank", 0.2)

    def equations(self):
        first = self.a_1 * math.sqrt(19.62 * max(self.upper, 1e-6))
        second = self.a_2 * math.sqrt(19.62 * max(self.lower, 1e-6))
        self.der.upper = (self.flow - first) / self.area
        self.der.lower = (first - second) / self.area


def build() -> Model:
    m = Model("tanks")
    tanks = m.add("tanks", Tanks())
    m.input("pump.flow", tanks.flow)
    return m
'''


def _excite(rng: np.random.Generator, t: Array) -> dict[str, Array]:
    return {"flow": smooth_steps(rng, t, 0.8e-4, 1.7e-4, 150.0, 5.0)}


def _start(p: Any) -> list[Array]:
    return [0.25 + p.upper_0, 0.2 + p.lower_0]


def _rates(x: Array, u: Any, w: Any, p: Any) -> list[Array]:
    upper, lower = np.maximum(x, 1e-6)
    first = p.a_1 * np.sqrt(19.62 * upper)
    second = p.a_2 * np.sqrt(19.62 * lower) * (1.0 - p.vortex * np.exp(-lower / 0.05))
    leak = p.leak * upper
    return [(u["flow"] + w["pump"] - first - leak) / 0.02, (first - second + w["rain"]) / 0.02]


def _observe(x: Array, u: Any, p: Any) -> dict[str, Array]:
    return {"upper": x[0], "lower": x[1]}


MACHINE = Machine(
    name="tanks",
    about=ABOUT,
    model=MODEL,
    parameters=(
        Parameter(name="a_1", stated=6e-5, std=1.5e-6, path="tanks.a_1"),
        Parameter(name="a_2", stated=6.5e-5, std=1.5e-6, path="tanks.a_2"),
    ),
    starts=(Start("upper_0", 0.01, "tanks.upper"), Start("lower_0", 0.01, "tanks.lower")),
    channels=(
        Channel(name="upper", column="upper_cm", scale=100.0, output="tanks.upper", noise=1e-3, quantum=5e-4),
        Channel(name="lower", column="lower_cm", scale=100.0, output="tanks.lower", noise=1e-3, quantum=5e-4),
    ),
    drives=(Drive(name="flow", column="pump [l/min]", scale=60000.0, input="pump.flow"),),
    effects=(
        sensor("upper", "tanks.upper", "offset", 5e-3),
        sensor("lower", "tanks.lower", "gain", 0.03),
        sensor("lower", "tanks.lower", "drift", 1e-5),
        sensor("lower", "tanks.lower", "delay", 3.0),
        actuator("flow", "pump.flow", "gain", 0.03),
        actuator("flow", "pump.flow", "delay", 3.0),
        Effect(name="leak", strength="leak", size=2e-5, what="a crack in the upper tank, in proportion to its level"),
        Effect(name="vortex", strength="vortex", size=0.3, what="a vortex that draws air at low level"),
    ),
    places={"pump": 1e-6, "rain": 1e-6},
    dt=1.0,
    rows=1000,
    substeps=2,
    excite=_excite,
    start=_start,
    step=rk4(_rates),
    observe=_observe,
)
