"""The deviation of a guide rail over height."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from multibody.base.units import UnitError, convert

__all__ = ["RailProfile", "read_profile"]

_REFINEMENT = 8  # intervals for one, where a profile is clipped
_KINK = 3e-4  # m: distance of the points next to a kink


@dataclass(frozen=True)
class RailProfile:
    """A rail's deviation over height, shape-preserving cubic between points, constant beyond them.

    Parameters
    ----------
    height, deviation : tuple of float, m
    """

    height: tuple[float, ...]
    deviation: tuple[float, ...]

    def clipped(self, largest: float) -> RailProfile:
        """Return the profile with deviations above ``largest`` (m) straightened to it.

        The curve itself is clipped, not only its points, so the result has more points.
        """
        if max(self.deviation) <= largest:
            return self
        known = np.array(self.height)
        parts = [np.linspace(a, b, _REFINEMENT, endpoint=False) for a, b in itertools.pairwise(known)]
        fine = np.concatenate([*parts, known[-1:]])
        values = np.array([self.at(h) for h in fine])
        passed = np.flatnonzero((values[1:] > largest) != (values[:-1] > largest))
        crossings = [_crossing(self, fine[k], fine[k + 1], largest) for k in passed]
        # points close to a kink keep the cubic from rounding it off
        heights = np.unique(np.concatenate([fine, *([c - _KINK, c, c + _KINK] for c in crossings)]))
        return RailProfile(tuple(map(float, heights)), tuple(min(self.at(h), largest) for h in heights))

    def resampled(self, heights: tuple[float, ...]) -> RailProfile:
        """Return the curve through its own values at other heights."""
        return RailProfile(tuple(heights), tuple(self.at(h) for h in heights))

    def at(self, height: float) -> float:
        """Return the deviation at a height, m.

        Examples
        --------
        >>> RailProfile((0.0, 1.0, 2.0), (0.0, 1e-3, 0.0)).at(1.0)
        0.001
        """
        from multibody.equations.tables import cubic, packed

        points = packed(np.array(self.height), np.array(self.deviation), "cubic")
        return float(cubic(points, 0, len(self.height), height))


def _crossing(profile: RailProfile, low: float, high: float, level: float) -> float:
    """Return where a profile passes a level between two heights on its two sides."""
    rising = profile.at(high) > level
    for _ in range(60):
        middle = 0.5 * (low + high)
        if (profile.at(middle) > level) == rising:
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)


def read_profile(given: Any, where: str, faults: list[str]) -> RailProfile | None:
    """Return the profile of a section of a parameter file, or None for a straight rail; faults are added to a list."""
    if given is False:  # a file that extends another one says that its rail is straight
        return None
    if not isinstance(given, Mapping) or not {"height", "deviation"} <= set(given):
        faults.append(f"{where} needs 'height' and 'deviation' (two lists of the same length)")
        return None
    faults += [f"{where} has no entry '{k}'" for k in given if k not in ("height", "deviation", "unit")]
    try:
        height = np.array(given["height"], dtype=float)
        deviation = np.array(given["deviation"], dtype=float) * convert(1.0, given.get("unit", "m"), "m")
    except (TypeError, ValueError, UnitError) as error:
        faults.append(f"{where}: {error}")
        return None
    if height.ndim != 1 or height.shape != deviation.shape or height.size < 2:
        faults.append(f"{where} needs at least two points, as many heights as deviations")
    elif not (np.all(np.isfinite(height)) and np.all(np.isfinite(deviation))):
        faults.append(f"{where} has values that are not finite")
    elif not np.all(np.diff(height) > 0):
        k = int(np.argmax(np.diff(height) <= 0)) + 1
        faults.append(f"{where}: heights must increase, but {height[k]:g} m follows {height[k - 1]:g} m")
    else:
        return RailProfile(tuple(map(float, height)), tuple(map(float, deviation)))
    return None
