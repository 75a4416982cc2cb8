"""What to do with a lift's guides, what it saves, and how sure that is."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from operation.follow.watch import MachineState
from operation.page.page import Advice, general_advice
from operation.store.store import Event
from vtsdt.fleet.causes import LUBRICATION, SENSOR, WEAR
from vtsdt.fleet.visit import WORK

__all__ = ["lift_advice"]

#: Visits whose mean counts as the present.
LATEST = 4
_TODO = {
    WEAR: "Measure the play of the cabin's shoes and replace them.",
    LUBRICATION: "Nothing: the guides have less friction than before. Enter it with vtsdt history --note.",
    SENSOR: "Set the tension sensor's zero again; until then its error is subtracted.",
}


def lift_advice(state: MachineState, events: Sequence[Event]) -> Advice:
    """Return what to do, from what the change was named."""
    named = [e for e in events if e.kind == "named"]
    if not named or state.word in ("no data", "as expected"):
        return general_advice(state, events)
    explanations = named[-1].detail.get("explanations") or []
    if not explanations:
        return general_advice(state, events)
    best = explanations[0]
    cause = str(best["cause"])
    if cause.startswith("rails settled"):
        third = cause.rpartition(", ")[2]
        do = f"Straighten the rails in the {third}; vtsdt align gives the heights."
    else:
        do = _TODO.get(cause, "Inspect the guides: the change has none of the known causes.")
    sure = f"{cause}: {float(best['probability']):.0%}"
    if len(explanations) > 1 and float(explanations[1]["probability"]) >= 0.05:
        sure += f", or {explanations[1]['cause']}: {float(explanations[1]['probability']):.0%}"
    return Advice(do=do, saves=_saves(state), sure=sure)


def _saves(state: MachineState) -> str:
    """Return by how much the friction's work has grown, where its interval is above zero."""
    trace = state.traces.get(WORK)
    if trace is None or not state.changes:
        return ""
    before = trace.values[trace.times < min(c.since for c in state.changes)]
    now = trace.values[-LATEST:]
    if before.size < LATEST:
        return ""
    more = float(np.mean(now) - np.mean(before))
    std = math.hypot(*(float(np.std(part, ddof=1)) / math.sqrt(part.size) for part in (before, now)))
    if more - 2.0 * std <= 0.0:
        return ""
    share = 100.0 * more / float(np.mean(before))
    return f"{more:.2g} ± {2.0 * std:.1g} J of friction on each trip, as it was before ({share:.0f} %)"
