"""A stirred tank with an immersion heater: two heat capacities, hours of record, power in kilowatts."""

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
An immersion heater of capacity C_h heats stirred water of capacity C_w. Temperatures are above the surroundings.

    C_h dT_h/dt = P - G (T_h - T_w)
    C_w dT_w/dt = G (T_h - T_w) - H T_w
"""

MODEL = '''
"""Stirred tank with an immersion heater."""

from multibody import Component, Input, Model, Parameter, State


class Tank(Component):
    """Heater and water, each with a heat capacity; the surroundings are at zero."""

    C_h = Parameter(2500.0, "J/K", "heat capacity of the heater", min=1e-9)
    C_w = Parameter(60000.0, "J/K", "heat capacity of the water", min=1e-9)
    G = Parameter(45.0, "W/K", "conductance from heater to water", min=0.0)
    H = Parameter(12.0, "W/K", "conductance from water to the surroundings", min=0.0)
    power = Input("W", "electrical power")
    heater = State("K", "temperature of the heater", 20.0)
    water = State("K", "temperature of the water", 20.0)

    def equations(self):
        passed = self.G * (self.heater - self.water)
        self.der.heater = (self.power - passed) / self.C_h
        self.der.water = (passed - self.H * self.water) / self.C_w


def build() -> Model:
    m = Model("tank")
    tank = m.add("tank", Tank())
    m.input("heater.power", tank.power)
    return m
'''


def _excite(rng: np.random.Generator, t: Array) -> dict[str, Array]:
    return {"power": np.maximum(smooth_steps(rng, t, 0.0, 1000.0, 700.0, 20.0), 0.0)}


def _start(p: Any) -> list[Array]:
    return [20.0 + p.heater_0, 20.0 + p.water_0]


def _rates(x: Array, u: Any, w: Any, p: Any) -> list[Array]:
    heater, water = x
    passed = p.G * (heater - water) * (1.0 + p.boiling * np.maximum(heater - water, 0.0))
    steam = p.steam * np.maximum(water, 0.0) ** 3
    return [(u["power"] - passed) / p.C_h, (passed - p.H * water - steam + w["water"]) / p.C_w]


def _observe(x: Array, u: Any, p: Any) -> dict[str, Array]:
    return {"heater": x[0], "water": x[1]}


MACHINE = Machine(
    name="heated_tank",
    about=ABOUT,
    model=MODEL,
    parameters=(
        Parameter(name="C_h", stated=2500.0, std=150.0, path="tank.C_h"),
        Parameter(name="C_w", stated=60000.0, std=1500.0, path="tank.C_w"),
        Parameter(name="G", stated=45.0, std=3.0, path="tank.G"),
        Parameter(name="H", stated=12.0, std=1.0, path="tank.H"),
    ),
    starts=(Start("heater_0", 1.0, "tank.heater"), Start("water_0", 1.0, "tank.water")),
    channels=(
        Channel(name="heater", column="heater [K]", output="tank.heater", noise=0.15, quantum=0.1),
        Channel(name="water", column="water [K]", output="tank.water", noise=0.05, quantum=0.02),
    ),
    drives=(Drive(name="power", column="power_kW", scale=1e-3, input="heater.power", hold=True),),
    effects=(
        sensor("heater", "tank.heater", "offset", 0.5),
        sensor("heater", "tank.heater", "gain", 0.02),
        sensor("water", "tank.water", "delay", 20.0),
        sensor("water", "tank.water", "drift", 1e-4),
        actuator("power", "heater.power", "gain", 0.03),
        actuator("power", "heater.power", "offset", 20.0),
        Effect(name="steam", strength="steam", size=1e-3, what="loss by evaporation, with the cube of the temperature"),
        Effect(name="boiling", strength="boiling", size=5e-3, what="better heat transfer at a larger difference"),
    ),
    places={"water": 8.0},
    dt=5.0,
    rows=1000,
    substeps=2,
    excite=_excite,
    start=_start,
    step=rk4(_rates),
    observe=_observe,
)
