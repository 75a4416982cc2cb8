"""Two recordings of a clamp whose piston seal leaks, made by plain equations: no part of the package is asked.

python record.py writes monday.csv and tuesday.csv beside it, as a logger rounds them: pump flow in l/min, pressure in
bar, way in mm.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

AREA, CAPACITY, MASS, VISCOUS, STIFFNESS = 5e-4, 4e-13, 8.0, 2000.0, 2e5
LEAK = 2.5e-13  # m**3/(s*Pa): 0.15 l/min at 100 bar


def asked_way(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Levels between 3 and 25 mm, each held for 0.8 s and left within 0.2 s."""
    levels = rng.uniform(3e-3, 25e-3, int(t[-1] / 0.8) + 2)
    width = round(0.2 / (t[1] - t[0]))
    held = levels[(t / 0.8).astype(int)]
    for _ in range(2):
        held = np.convolve(np.pad(held, width, mode="edge"), np.ones(width) / width, mode="same")[width:-width]
    return held


def record(seed: int, duration: float = 8.0) -> np.ndarray:
    """Return time in s, flow in l/min, pressure in bar and way in mm, one column each."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, 2e-3)
    way = asked_way(t, rng)
    flow = AREA * np.gradient(way, t) + LEAK * way * STIFFNESS / AREA  # the operator holds the jaw where it is

    def rates(now: float, x: np.ndarray) -> list[float]:
        pressure, place, speed = x
        oil = np.interp(now, t, flow) - AREA * speed - LEAK * pressure
        force = AREA * pressure - STIFFNESS * place - VISCOUS * speed
        return [oil / CAPACITY, speed, force / MASS]

    start = [STIFFNESS * way[0] / AREA, way[0], 0.0]
    pressure, place, _ = solve_ivp(rates, (0.0, t[-1]), start, "LSODA", t, rtol=1e-9, atol=1e-9, max_step=5e-3).y
    return np.column_stack(
        [
            t,
            np.round(6e4 * flow, 5),
            np.round(1e-5 * pressure + rng.normal(0.0, 0.1, t.size), 2),
            np.round(1e3 * place + rng.normal(0.0, 5e-3, t.size), 3),
        ]
    )


if __name__ == "__main__":
    for seed, day in enumerate(("monday", "tuesday")):
        header = "time_s,pump flow [l/min],pressure [bar],way [mm]"
        path = Path(__file__).parent / f"{day}.csv"
        np.savetxt(path, record(seed), "%.9g", ",", header=header, comments="")
