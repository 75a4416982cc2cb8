"""Test signals for the recordings: smooth steps, and sums of sines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["sines", "smooth_steps"]

Array = NDArray[np.float64]


def smooth_steps(rng: np.random.Generator, t: Array, low: float, high: float, dwell: float, rise: float) -> Array:
    """Return levels between two bounds, held for about ``dwell`` seconds, with S-shaped changes of ``rise`` seconds."""
    edges = np.cumsum(rng.uniform(0.7, 1.3, int(2.0 * t[-1] / dwell) + 2) * dwell)
    levels = rng.uniform(low, high, edges.size + 1)
    signal = np.full(t.size, levels[0])
    for k, edge in enumerate(edges):
        part = np.clip((t - edge) / rise, 0.0, 1.0)
        signal += (levels[k + 1] - levels[k]) * part**3 * (10.0 - 15.0 * part + 6.0 * part**2)
    return signal


def sines(rng: np.random.Generator, t: Array, amplitude: float, low: float, high: float, count: int = 5) -> Array:
    """Return a sum of sines with logarithmically drawn frequencies (Hz), of root mean square ``amplitude / √2``."""
    frequencies = np.exp(rng.uniform(np.log(low), np.log(high), count))
    phases = rng.uniform(0.0, 2.0 * np.pi, count)
    weights = rng.dirichlet(np.full(count, 4.0)) ** 0.5
    return amplitude * (weights * np.sin(2.0 * np.pi * frequencies * t[:, None] + phases)).sum(axis=1)
