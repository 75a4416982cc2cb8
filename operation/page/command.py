"""The command ``vtsdt history``."""

from __future__ import annotations

import json
import sys
import time
from argparse import Namespace
from datetime import UTC, datetime

from multibody.base.quantity_text import count_text
from multibody.base.spelling import nearest_or_choices
from multibody.base.terminal_text import printable
from operation.fleet.machine_states import machine_states
from operation.follow.watch import MachineState
from operation.page.page import write_page
from operation.store.store import Store, StoreError

__all__ = ["history"]


def history(args: Namespace) -> int:
    """Show the history in a store, or add a note to it.

    Parameters
    ----------
    args : namespace
        ``folder``, ``machine``, ``csv``, ``page``, ``json``, ``note``, ``at``, ``new_reference``, ``now``.
    """
    with Store(args.folder, create=False) as store:
        if args.machine and args.machine not in store.machines:
            raise StoreError(
                f"--machine {args.machine}: not in the history{nearest_or_choices(args.machine, store.machines)}"
            )
        if args.note:
            machines = [args.machine] if args.machine else list(store.machines)
            for machine in machines:
                store.note(machine, args.note, _seconds(args.at), new_reference=args.new_reference)
            print(f"noted for {', '.join(machines)}")
            return 0
        if args.csv:
            store.to_frame([args.machine] if args.machine else None).to_csv(args.csv, index=False)
            return 0
        current = machine_states(store, time.time() if args.now else None)
        if args.machine:
            current = {args.machine: current[args.machine]}
        if args.page:
            print(f"page: {write_page(args.page, store, current)}")
            return 0
        if args.json:
            sys.stdout.write(json.dumps({n: _as_json(s, store, n) for n, s in current.items()}, indent=1) + "\n")
            return 0
        for name, state in current.items():
            print(printable(f"{name}: {state.word} ({count_text(state.records, 'record')}, {state.refused} refused)"))
            for reason in state.reasons:
                print(printable(f"  {reason}"))
            for event in store.events(name):
                if event.kind in ("named", "alarm", "note"):
                    text = event.detail.get("sentence") or event.detail.get("text") or event.subject
                    print(printable(f"  {_day(event.at)} {event.kind}: {text}"))
    return 0


def _as_json(state: MachineState, store: Store, machine: str) -> dict[str, object]:
    quantities = {}
    for name, trace in state.traces.items():
        mean, std = trace.now
        quantities[name] = {"kind": trace.kind, "unit": trace.unit, "value": mean, "std": std if std < 1e300 else None}
    events = [
        {"kind": e.kind, "subject": e.subject, "at": e.at, "raised": e.raised, **e.detail}
        for e in store.events(machine)
    ]
    return {
        "state": state.word,
        "reasons": list(state.reasons),
        "records": state.records,
        "refused": state.refused,
        "quantities": quantities,
        "events": events,
    }


def _day(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d")


def _seconds(text: str | None) -> float:
    """Return a time given as 2026-03-01 or 2026-03-01T08:00 (UTC) in seconds since 1970; None is now."""
    if text is None:
        return time.time()
    try:
        given = datetime.fromisoformat(text)
    except ValueError as error:
        raise StoreError(f"--at {text}: is no time: write it as 2026-03-01 or 2026-03-01T08:00 (UTC)") from error
    return (given if given.tzinfo else given.replace(tzinfo=UTC)).timestamp()
