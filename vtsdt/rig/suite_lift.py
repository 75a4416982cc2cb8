"""The virtual lift of the suites: the 1D model under test on trips of the lift with 37 states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

from discrepancy.rigs.case import Case
from vtsdt.rig.rig import LiftRig

__all__ = ["TRIPS", "UNKNOWN", "case", "names", "sizes"]

#: Trips of a case; the last quarter is held out.
TRIPS = 4
UNKNOWN = "unknown_force@cabin.z"


def case(seed: int, hidden: Sequence[str] = (), rig: type[LiftRig] = LiftRig, **settings: Any) -> Case:
    """Return recordings of the lift with something hidden, and the model under test."""
    recorded = rig(seed=seed, **{"trips": TRIPS, **settings}).case(hidden)
    return replace(recorded, offsets=("a_c",))


def sizes(seed: int, hidden: Sequence[str], under_test: str = "one_dimensional") -> list[dict[str, Any]]:
    """Return the hidden effects at their usual size, without a simulation."""
    rig = LiftRig(seed=seed, trips=TRIPS, under_test=under_test)
    return [h.truth(rig.units) for h in rig.hidden(hidden)]


@lru_cache(maxsize=2)
def names(under_test: str = "one_dimensional") -> list[str]:
    """Return everything that can be hidden, as ``kind@where``."""
    return [f"{e['kind']}@{e['where']}" for e in LiftRig(trips=TRIPS, under_test=under_test).list()]
