"""What straightening and lubricating would save, and how certain that is.

González et al. 2020, section IV-D: the reference model with the estimated profile of the rail is simulated as it is,
with deviations above a threshold reduced to it, with less friction, and with both.  Beyond the paper, uncertain
parameters and the error of the profile are drawn, the same for all actions, so that every value has an interval.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from multibody.base.progress import Progress, Step, silent
from vtsdt.files.parameters import LiftParameters
from vtsdt.files.rail_profile import RailProfile
from vtsdt.files.rail_profile_table import ProfileTable
from vtsdt.lift.energy import TripEnergy
from vtsdt.whatif.result import Action, SectionSaving, WhatIf
from vtsdt.whatif.runs import TripRunner, Variant

__all__ = ["Uncertainty", "default_uncertainties", "what_if"]

ACTIONS = ("original", "straightened", "lubrication", "both")
#: Distance of the points of drawn rails, m.
GRID = 0.02
#: Correlation length of the error of an estimated profile, m.
ERROR_LENGTH = 0.1


@dataclass(frozen=True)
class Uncertainty:
    """The uncertainty of a parameter.

    Parameters
    ----------
    name : str
        Of a model parameter, ``"*.mu"`` for the same parameter of both guides, or ``"lubrication"``.
    std : float
        Standard deviation.
    relative : bool
        True if ``std`` is a share of the value.
    """

    name: str
    std: float
    relative: bool = True

    def __post_init__(self) -> None:
        if not 0.0 <= self.std <= (1.0 if self.relative else math.inf) or math.isinf(self.std):
            allowed = "a share from 0 to 1" if self.relative else "a standard deviation of zero or more"
            raise ValueError(f"'{self.name}' = {self.std:g}: give {allowed}")

    def names(self) -> tuple[str, ...]:
        """Return the model parameters that vary together."""
        if self.name.startswith("*."):
            return tuple(f"{side}_guide.{self.name[2:]}" for side in ("cabin", "counterweight"))
        return () if self.name == "lubrication" else (self.name,)


def default_uncertainties() -> tuple[Uncertainty, ...]:
    """Return uncertainties of a lift's guides and masses: this project's own assumptions, to be replaced.

    Friction 10 %, contact stiffness 10 %, contact damping 20 %, clearance 5 %, masses of cabin and counterweight 0.5 %,
    effect of lubrication ± 0.03 of the friction.
    """
    return (
        Uncertainty("*.mu", 0.10),
        Uncertainty("*.stiffness", 0.10),
        Uncertainty("*.damping", 0.20),
        Uncertainty("*.clearance", 0.05),
        Uncertainty("cabin.mass", 0.005),
        Uncertainty("counterweight.mass", 0.005),
        Uncertainty("lubrication", 0.03, relative=False),
    )


def what_if(
    parameters: LiftParameters | None = None,
    rail: ProfileTable | None = None,
    *,
    threshold: float = 2.3e-3,
    lubrication: float = 0.9,
    uncertainties: Sequence[Uncertainty] | None = None,
    samples: int = 40,
    sections: bool = True,
    direction: str = "up",
    seed: int = 0,
    progress: Progress = silent,
) -> WhatIf:
    """Return the energies of a trip as it is, straightened, lubricated and both, with intervals.

    Parameters
    ----------
    parameters : LiftParameters, optional
        Default: the shipped bench.
    rail : ProfileTable, optional
        Estimated deviation of the cabin's right rail; default: that of the parameters.
    threshold : float, m
        Deviations above it are reduced to it.  Only the cabin's rail is straightened, as on the paper's bench.
    lubrication : float
        Factor on the friction coefficients of cabin and counterweight.
    uncertainties : sequence of Uncertainty, optional
        Default: `default_uncertainties`.
    samples : int
        Draws; 0 for the nominal values alone.
    sections : bool
        Also straighten each section above the threshold alone.
    direction : {"up", "down"}
    seed : int
    progress : callable, optional

    Raises
    ------
    ValueError
        With every impossible setting.
    SimulationError
        If the simulation of a drawn lift fails.
    """
    given = parameters if parameters is not None else LiftParameters.bench()
    if rail is None:
        own = given.cabin_guide.right_x
        if own is None:
            raise ValueError("the lift's right rail is straight: give an estimated profile")
        rail = ProfileTable.of(own)
    uncertainties = default_uncertainties() if uncertainties is None else tuple(uncertainties)
    faults = _faults(threshold, lubrication, samples, rail, given)
    if faults:
        raise ValueError("; ".join(faults))
    grid = _heights(rail, threshold, given)
    runner = TripRunner(given, grid, direction)
    base = _values(runner, uncertainties)
    ranges, nominal = rail.beyond(threshold), np.array([rail.profile.at(h) for h in grid])
    rng = np.random.default_rng(seed)
    runs: list[Variant] = []
    drawn: list[dict[str, float]] = []
    for k in range(samples + 1):
        shift = {d.name: 0.0 if k == 0 else float(rng.standard_normal()) for d in uncertainties}
        error = np.zeros(grid.size) if k == 0 else _rail_error(grid, rail, rng)
        as_is = RailProfile(tuple(map(float, grid)), tuple(map(float, nominal + error)))
        known = {n: _drawn(base[n], d, shift[d.name]) for d in uncertainties for n in d.names()}
        factors = [_drawn(lubrication, d, shift[d.name]) for d in uncertainties if d.name == "lubrication"]
        factor = factors[0] if factors else lubrication
        lubricated = {**known, **{n: factor * known.get(n, base[n]) for n in _MU}}
        straight = _cut(as_is, threshold, [(grid[0], grid[-1])])
        runs += [Variant(profile, values) for values in (known, lubricated) for profile in (as_is, straight)]
        if sections:
            runs += [Variant(_cut(as_is, threshold, [r]), known) for r in ranges]
        drawn.append({**known, "lubrication": factor})
    progress(f"compile the reference model for rails of {grid.size} points")
    energies: list[TripEnergy] = []
    for done, trip in enumerate(runner.run(runs), 1):
        energies.append(trip.energy)
        if done % 8 == 0 or done == len(runs):
            progress(Step(f"trip {done} of {len(runs)}", done, len(runs)))
    width = 4 + (len(ranges) if sections else 0)
    table = [energies[k : k + width] for k in range(0, len(energies), width)]
    actions = tuple(Action(name, table[0][k], tuple(row[k] for row in table[1:])) for k, name in enumerate(ACTIONS))
    savings = tuple(
        _section_saving(r, rail, threshold, [(row[0], row[4 + k]) for row in table])
        for k, r in enumerate(ranges if sections else [])
    )
    return WhatIf(
        actions=actions,
        sections=savings,
        rail=rail,
        threshold=threshold,
        lubrication=lubrication,
        direction=direction,
        uncertainties=tuple(uncertainty_texts(uncertainties)),
        drawn=tuple(drawn[1:]),
        seed=seed,
    )


_MU = ("cabin_guide.mu", "counterweight_guide.mu")


def uncertainty_texts(uncertainties: Sequence[Uncertainty]) -> list[tuple[str, str]]:
    """Return name and size of each doubt as text."""
    return [(d.name, f"{100 * d.std:g} %" if d.relative else f"{d.std:g}") for d in uncertainties]


def _faults(threshold: float, lubrication: float, samples: int, rail: ProfileTable, lift: LiftParameters) -> list[str]:
    faults = []
    if not 0.0 < threshold < 0.05:
        faults.append(f"the threshold is {threshold:g} m: give metres, such as 2.3e-3")
    if not 0.0 < lubrication <= 1.5:
        faults.append(f"lubrication is {lubrication:g}: give the factor on the friction, such as 0.9")
    if samples < 0:
        faults.append(f"samples is {samples}: give zero or more")
    gap = lift.cabin_guide.gap
    if np.abs(rail.delta).max() > gap:
        faults.append(
            f"the rail deviates by {1e3 * np.abs(rail.delta).max():.2f} mm, more than the shoe's gap of "
            f"{1e3 * gap:g} mm"
        )
    return faults


def _heights(rail: ProfileTable, threshold: float, lift: LiftParameters) -> np.ndarray:
    """Return the heights of the points of all rails: those of the table, a grid, and points close to the kinks."""
    low = min(lift.hoistway.rail_bottom, float(rail.height[0]))
    high = max(lift.hoistway.rail_top, float(rail.height[-1]))
    cut = rail.profile.clipped(threshold)
    even = np.linspace(low, high, math.ceil((high - low) / GRID) + 1)
    return np.unique(np.round(np.concatenate([rail.height, np.array(cut.height), even]), 7))


def _values(runner: TripRunner, uncertainties: Sequence[Uncertainty]) -> dict[str, float]:
    system = runner.system
    names = [*dict.fromkeys([*_MU, *(n for d in uncertainties for n in d.names())])]
    unknown = [n for n in names if n not in system.parameter_names]
    if unknown:
        from multibody.base.spelling import nearest

        raise ValueError("; ".join(f"there is no parameter '{n}'{nearest(n, system.parameter_names)}" for n in unknown))
    return {n: float(system.p[system.index("parameter", n)]) for n in names}


def _drawn(value: float, uncertainty: Uncertainty, shift: float) -> float:
    """Return a drawn value; where the sign would change, a twentieth of the nominal one."""
    drawn = value + uncertainty.std * (value if uncertainty.relative else 1.0) * shift
    return max(drawn, 0.05 * value) if value > 0.0 else drawn


def _rail_error(grid: np.ndarray, rail: ProfileTable, rng: np.random.Generator) -> np.ndarray:
    spread = np.interp(grid, rail.height, rail.spread)
    if not np.any(spread > 0.0):
        return np.zeros(grid.size)
    distance = (grid[:, None] - grid[None, :]) / ERROR_LENGTH
    factor = np.linalg.cholesky(np.exp(-0.5 * distance**2) + 1e-8 * np.eye(grid.size))
    return np.asarray(spread * (factor @ rng.standard_normal(grid.size)))


def _cut(profile: RailProfile, level: float, ranges: Sequence[tuple[float, float]]) -> RailProfile:
    def clipped(h: float, d: float) -> float:
        return min(d, level) if any(a <= h <= b for a, b in ranges) else d

    points = zip(profile.height, profile.deviation, strict=True)
    return RailProfile(profile.height, tuple(clipped(h, d) for h, d in points))


def _section_saving(
    heights: tuple[float, float], rail: ProfileTable, threshold: float, pairs: Sequence[tuple[TripEnergy, TripEnergy]]
) -> SectionSaving:
    fine = np.linspace(*heights, 50)
    delta = np.array([rail.profile.at(h) for h in fine])
    k = int(np.argmax(delta))
    spread = float(np.interp(fine[k], rail.height, rail.spread))
    over = (float(delta[k]) - threshold) / spread if spread > 0.0 else math.inf
    probability = 0.5 * (1.0 + math.erf(over / math.sqrt(2.0)))
    savings = [a.E_c + a.E_cw - b.E_c - b.E_cw for a, b in pairs]
    return SectionSaving(
        low=heights[0],
        high=heights[1],
        worst=float(fine[k]),
        deviation=float(delta[k]),
        spread=spread,
        probability=probability,
        saving=savings[0],
        drawn=tuple(savings[1:]),
    )


def uncertainties_from(table: Mapping[str, Any]) -> tuple[Uncertainty, ...]:
    """Return uncertainties from a settings table.

    A number is a share of the value; ``{"std": 0.3, "relative": false}`` is a standard deviation in SI.
    """
    result = []
    for name, value in table.items():
        if isinstance(value, Mapping):
            result.append(Uncertainty(name, float(value["std"]), bool(value.get("relative", name != "lubrication"))))
        else:
            result.append(Uncertainty(name, float(value), name != "lubrication"))
    return tuple(result)
