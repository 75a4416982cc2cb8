"""What straightening and lubricating would bring, and how sure that is.

González et al. 2020, section IV-D: the reference model with the estimated profile of the rail is run as it is, with
deviations above a threshold taken to it, with less friction, and with both.  Beyond the paper, uncertain parameters
and the profile's own spread are drawn, the same for all actions, so that every figure has an interval.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from multibody.base.progress import Progress
from vtsdt.files.parameters import LiftParameters
from vtsdt.files.rail_profile import Profile
from vtsdt.files.rail_profile_table import ProfileTable
from vtsdt.lift.energy import TripEnergy
from vtsdt.whatif.result import Action, Section, WhatIf
from vtsdt.whatif.runs import Loaded, TripRunner

__all__ = ["ACTIONS", "Doubt", "default_doubts", "what_if"]

ACTIONS = ("original", "straightened", "lubrication", "both")
#: Between the heights at which drawn rails are stated, m.
GRID = 0.02
#: Correlation length of the error of an estimated profile, m: about the distance of a filter's knots.
ERROR_LENGTH = 0.1


@dataclass(frozen=True)
class Doubt:
    """How well a parameter is known.

    Parameters
    ----------
    name : str
        Of a model parameter, ``"*.mu"`` for the same parameter of both guides, or ``"lubrication"``.
    std : float
        Standard deviation.
    relative : bool
        ``std`` is a share of the value.
    """

    name: str
    std: float
    relative: bool = True

    def names(self) -> tuple[str, ...]:
        """Return the model parameters that move together."""
        if self.name.startswith("*."):
            return tuple(f"{side}_guide.{self.name[2:]}" for side in ("cabin", "counterweight"))
        return () if self.name == "lubrication" else (self.name,)


def default_doubts() -> tuple[Doubt, ...]:
    """Return what is not well known of a lift's guides and masses: this project's own guesses, to be replaced.

    Friction 10 %, contact stiffness 10 %, contact damping 20 %, clearance 5 %, cabin and counterweight 0.5 %, what
    lubrication does ± 0.03 of the friction.
    """
    return (
        Doubt("*.mu", 0.10),
        Doubt("*.stiffness", 0.10),
        Doubt("*.damping", 0.20),
        Doubt("*.clearance", 0.05),
        Doubt("cabin.mass", 0.005),
        Doubt("counterweight.mass", 0.005),
        Doubt("lubrication", 0.03, relative=False),
    )


def what_if(
    parameters: LiftParameters | None = None,
    rail: ProfileTable | None = None,
    *,
    threshold: float = 2.3e-3,
    lubrication: float = 0.9,
    doubts: Sequence[Doubt] | None = None,
    samples: int = 40,
    sections: bool = True,
    direction: str = "up",
    seed: int = 0,
    progress: Progress | None = None,
) -> WhatIf:
    """Return the energies of a trip as it is, straightened, lubricated and both, with intervals.

    Parameters
    ----------
    parameters : LiftParameters, optional
        Default: the shipped bench.
    rail : ProfileTable, optional
        Estimated deviation of the cabin's right rail; default: that of the parameters.
    threshold : float, m
        Deviations above it are taken to it.  Only the cabin's rail is straightened, as on the paper's bench.
    lubrication : float
        Factor on the friction coefficients of cabin and counterweight.
    doubts : sequence of Doubt, optional
        Default: `default_doubts`.
    samples : int
        Draws; 0 for the nominal figures alone.
    sections : bool
        Straighten each section beyond the threshold alone as well.
    direction : {"up", "down"}
    seed : int
    progress : callable, optional

    Raises
    ------
    ValueError
        With every setting that is not possible.
    SimulationError
        If a drawn lift does not run.
    """
    given = parameters if parameters is not None else LiftParameters.bench()
    if rail is None:
        own = given.cabin_guide.right_x
        if own is None:
            raise ValueError("the lift's right rail is straight: give an estimated profile")
        rail = ProfileTable.of(own)
    doubts = default_doubts() if doubts is None else tuple(doubts)
    faults = _faults(threshold, lubrication, samples, rail, given)
    if faults:
        raise ValueError("; ".join(faults))
    grid = _heights(rail, threshold, given)
    runner = TripRunner(given, grid, direction)
    base = _values(runner, doubts)
    ranges, nominal = rail.beyond(threshold), np.array([rail.profile.at(h) for h in grid])
    rng = np.random.default_rng(seed)
    runs: list[Loaded] = []
    drawn: list[dict[str, float]] = []
    for k in range(samples + 1):
        shift = {d.name: 0.0 if k == 0 else float(rng.standard_normal()) for d in doubts}
        error = np.zeros(grid.size) if k == 0 else _rail_error(grid, rail, rng)
        as_is = Profile(tuple(map(float, grid)), tuple(map(float, nominal + error)))
        known = {n: _moved(base[n], d, shift[d.name]) for d in doubts for n in d.names()}
        factor = next((_moved(lubrication, d, shift[d.name]) for d in doubts if d.name == "lubrication"), lubrication)
        greased = {**known, **{n: factor * known.get(n, base[n]) for n in _MU}}
        straight = _cut(as_is, threshold, [(grid[0], grid[-1])])
        runs += [Loaded(as_is, known), Loaded(straight, known), Loaded(as_is, greased), Loaded(straight, greased)]
        if sections:
            runs += [Loaded(_cut(as_is, threshold, [r]), known) for r in ranges]
        drawn.append({**known, "lubrication": factor})
    told = progress or (lambda text: None)
    told(f"compile the reference model for rails of {grid.size} points")
    energies: list[TripEnergy] = []
    for done, each in enumerate(runner.run(runs), 1):
        energies.append(each.energy)
        if done % 8 == 0 or done == len(runs):
            told(f"trip {done} of {len(runs)}")
    width = 4 + (len(ranges) if sections else 0)
    table = [energies[k : k + width] for k in range(0, len(energies), width)]
    actions = tuple(Action(name, table[0][k], tuple(row[k] for row in table[1:])) for k, name in enumerate(ACTIONS))
    found = tuple(
        _section(r, rail, threshold, [(row[0], row[4 + k]) for row in table])
        for k, r in enumerate(ranges if sections else [])
    )
    return WhatIf(
        actions, found, rail, threshold, lubrication, direction, tuple(doubts_told(doubts)), tuple(drawn[1:]), seed
    )


_MU = ("cabin_guide.mu", "counterweight_guide.mu")


def doubts_told(doubts: Sequence[Doubt]) -> list[tuple[str, str]]:
    """Return name and size of each doubt as text."""
    return [(d.name, f"{100 * d.std:g} %" if d.relative else f"{d.std:g}") for d in doubts]


def _faults(threshold: float, lubrication: float, samples: int, rail: ProfileTable, lift: LiftParameters) -> list[str]:
    found = []
    if not 0.0 < threshold < 0.05:
        found.append(f"the threshold is {threshold:g} m: give metres, such as 2.3e-3")
    if not 0.0 < lubrication <= 1.5:
        found.append(f"lubrication is {lubrication:g}: give the factor on the friction, such as 0.9")
    if samples < 0:
        found.append(f"samples is {samples}: give zero or more")
    gap = lift.cabin_guide.gap
    if np.abs(rail.delta).max() > gap:
        found.append(
            f"the rail deviates by {1e3 * np.abs(rail.delta).max():.2f} mm, more than the shoe's gap of "
            f"{1e3 * gap:g} mm"
        )
    return found


def _heights(rail: ProfileTable, threshold: float, lift: LiftParameters) -> np.ndarray:
    """Return the heights at which all rails are stated: the table's own, a grid, and points beside the cuts."""
    low = min(lift.hoistway.rail_bottom, float(rail.height[0]))
    high = max(lift.hoistway.rail_top, float(rail.height[-1]))
    cut = rail.profile.clipped(threshold)
    even = np.linspace(low, high, math.ceil((high - low) / GRID) + 1)
    return np.unique(np.round(np.concatenate([rail.height, np.array(cut.height), even]), 7))


def _values(runner: TripRunner, doubts: Sequence[Doubt]) -> dict[str, float]:
    system = runner.system
    names = [*dict.fromkeys([*_MU, *(n for d in doubts for n in d.names())])]
    unknown = [n for n in names if n not in system.parameter_names]
    if unknown:
        from multibody.base.spelling import nearest

        raise ValueError("; ".join(f"there is no parameter '{n}'{nearest(n, system.parameter_names)}" for n in unknown))
    return {n: float(system.p[system.index("parameter", n)]) for n in names}


def _moved(value: float, doubt: Doubt, shift: float) -> float:
    """Return a drawn value; a draw that would turn its sign is left at a twentieth."""
    moved = value + doubt.std * (value if doubt.relative else 1.0) * shift
    return max(moved, 0.05 * value) if value > 0.0 else moved


def _rail_error(grid: np.ndarray, rail: ProfileTable, rng: np.random.Generator) -> np.ndarray:
    spread = np.interp(grid, rail.height, rail.spread)
    if not np.any(spread > 0.0):
        return np.zeros(grid.size)
    apart = (grid[:, None] - grid[None, :]) / ERROR_LENGTH
    factor = np.linalg.cholesky(np.exp(-0.5 * apart**2) + 1e-8 * np.eye(grid.size))
    return np.asarray(spread * (factor @ rng.standard_normal(grid.size)))


def _cut(profile: Profile, level: float, ranges: Sequence[tuple[float, float]]) -> Profile:
    def kept(h: float, d: float) -> float:
        return min(d, level) if any(a <= h <= b for a, b in ranges) else d

    return Profile(profile.height, tuple(kept(h, d) for h, d in zip(profile.height, profile.deviation, strict=True)))


def _section(
    heights: tuple[float, float], rail: ProfileTable, threshold: float, pairs: Sequence[tuple[TripEnergy, TripEnergy]]
) -> Section:
    fine = np.linspace(*heights, 50)
    delta = np.array([rail.profile.at(h) for h in fine])
    k = int(np.argmax(delta))
    spread = float(np.interp(fine[k], rail.height, rail.spread))
    over = (float(delta[k]) - threshold) / spread if spread > 0.0 else math.inf
    sure = 0.5 * (1.0 + math.erf(over / math.sqrt(2.0)))
    savings = [a.E_c + a.E_cw - b.E_c - b.E_cw for a, b in pairs]
    return Section(
        heights[0], heights[1], float(fine[k]), float(delta[k]), spread, sure, savings[0], tuple(savings[1:])
    )


def as_doubts(table: Mapping[str, Any]) -> tuple[Doubt, ...]:
    """Return doubts from a settings table: ``{"*.mu": 0.1, "lubrication": {"std": 0.03, "relative": false}}``."""
    found = []
    for name, value in table.items():
        if isinstance(value, Mapping):
            found.append(Doubt(name, float(value["std"]), bool(value.get("relative", name != "lubrication"))))
        else:
            found.append(Doubt(name, float(value), name != "lubrication"))
    return tuple(found)
