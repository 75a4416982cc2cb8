"""A buck converter, averaged over its switching: coil, capacitor and load; microseconds, amperes and millivolts."""

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
A half bridge feeds a coil and a capacitor with a load. The recorded input is the mean voltage of the bridge.

    L di/dt = v_bridge - R i - v
    C dv/dt = i - v / R_load
"""

MODEL = '''
"""Buck converter, averaged."""

from multibody import Model
from multibody.library import Capacitor, Inductor, Resistor, VoltageSource


def build() -> Model:
    m = Model("converter")
    bridge = m.add("bridge", VoltageSource())
    wire = m.add("wire", Resistor(R=0.12))
    coil = m.add("coil", Inductor(L=1e-4))
    filter = m.add("filter", Capacitor(C=2.2e-4))
    load = m.add("load", Resistor(R=2.0))
    m.connect(bridge.p, wire.p)
    m.connect(wire.n, coil.p)
    m.connect(coil.n, filter.p, load.p)
    m.connect(bridge.n, filter.n, load.n, m.ground)
    m.input("bridge.voltage", bridge.voltage)
    return m
'''


def _excite(rng: np.random.Generator, t: Array) -> dict[str, Array]:
    return {"bridge": smooth_steps(rng, t, 3.0, 12.0, 3e-3, 2e-4) + sines(rng, t, 1.0, 100.0, 2000.0)}


def _start(p: Any) -> list[Array]:
    return [p.current_0, p.voltage_0]


def _rates(x: Array, u: Any, w: Any, p: Any) -> list[Array]:
    i, v = x
    coil = p.L / (1.0 + p.saturation * i**2)
    drop = p.R * i + p.diode * np.tanh(i / 0.05)
    return [(u["bridge"] + w["supply"] - drop - v) / coil, (i - v / p.R_load * (1.0 + p.lamp * v) + w["load"]) / p.C]


def _observe(x: Array, u: Any, p: Any) -> dict[str, Array]:
    return {"current": x[0], "voltage": x[1]}


MACHINE = Machine(
    name="converter",
    about=ABOUT,
    model=MODEL,
    parameters=(
        Parameter(name="R", stated=0.12, std=0.015, path="wire.R"),
        Parameter(name="L", stated=1e-4, std=8e-6, path="coil.L"),
        Parameter(name="C", stated=2.2e-4, std=1.5e-5, path="filter.C"),
        Parameter(name="R_load", stated=2.0, std=0.04, path="load.R"),
    ),
    starts=(Start("current_0", 0.1, "coil.current"), Start("voltage_0", 0.1, "filter.voltage")),
    channels=(
        Channel(name="current", column="coil_A", output="coil.current", noise=0.03, quantum=0.02),
        Channel(name="voltage", column="load_mV", scale=1e3, output="filter.voltage", noise=0.02, quantum=5e-3),
    ),
    drives=(Drive(name="bridge", column="bridge_V", input="bridge.voltage"),),
    effects=(
        sensor("current", "coil.current", "gain", 0.02),
        sensor("current", "coil.current", "offset", 0.05),
        sensor("voltage", "filter.voltage", "delay", 2e-5),
        actuator("bridge", "bridge.voltage", "delay", 2e-5),
        actuator("bridge", "bridge.voltage", "gain", 0.03),
        Effect(name="saturation", strength="saturation", size=2e-3, what="a coil that saturates with the current"),
        Effect(name="lamp", strength="lamp", size=0.01, what="a load whose conductance grows with the voltage"),
    ),
    constants={"diode": 0.0},
    places={"supply": 0.05, "load": 0.02},
    dt=2e-5,
    rows=1200,
    substeps=2,
    excite=_excite,
    start=_start,
    step=rk4(_rates),
    observe=_observe,
)
