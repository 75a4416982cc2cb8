"""Misaligned guide rails: drawn from a spectrum, for each rail in both directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vtsdt.files.parameters import LiftParameters
from vtsdt.files.rail_profile import RailProfile

__all__ = ["RailSpectrum", "draw_rails", "rail_tables"]


@dataclass(frozen=True, kw_only=True)
class RailSpectrum:
    """Spectrum of the deviation of rails from straight.

    The deviation is a stationary Gaussian process over height with the spectrum of Matérn's class at ν = 3/2, flat
    below the wave number √3/length and falling with the fourth power above it, sampled every ``step``.

    Parameters
    ----------
    mean : float, m
        Mean deviation of the right rails towards the body; below twice the clearance the shoes hardly press.
    rms_x, rms_y : float, m
        Root mean square about the mean, in the plane of the rails and perpendicular to it.
    length : float, m
        Correlation length.
    step : float, m
        Between points.
    """

    mean: float = 2.1e-3
    rms_x: float = 0.35e-3
    rms_y: float = 0.25e-3
    length: float = 0.16
    step: float = 0.07


def draw_rails(parameters: LiftParameters, spectrum: RailSpectrum, rng: np.random.Generator) -> dict[str, RailProfile]:
    """Return a profile for each rail and direction, by ``"cabin.right_x"`` and so on.

    Deviations are clipped at 0.8 times the depth of the shoe's slot.

    Parameters
    ----------
    parameters : LiftParameters
        Height of the rails and depth of the slots.
    spectrum : RailSpectrum
    rng : Generator
    """
    hoistway = parameters.hoistway
    count = int(np.ceil((hoistway.rail_top - hoistway.rail_bottom) / spectrum.step)) + 1
    heights = np.linspace(hoistway.rail_bottom, hoistway.rail_top, count)
    distance = np.abs(heights[:, None] - heights[None, :]) * np.sqrt(3.0) / spectrum.length
    factor = np.linalg.cholesky((1.0 + distance) * np.exp(-distance) + 1e-9 * np.eye(count))
    profiles = {}
    for side in ("cabin", "counterweight"):
        gap = 0.8 * (parameters.cabin_guide if side == "cabin" else parameters.counterweight_guide).gap
        for name in ("left_x", "right_x", "left_y", "right_y"):
            size = spectrum.rms_x if name.endswith("x") else spectrum.rms_y
            mean = spectrum.mean if name == "right_x" else 0.0
            drawn = mean + size * (factor @ rng.standard_normal(count))
            profiles[f"{side}.{name}"] = RailProfile(
                tuple(map(float, np.round(heights, 6))),
                tuple(map(float, np.round(np.clip(drawn, -gap, gap), 8))),
            )
    return profiles


def rail_tables(profiles: dict[str, RailProfile]) -> dict[str, dict[str, list[float]]]:
    """Return profiles as tables of ``height_m`` and ``delta_mm``."""
    return {
        name: {"height_m": list(p.height), "delta_mm": [round(1e3 * d, 6) for d in p.deviation]}
        for name, p in profiles.items()
    }
