"""The command ``vtsdt follow``."""

from __future__ import annotations

import json
import math
import time
from argparse import Namespace
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from discrepancy.problem.problem import read_problem
from estimation.files.read_table import READERS
from multibody.base.json_file import write_json_atomically
from multibody.base.terminal_text import printable
from operation.follow.follower import Follower, Taken
from operation.follow.judge import StudyJudge
from operation.follow.settings import read_settings
from operation.sources.folder import FolderSource
from operation.sources.mqtt import MqttAddress, MqttInbox, SourceError
from operation.store.store import Store

__all__ = ["MACHINES", "follow", "study_priors"]

Priors = Mapping[str, tuple[float, float]]
FleetPriors = Callable[[Store, str, Priors], Priors]

#: Seconds between two looks at what the other machines of the store say.
ASKED_EVERY = 3600.0
NO_FLEET = "the other machines of the folder are too few to say anything: the priors are the study's"

#: File of a store with the settings and priors of its machines, so that `vtsdt history` sees what `follow` saw.
MACHINES = "machines.json"


def study_priors(study: str | Path) -> dict[str, tuple[float, float]]:
    """Return mean and standard deviation of the uncertain parameters of a study."""
    return {u.name: (u.value, u.std) for u in read_problem(study).uncertain}


def follow(args: Namespace, priors_of_others: FleetPriors) -> int:
    """Follow a machine until interrupted, or with ``once`` until nothing is new.

    Parameters
    ----------
    args : namespace
        ``study``, ``source``, ``out``, ``machine``, ``poll``, ``settle``, ``once``, ``pattern``, ``quiet``,
        ``progress``.
    priors_of_others : callable
        Gives the priors that the other machines of a store say, from the store, the machine and the study's priors.
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
            judge=StudyJudge(study, settings),
            store=store,
            settings=settings,
            priors=priors,
            study=study if settings.search else None,
            progress=args.progress,
        )
        _remember(out, settings.machine, study)
        asked = -math.inf
        while True:
            paths = source.poll()
            if settings.fleet_prior and paths and time.monotonic() - asked >= ASKED_EVERY:
                asked = time.monotonic()
                given = priors_of_others(store, settings.machine, priors)
                follower.settings = settings.with_drift_of(priors) if given else settings
                follower.priors = {**priors, **given}
                text = f"the other machines give the priors of {', '.join(given)}" if given else NO_FLEET
                if not args.quiet:
                    print(printable(text), flush=True)
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
    patterns = tuple(args.pattern or (f"*{ending}" for ending in READERS if ending != ".txt"))  # notes are texts, too
    if "://" in args.source:
        inbox = out / "inbox"
        address = MqttAddress.parse(args.source)
        stack.enter_context(MqttInbox(address, inbox, client=f"vtsdt-{machine}"))
        return FolderSource(folder=inbox, patterns=patterns, settle=0.0)
    folder = Path(args.source)
    if not folder.is_dir():
        raise SourceError(f"--source {args.source}: there is no such folder: make it, or give mqtt://host/topic")
    if folder.resolve() == out.resolve() or out.resolve() in folder.resolve().parents:
        raise SourceError(f"--source {args.source}: lies in --out, where this command writes: name another folder")
    return FolderSource(folder=folder, patterns=patterns, settle=args.settle)


def _line(taken: Taken) -> str:
    what = "known" if not taken.new else (f"refused: {taken.refused}" if taken.refused else taken.state.word)
    shown = "; ".join([*([taken.clock] if taken.clock else []), *(f"{e.kind}: {e.subject}" for e in taken.events)])
    return printable(f"{taken.path.name}: {what}{f' ({shown})' if shown else ''}")


def _remember(out: Path, machine: str, study: Path) -> None:
    """Keep which study a machine is followed with."""
    path = out / MACHINES
    known = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    if known.get(machine) != str(study.resolve()):
        write_json_atomically(path, {**known, machine: str(study.resolve())})
