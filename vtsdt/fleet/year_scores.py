"""A simulated year of a fleet of lifts against its truth."""

from __future__ import annotations

from operation.fleet.scores import MachineYear
from operation.follow.settings import FollowSettings
from operation.follow.watch import MachineState, watch
from operation.store.store import Event, Store
from vtsdt.fleet.causes import name_change
from vtsdt.fleet.simulated_year import DAY, DAYS, SimulatedFleet

__all__ = ["machine_years"]

#: Visits after the alarm, with it, from which the change is named.
VISITS = 3


def _fleet_settings(machine: str, visits: int, false_alarms: float = 0.2) -> FollowSettings:
    """Return how a lift of the fleet is followed."""
    return FollowSettings(machine=machine, false_alarms=false_alarms, records_per_year=365.25 * visits / DAYS)


def machine_years(
    fleet: SimulatedFleet, store: Store, false_alarms: float = 0.2
) -> tuple[list[MachineYear], dict[str, MachineState]]:
    """Return every lift's year as it was and as it was seen, and keep changes and names in the store.

    Parameters
    ----------
    fleet : SimulatedFleet
    store : Store
        With the judgements of all its visits.
    false_alarms : float
        Stated, per machine and year.
    """
    years, states = [], {}
    for lift in range(fleet.lifts):
        machine = f"lift {1000 * fleet.seed + lift:03d}"
        happens, begins = fleet.truth(lift)
        judgements = store.judgements(machine)
        state = watch(judgements, _fleet_settings(machine, fleet.visits, false_alarms))
        states[machine] = state
        # changes of several quantities at one visit are one alarm
        alarms = sorted({c.raised for c in state.changes})
        named, probability = "", float("nan")
        first = next((a for a in alarms if a >= begins * DAY), None)
        if first is not None:
            since = max((c for c in state.changes if c.raised == first), key=lambda c: c.change.statistic).since
            good = [j for j in judgements if not j.refused]
            until = [j for j in good if j.at <= first]
            known = good[: len(until) - 1 + VISITS]
            explained = name_change(known, since)
            if explained:
                best = explained[0]
                named, probability = best.cause, best.probability
                detail = {
                    "explanations": [
                        {
                            "cause": e.cause,
                            "probability": e.probability,
                            "amount": _number(e.amount),
                            "std": _number(e.std),
                        }
                        for e in explained
                    ],
                    "sentence": f"most probably {best.cause} ({best.probability:.0%})",
                }
                store.add_event(machine, Event(kind="named", subject=best.cause, at=since, raised=first, detail=detail))
        years.append(
            MachineYear(
                machine=machine,
                truth=happens,
                begins=begins,
                days=DAYS,
                alarms=tuple(a / DAY for a in alarms),
                named=named,
                probability=probability,
            )
        )
    return years, states


def _number(value: float) -> float | None:
    return value if value == value else None
