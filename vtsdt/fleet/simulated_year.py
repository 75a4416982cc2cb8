"""A fleet of virtual lifts over a year, with its truth: visits of two trips each from the rig with 37 states.

Synthetic: every lift has rails, parameters and sensors of its own, drawn as for `vtsdt bench lift`; in a part of them
something happens on a day of the year.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from operation.store.judgement import Judgement
from vtsdt.alignment.trips import AlignmentError
from vtsdt.alignment.virtual_lifts import prepared, visit, with_sensor_errors
from vtsdt.files.parameters import LiftParameters
from vtsdt.fleet.causes import LUBRICATION, SENSOR, WEAR, settled
from vtsdt.fleet.visit import SECTIONS, judge_trips
from vtsdt.rig.models import with_rails
from vtsdt.rig.rails import rail_tables
from vtsdt.rig.rig import LiftRig

__all__ = ["DAY", "DAYS", "SimulatedFleet", "judge_visit"]

DAY = 86400.0
DAYS = 365.0
#: Share of the lifts to which nothing happens.
QUIET = 0.4
#: Days over which rails settle, shoes wear and sensors drift to the amounts below.
GROWS = 150.0
#: Rail in a third of the travel, m; play of a shoe, m on a flange; friction as a factor; tension, N.
RAIL, CLEARANCE, FRICTION, TENSION = 0.8e-3, 0.2e-3, 0.75, 4.0
#: Trips of a visit: up and down.
TRIPS = 2


@dataclass(frozen=True, kw_only=True)
class LiftVisit:
    """A visit to a lift of a simulated fleet.

    Parameters
    ----------
    seed : int
        Of the lift.
    number : int
        Of the visit, from 1.
    day : float
    happens : str
        As named in `vtsdt.fleet.causes`, or empty.
    begins : float, days
    """

    seed: int
    number: int
    day: float
    happens: str
    begins: float

    @property
    def machine(self) -> str:
        """Name of the lift."""
        return f"lift {self.seed:03d}"

    @property
    def grown(self) -> float:
        """How much of what happens has happened, 0 to 1."""
        if not self.happens or self.day < self.begins:
            return 0.0
        return 1.0 if self.happens == LUBRICATION else min((self.day - self.begins) / GROWS, 1.0)


@dataclass(frozen=True, kw_only=True)
class SimulatedFleet:
    """A fleet of lifts over a year.

    Parameters
    ----------
    lifts : int
    visits : int
        Of each lift, evenly over the year.
    seed : int
        Of what happens to which lift, and of the lifts themselves.
    """

    lifts: int = 10
    visits: int = 26
    seed: int = 0

    def __post_init__(self) -> None:
        if self.lifts < 1 or self.visits < 8:
            raise ValueError(
                f"{self.lifts} lifts with {self.visits} visits: give one lift or more and 8 visits or more"
            )

    def truth(self, lift: int) -> tuple[str, float]:
        """Return what happens to a lift, and on which day: between a third and two thirds of the year."""
        rng = np.random.default_rng([self.seed, lift, 32])
        kinds = (*(settled(s) for s in SECTIONS), WEAR, LUBRICATION, SENSOR)
        weights = np.array([1.0, 1.0, 1.0, 3.0, 3.0, 3.0])
        happens = "" if rng.random() < QUIET else str(rng.choice(kinds, p=weights / weights.sum()))
        return happens, float(rng.uniform(DAYS / 3.0, DAYS / 1.5))

    def all_visits(self) -> Iterator[LiftVisit]:
        """Yield the visits to all lifts, lift by lift."""
        for lift in range(self.lifts):
            happens, begins = self.truth(lift)
            for k in range(self.visits):
                yield LiftVisit(
                    seed=1000 * self.seed + lift,
                    number=k + 1,
                    day=(k + 0.5) * DAYS / self.visits,
                    happens=happens,
                    begins=begins,
                )


def judge_visit(one: LiftVisit) -> tuple[str, Judgement]:
    """Simulate a visit and judge it; nothing of the truth enters the judgement."""
    made = visit(one.seed, one.number, TRIPS, parameters=_parameters(one))
    records = list(made.records)
    if one.happens == SENSOR and one.grown:
        records = with_sensor_errors(records, one.seed, tension_offset=TENSION * one.grown)
    name = f"visit {one.number}"
    common = {"key": f"{one.seed}-{one.number}", "name": name, "at": one.day * DAY}
    try:
        quantities = judge_trips(prepared(records))
    except AlignmentError as error:
        return one.machine, Judgement(**common, refused=str(error))  # type: ignore[arg-type]
    return one.machine, Judgement(**common, quantities=quantities)  # type: ignore[arg-type]


def _parameters(one: LiftVisit) -> LiftParameters:
    """Return the lift's parameters on the day of a visit, before its own spread is drawn."""
    given = with_rails(LiftParameters.bench(), rail_tables(LiftRig(seed=one.seed).profiles))
    guide, grown = given.cabin_guide, one.grown
    if one.happens == WEAR:
        guide = dataclasses.replace(guide, clearance=guide.clearance + CLEARANCE * grown)
    elif one.happens == LUBRICATION:
        guide = dataclasses.replace(guide, mu=guide.mu * (1.0 - (1.0 - FRICTION) * grown))
    elif one.happens.startswith("rails") and guide.right_x is not None:
        third = [settled(s) for s in SECTIONS].index(one.happens)
        rail, travel = guide.right_x, given.hoistway.travel
        shoes = np.mean([given.cabin.shoe_low, given.cabin.shoe_high])
        low, high = (travel * (third + k) / len(SECTIONS) + shoes for k in (0, 1))
        inside = np.array([low <= h <= high for h in rail.height])
        moved = np.asarray(rail.deviation) + RAIL * grown * inside
        guide = dataclasses.replace(guide, right_x=dataclasses.replace(rail, deviation=tuple(map(float, moved))))
    return dataclasses.replace(given, cabin_guide=guide)
