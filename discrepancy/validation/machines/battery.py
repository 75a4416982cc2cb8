"""A lithium cell: open-circuit voltage, two time constants, heat; discharge and charge at one row a second."""

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
A cell of 5 A h. The current is measured and is the input, positive when discharging; Q = 18000 C.

    ds/dt = -i / Q;   dv_1/dt = i / C_1 - v_1 / (R_1 C_1)
    v = 3.2 + 1.1 s - 0.5 s^2 + 0.35 s^3 - R_0 i - v_1
    C_T dT/dt = R_0 i^2 + v_1^2 / R_1 - H T        (T above the surroundings)
"""

MODEL = '''
"""Lithium cell."""

from multibody import Component, Input, Model, Output, Parameter, State


class Cell(Component):
    """Open-circuit voltage, ohmic and slow loss, temperature."""

    R_0 = Parameter(0.022, "ohm", "ohmic resistance", min=0.0)
    R_1 = Parameter(0.015, "ohm", "resistance of the slow loss", min=1e-9)
    C_1 = Parameter(2500.0, "F", "capacitance of the slow loss", min=1e-9)
    C_T = Parameter(75.0, "J/K", "heat capacity", min=1e-9)
    H = Parameter(0.12, "W/K", "conductance to the surroundings", min=0.0)
    current = Input("A", "current, positive when discharging")
    charge = State("", "state of charge", 0.7)
    slow = State("V", "slow loss")
    warmth = State("K", "temperature above the surroundings")
    voltage = Output("V", "terminal voltage")

    def equations(self):
        s = self.charge
        self.der.charge = -self.current / 18000.0
        self.der.slow = (self.current - self.slow / self.R_1) / self.C_1
        self.voltage = 3.2 + 1.1 * s - 0.5 * s**2 + 0.35 * s**3 - self.R_0 * self.current - self.slow
        self.der.warmth = (self.R_0 * self.current**2 + self.slow**2 / self.R_1 - self.H * self.warmth) / self.C_T


def build() -> Model:
    m = Model("battery")
    cell = m.add("cell", Cell())
    m.input("load.current", cell.current)
    return m
'''


def _excite(rng: np.random.Generator, t: Array) -> dict[str, Array]:
    return {"current": smooth_steps(rng, t, -6.0, 9.0, 90.0, 4.0) + sines(rng, t, 1.0, 0.005, 0.05)}


def _start(p: Any) -> list[Array]:
    zero = np.zeros_like(p.R_0)
    return [0.7 + p.charge_0, p.slow_0, p.warmth_0, zero]


def _rates(x: Array, u: Any, w: Any, p: Any) -> list[Array]:
    _, slow, warmth, lag = x
    i = u["current"] + w["load"]
    ohmic = p.R_0 * (1.0 - p.thaw * warmth)
    turn = -i / 18000.0
    return [
        turn,
        (i - slow / p.R_1) / p.C_1,
        (ohmic * i**2 + slow**2 / p.R_1 - p.H * warmth) / p.C_T,
        50.0 * (turn - np.abs(turn) * lag),
    ]


def _observe(x: Array, u: Any, p: Any) -> dict[str, Array]:
    s = x[0]
    rest = 3.2 + 1.1 * s - 0.5 * s**2 + 0.35 * s**3 + p.memory * x[3]
    voltage = rest - p.R_0 * (1.0 - p.thaw * x[2]) * u["current"] - x[1]
    return {"voltage": voltage, "warmth": x[2]}


MACHINE = Machine(
    name="battery",
    about=ABOUT,
    model=MODEL,
    parameters=(
        Parameter(name="R_0", stated=0.022, std=1.5e-3, path="cell.R_0"),
        Parameter(name="R_1", stated=0.015, std=2e-3, path="cell.R_1"),
        Parameter(name="C_1", stated=2500.0, std=250.0, path="cell.C_1"),
        Parameter(name="C_T", stated=75.0, std=4.0, path="cell.C_T"),
        Parameter(name="H", stated=0.12, std=0.02, path="cell.H"),
    ),
    starts=(
        Start("charge_0", 0.02, "cell.charge"),
        Start("slow_0", 2e-3, "cell.slow"),
        Start("warmth_0", 0.3, "cell.warmth"),
    ),
    channels=(
        Channel(name="voltage", column="cell_mV", scale=1e3, output="cell.voltage", noise=2e-3, quantum=1e-3),
        Channel(name="warmth", column="warmth [K]", output="cell.warmth", noise=0.05, quantum=0.02),
    ),
    drives=(Drive(name="current", column="load_A", input="load.current"),),
    effects=(
        sensor("voltage", "cell.voltage", "gain", 5e-3),
        sensor("voltage", "cell.voltage", "delay", 1.0),
        sensor("warmth", "cell.warmth", "drift", 1e-4),
        sensor("warmth", "cell.warmth", "gain", 0.05),
        actuator("current", "load.current", "offset", 0.1),
        actuator("current", "load.current", "gain", 0.03),
        Effect(name="thaw", strength="thaw", size=0.02, what="ohmic resistance that falls as the cell warms up"),
        Effect(
            name="memory",
            strength="memory",
            size=5e-3,
            what="open-circuit voltage that depends on the way it was reached",
        ),
    ),
    places={"load": 0.05},
    dt=1.0,
    rows=1000,
    substeps=2,
    excite=_excite,
    start=_start,
    step=rk4(_rates),
    observe=_observe,
)
