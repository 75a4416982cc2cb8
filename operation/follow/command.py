"""The commands ``vtsdt follow`` and ``vtsdt history``."""

from __future__ import annotations

import json
import sys
import time
from argparse import Namespace
from contextlib import ExitStack
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from discrepancy.problem.problem import read_problem
from multibody.base.json_file import write_json_atomically
from multibody.base.terminal_text import printable
from operation.follow.follower import Follower, Taken
from operation.follow.judge import StudyJudge
from operation.follow.settings import read_settings
from operation.follow.watch import MachineState, watch
from operation.sources.folder import FolderSource
from operation.sources.mqtt import MqttAddress, MqttInbox, SourceError
from operation.store.store import Store

__all__ = ["follow", "history"]

#: File of a store with the settings and priors of its machines, so that `vtsdt history` sees what `follow` saw.
MACHINES = "machines.json"


def study_priors(study: str | Path) -> dict[str, tuple[float, float]]:
    """Return mean and standard deviation of the uncertain parameters of a study."""
    return {u.name: (u.value, u.std) for u in read_problem(study).uncertain}


def follow(args: Namespace) -> int:
    """Follow a machine until interrupted, or with ``once`` until nothing is new.

    Parameters
    ----------
    args : namespace
        ``study``, ``source``, ``out``, ``machine``, ``poll``, ``settle``, ``once``, ``pattern``, ``quiet``,
        ``progress``.
    """
    settings = read_settings(args.study)
    if args.machine:
        settings = replace(settings, machine=args.machine)
    study, out = Path(args.study), Path(args.out)
    priors = study_priors(study)
    with ExitStack() as stack:
        store = stack.enter_context(Store(out))
        source = _source(args, out, settings.machine, stack)
        follower = Follower(
            StudyJudge(study, settings), store, settings, priors, study if settings.search else None, args.progress
        )
        _remember(out, settings.machine, study)
        while True:
            paths = source.poll()
            for path in paths:
                try:
                    taken = follower.take(path)
                except FileNotFoundError:
                    continue  # gone since it was listed
                if not args.quiet:
                    print(_line(taken), flush=True)
            if args.once and not paths and source.all_offered:
                break
            follower.send()
            time.sleep(args.poll)
        state = follower.state()
    if not args.quiet:
        print(f"{settings.machine}: {state.word}: {'; '.join(state.reasons)}")
    return 0


def _source(args: Namespace, out: Path, machine: str, stack: ExitStack) -> FolderSource:
    patterns = tuple(args.pattern or ("*.csv", "*.csv.gz", "*.parquet", "*.mat"))
    if "://" in args.source:
        inbox = out / "inbox"
        address = MqttAddress.parse(args.source)
        stack.enter_context(MqttInbox(address, inbox, client=f"vtsdt-{machine}"))
        return FolderSource(inbox, patterns, settle=0.0)
    folder = Path(args.source)
    if not folder.is_dir():
        raise SourceError(f"--source {args.source}: there is no such folder: make it, or give mqtt://host/topic")
    if folder.resolve() == out.resolve() or out.resolve() in folder.resolve().parents:
        raise SourceError(f"--source {args.source}: lies in --out, where this command writes: name another folder")
    return FolderSource(folder, patterns, settle=args.settle)


def _line(taken: Taken) -> str:
    what = "known" if not taken.new else (f"refused: {taken.refused}" if taken.refused else taken.state.word)
    shown = "; ".join(f"{e.kind}: {e.subject}" for e in taken.events)
    return printable(f"{taken.path.name}: {what}{f' ({shown})' if shown else ''}")


def _remember(out: Path, machine: str, study: Path) -> None:
    """Keep which study a machine is followed with."""
    path = out / MACHINES
    known = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    if known.get(machine) != str(study.resolve()):
        write_json_atomically(path, {**known, machine: str(study.resolve())})


def states(store: Store, now: float | None = None) -> dict[str, MachineState]:
    """Return the state of every machine of a store, with the settings of its study where that is there."""
    from operation.follow.settings import FollowSettings

    path = store.folder / MACHINES
    known = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    found = {}
    for machine in store.machines:
        study = Path(known.get(machine, ""))
        settings, priors = FollowSettings(machine=machine), {}
        if study.is_file():
            settings, priors = replace(read_settings(study), machine=machine), study_priors(study)
        notes = [e.at for e in store.events(machine, "note") if e.detail.get("new_reference")]
        found[machine] = watch(
            store.judgements(machine), settings, priors, reference_from=max(notes, default=float("-inf")), now=now
        )
    return found


def history(args: Namespace) -> int:
    """Show the history in a store, or add a note to it.

    Parameters
    ----------
    args : namespace
        ``folder``, ``machine``, ``csv``, ``json``, ``note``, ``at``, ``new_reference``, ``now``.
    """
    with Store(args.folder, create=False) as store:
        if args.machine and args.machine not in store.machines:
            from multibody.base.spelling import nearest_or_choices
            from operation.store.store import StoreError

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
        found = states(store, time.time() if args.now else None)
        if args.machine:
            found = {args.machine: found[args.machine]}
        if args.json:
            sys.stdout.write(json.dumps({n: _as_json(s, store, n) for n, s in found.items()}, indent=1) + "\n")
            return 0
        for name, state in found.items():
            print(printable(f"{name}: {state.word} ({state.records} records, {state.refused} refused)"))
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
        from operation.store.store import StoreError

        raise StoreError(f"--at {text}: is no time: write it as 2026-03-01 or 2026-03-01T08:00 (UTC)") from error
    return (given if given.tzinfo else given.replace(tzinfo=UTC)).timestamp()
