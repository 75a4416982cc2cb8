"""The page: machines as rows, what is the matter, what to do and what it saves, how sure."""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from discrepancy.drawing.page import rendered
from multibody.base.json_file import naming
from multibody.base.quantity_text import quantity_text
from operation.fleet.fleet_view import FleetQuantity, fleet_view
from operation.follow.watch import STATES, MachineState
from operation.page.trend import trend_svg
from operation.store.store import Event, Store

__all__ = ["Advice", "general_advice", "write_page"]

#: Trends of a machine that are drawn without being asked for.
TRENDS = 4
#: Events of a machine that are listed, the latest.
LISTED = 5


@dataclass(frozen=True, kw_only=True)
class Advice:
    """What to do with a machine.

    Parameters
    ----------
    do : str
    saves : str
        What it saves, with its interval; empty where that is not known.
    sure : str
        How sure that is.
    """

    do: str
    saves: str = ""
    sure: str = ""


def general_advice(state: MachineState, events: Sequence[Event]) -> Advice:
    """Return what to do with a machine of which only its state is known."""
    named = [e for e in events if e.kind == "named"]
    rate = ""
    if math.isfinite(state.records_per_alarm):
        rate = (
            f"of one quantity, a change by chance comes once in {float(f'{state.records_per_alarm:.2g}'):.0f} records"
        )
    if state.word == "no data":
        return Advice(do="Look at the logger and the connection: no record has come.", sure="certain")
    if state.word == "something new":
        if named:
            sentence = str(named[-1].detail.get("sentence", named[-1].subject))
            return Advice(do=f"Inspect: {sentence}", sure=rate)
        return Advice(do="The model no longer explains the records: diagnose those since the change.", sure=rate)
    if state.word == "drifting":
        names = ", ".join(dict.fromkeys(c.quantity for c in state.changes))
        said = f" {named[-1].detail.get('sentence', '')}" if named else ""
        return Advice(do=f"Inspect what {names} depends on.{said}", sure=rate)
    return Advice(do="Nothing.")


def write_page(
    path: str | Path,
    store: Store,
    states: Mapping[str, MachineState],
    *,
    title: str = "Machines",
    trends: Sequence[str] = (),
    advice: Callable[[MachineState, Sequence[Event]], Advice] = general_advice,
    share: float = 0.7,
) -> Path:
    """Write the page and return its path.

    Parameters
    ----------
    path : str or Path
    store : Store
    states : mapping of str to MachineState
        By machine.
    title : str
    trends : sequence of str
        Quantities that are drawn for every machine; default: those that have changed and the first parameters.
    advice : callable
        What to do, from a machine's state and events.
    share : float
        Of the machines that a threshold covers.
    """
    fleet = fleet_view(states, share)
    rows = [_row(name, states[name], store.events(name), trends, advice, fleet) for name in _worst_first(states)]
    last = max((s.last for s in states.values() if math.isfinite(s.last)), default=None)
    text = rendered(
        "operation",
        "machines.html",
        title=title,
        rows=rows,
        counts=[(word, sum(s.word == word for s in states.values())) for word in STATES],
        fleet=[_fleet_row(q) for q in fleet.values()],
        share=f"{share:.0%}",
        until=_day(last) if last is not None else "",
    )
    path = Path(path)
    with naming(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, draft = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".tmp")
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as stream:
                stream.write(text)
            os.chmod(draft, 0o644)
            os.replace(draft, path)
        finally:
            Path(draft).unlink(missing_ok=True)
    return path


def _worst_first(states: Mapping[str, MachineState]) -> list[str]:
    order = ("something new", "no data", "drifting", "as expected")
    return sorted(states, key=lambda n: (order.index(states[n].word), n))


def _row(
    name: str,
    state: MachineState,
    events: Sequence[Event],
    trends: Sequence[str],
    advice: Callable[[MachineState, Sequence[Event]], Advice],
    fleet: Mapping[str, FleetQuantity],
) -> dict[str, Any]:
    from markupsafe import Markup

    chosen = [n for n in trends if n in state.traces]
    if not chosen:
        changed = list(dict.fromkeys(c.quantity for c in state.changes))
        others = [n for n, t in state.traces.items() if t.kind in ("parameter", "feature")]
        chosen = list(dict.fromkeys([*changed, *others]))[:TRENDS]
    drawings = [Markup(trend_svg(state.traces[n], fleet[n].level if n in fleet else None)) for n in chosen]
    outside = [q.name for q in fleet.values() if any(m == name for m, _ in q.outside)]
    listed = [
        {"day": _day(e.at), "kind": e.kind, "text": str(e.detail.get("sentence") or e.detail.get("text") or e.subject)}
        for e in events
        if e.kind in ("named", "alarm", "note")
    ][-LISTED:]
    reasons = list(state.reasons)
    if outside:
        reasons.append(f"outside of the rest of the fleet: {', '.join(outside)}")
    return {
        "name": name,
        "word": state.word,
        "reasons": reasons,
        "records": state.records,
        "refused": state.refused,
        "last": _day(state.last) if math.isfinite(state.last) else "never",
        "trends": drawings,
        "advice": advice(state, events),
        "events": listed,
    }


def _fleet_row(q: FleetQuantity) -> dict[str, Any]:
    low, high = q.interval
    return {
        "name": q.name,
        "mean": quantity_text(q.prior.mean, q.unit),
        "spread": quantity_text(q.prior.spread, q.unit, 2),
        "level": quantity_text(q.level, q.unit),
        "interval": f"{quantity_text(low, q.unit)} to {quantity_text(high, q.unit)}",
        "outside": ", ".join(f"{m} ({away:+.1f} σ)" for m, away in q.outside),
    }


def _day(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d")
