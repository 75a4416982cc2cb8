"""Two recordings of a motor whose winding also loses heat through the shaft to a brake, made by plain equations.

python record.py writes monday.csv and tuesday.csv beside it, as a logger rounds them: losses in W, temperatures in °C.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

WINDING, HOUSING, SLOT, SURFACE = 900.0, 5200.0, 6.5, 2.2  # J/K and W/K
SHAFT, BRAKE = 0.8, 20.0  # W/K and °C: through the rotor to a brake cooled by water, which is not in the model


def record(seed: int, duration: float = 14400.0) -> np.ndarray:
    """Return time in s, losses in W, and the temperatures of hall, winding and housing in °C, one column each."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, 10.0)
    loss = rng.uniform(0.0, 320.0, int(t[-1] / 1200.0) + 1)[(t / 1200.0).astype(int)]  # a duty for 20 minutes each
    hall = 22.0 + 3.0 * np.sin(2.0 * np.pi * t / 9000.0 + seed)

    def rates(now: float, x: np.ndarray) -> list[float]:
        outside = np.interp(now, t, hall)
        inward = SLOT * (x[0] - x[1])
        heat = loss[min(int(now / 10.0), t.size - 1)]
        winding = (heat - inward - SHAFT * (x[0] - BRAKE)) / WINDING
        return [winding, (inward - SURFACE * (x[1] - outside)) / HOUSING]

    x = [np.full(2, 25.0)]
    for k in range(t.size - 1):  # step by step, because the losses jump
        x.append(solve_ivp(rates, (t[k], t[k + 1] - 1e-6), x[-1], rtol=1e-8, atol=1e-8).y[:, -1])
    measured = np.array(x) + rng.normal(0.0, 0.1, (t.size, 2))
    return np.column_stack([t, np.round(loss, 1), np.round(hall, 2), np.round(measured, 1)])


if __name__ == "__main__":
    for seed, day in enumerate(("monday", "tuesday")):
        header = "time_s,losses [W],hall [°C],winding [°C],housing [°C]"
        path = Path(__file__).parent / f"{day}.csv"
        np.savetxt(path, record(seed), "%.9g", ",", header=header, comments="", encoding="utf-8")
