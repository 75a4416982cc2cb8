"""An analytic stand-in for a gear stage: mesh lines whose amplitudes follow from a contact stiffness, closed form.

Each mesh order is a force through one resonance.  K and e_F act through the working stiffness, C_D through damping, and
E, ρ and D_P hardly at all, so that what the chain has to find is known without any simulation.
"""

from __future__ import annotations

import numpy as np

from gearbox.files.operating_condition import OperatingCondition
from gearbox.signals.signal import Signal

TEETH = 32
RATE = 25_600.0
START = {"K": 8.6e5, "C_D": 86.0, "e_F": 2.0, "D_P": 0.1, "E": 210.0, "rho": 7800.0}
RANGES = {
    "K": (4.3e5, 12.9e5, "N/mm^e"),
    "C_D": (86.0, 860.0, "N s/mm"),
    "e_F": (1.5, 2.5, ""),
    "D_P": (0.05, 0.15, "mm"),
    "E": (179.0, 242.0, "GPa"),
    "rho": (6600.0, 9000.0, "kg/m^3"),
}


def lines(values, condition, sensor=0):
    """Complex amplitudes of mesh orders 1 to 4 at a sensor."""
    K, C_D, e, D_P, E, rho = (values[n] for n in ("K", "C_D", "e_F", "D_P", "E", "rho"))
    force = condition.load_Nm / 0.078
    deflection = (force / K) ** (1.0 / e)  # mm
    stiffness = e * K * deflection ** (e - 1.0)  # N/mm, the working stiffness
    f = condition.mesh_frequency(TEETH)
    found = []
    for k in range(1, 5):
        resonance = (700.0 + 450.0 * sensor) * np.sqrt(stiffness / 4.0e4) * (1.0 + 1e-3 * (E / 210.0 - rho / 7800.0))
        damping = 0.05 + 0.25 * (C_D / 860.0) * (0.1 / max(D_P, 0.1)) ** 0.1
        ratio = k * f / resonance
        found.append(force * (0.3 + 0.1 / k) / (1.0 - ratio**2 + 2j * damping * ratio) * np.exp(0.7j * k * k) / k**2)
    return np.array(found)


def stand_in(values, condition: OperatingCondition, duration: float):
    """Settled signals of two sensors, ``duration`` s long."""
    if values["K"] < 0:
        raise ValueError("no equilibrium")
    t = np.arange(round(duration * RATE)) / RATE
    f = condition.mesh_frequency(TEETH)
    signals = {}
    for number, name in enumerate(("seat", "base")):
        a = lines(values, condition, number)
        y = sum((each * np.exp(2j * np.pi * (k + 1) * f * t)).real for k, each in enumerate(a))
        signals[name] = Signal(y / 1e3, RATE, name=name, unit="m/s**2")
    return signals


def load(argument: str):
    """What a process imports."""
    assert argument == "stand-in"
    return stand_in


def measured(values, condition, *, seed=0, noise=0.0, sidebands=0.0, shift=0.0137, duration=1.0, name=""):
    """A recording of the stand-in with true values: another zero of time, noise, and sidebands at the output shaft."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(duration * RATE)) / RATE
    f = condition.mesh_frequency(TEETH)
    signals = {}
    for number, sensor in enumerate(("seat", "base")):
        a = lines(values, condition, number)
        y = np.zeros(t.size)
        for k, each in enumerate(a, start=1):
            swing = 1.0 + sidebands * np.cos(2 * np.pi * f / 44.0 * (t + shift) + 0.3 * k)
            y += swing * (each * np.exp(2j * np.pi * k * f * (t + shift))).real
        y /= 1e3
        y += noise * np.std(y) * rng.standard_normal(t.size)
        signals[sensor] = Signal(y, RATE, name=sensor, unit="m/s**2")
    return OperatingCondition(condition.speed_rpm, condition.load_Nm, name), signals
