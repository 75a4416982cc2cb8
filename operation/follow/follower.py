"""Following one machine: each new record is judged, kept, laid beside those before it, and alarms go out."""

from __future__ import annotations

import calendar
import math
import re
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from multibody.base.progress import silent
from multibody.base.quantity_text import count_text
from operation.follow.judge import Judged
from operation.follow.naming import NAMED_FROM, name_effect, problem_of_series, reference_priors
from operation.follow.notify import NotDelivered, deliver
from operation.follow.settings import AlarmRule, FollowSettings
from operation.follow.watch import FoundChange, MachineState, watch
from operation.store.store import Event, Store

__all__ = ["Follower", "Taken", "record_time"]

#: Seconds by which a record may lie ahead of the computer's clock before one of the two clocks is wrong.
AHEAD = 86400.0
_DIRECTIVES = {"Y": r"\d{4}", "m": r"\d\d", "d": r"\d\d", "H": r"\d\d", "M": r"\d\d", "S": r"\d\d", "j": r"\d{3}"}


class Judge(Protocol):
    """What judges a record: a study's model, or a method of one kind of machine."""

    def __call__(self, path: Path, at: float) -> Judged:
        """Judge a recording that was made at a time."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Taken:
    """What came of a file.

    Parameters
    ----------
    path : Path
    state : MachineState
        After it.
    new : bool
        False where its content was known.
    refused : str
        Why it could not be judged.
    clock : str
        What was done about a stamp that lies ahead of the computer's clock.
    events : tuple of Event
        That it has shown.
    seconds : float
        Processor time.
    """

    path: Path
    state: MachineState
    new: bool
    refused: str = ""
    clock: str = ""
    events: tuple[Event, ...] = ()
    seconds: float = 0.0


def record_time(path: Path, stamp: str) -> float:
    """Return when a file was recorded, s since 1970: from its name by a format, else from the file's own time.

    Examples
    --------
    >>> record_time(Path("trip_2026-03-01T08-00-00.csv"), "%Y-%m-%dT%H-%M-%S")
    1772352000.0
    """
    if stamp:
        pattern = re.sub(r"%([A-Za-z])", lambda m: _DIRECTIVES.get(m[1], r"\w+"), re.escape(stamp).replace(r"\%", "%"))
        match = re.search(pattern, path.name)
        if match:
            return float(calendar.timegm(time.strptime(match[0], stamp)))
    return path.stat().st_mtime


@dataclass(kw_only=True)
class Follower:
    """A machine that is followed.

    Parameters
    ----------
    judge : callable
        Such as `operation.follow.judge.StudyJudge`.
    store : Store
    settings : FollowSettings
    priors : mapping of str to (float, float)
        Of the parameters before the first record: the study's, or a fleet's.
    study : Path or None
        Where the search for missing effects may be called: the study file.
    progress : callable
    clock : callable
        The computer's time, s since 1970.
    """

    judge: Judge
    store: Store
    settings: FollowSettings
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    study: Path | None = None
    progress: Callable[[str], None] = silent
    clock: Callable[[], float] = time.time

    @property
    def reference_from(self) -> float:
        """When the machine became what it is compared with: the last note that says so."""
        notes = self.store.events(self.settings.machine, "note")
        return max((e.at for e in notes if e.detail.get("new_reference")), default=-math.inf)

    def state(self, now: float | None = None) -> MachineState:
        """Return the machine's state from all its records."""
        return watch(
            self.store.judgements(self.settings.machine),
            self.settings,
            self.priors,
            reference_from=self.reference_from,
            now=now,
        )

    def take(self, path: Path) -> Taken:
        """Judge a file, keep the result, and raise what it shows."""
        begun = time.process_time()
        machine = self.settings.machine
        self.progress(f"judge {path.name}")
        at, clock = self._at(path)
        judged = self.judge(path, at)
        new = self.store.add(machine, judged.judgement, judged.series)
        state = self.state()
        events = self._events(state, path) if new and not judged.judgement.refused else ()
        self.send()
        self.store.retain(series=self.settings.keep_series, records=self.settings.keep_records)
        return Taken(
            path=path,
            state=state,
            new=new,
            refused=judged.judgement.refused,
            clock=clock if new else "",
            events=events,
            seconds=time.process_time() - begun,
        )

    def _at(self, path: Path) -> tuple[float, str]:
        """Return when a file was recorded, and what to say of a stamp that cannot be.

        A clock that jumped ahead would stand after all records of years; one that jumped back stands before them,
        which changes nothing.  Where the computer's clock lies before the records kept, it is the one that is wrong.
        """
        at, now = record_time(path, self.settings.stamp), self.clock()
        if at <= now + AHEAD:
            return at, ""
        if now < max((j.at for j in self.store.judgements(self.settings.machine)), default=-math.inf):
            return at, ""
        stamped = f"{np.datetime64(int(at), 's')}".replace("T", " ")
        return now, f"stamped {stamped}, ahead of this computer's clock: taken as recorded now; set the clock"

    def _events(self, state: MachineState, path: Path) -> tuple[Event, ...]:
        events = []
        for change in self._new_changes(state):
            event = _change_event(change)
            if self.store.add_event(self.settings.machine, event):
                events.append(event)
                if change.kind == "misfit" and self.settings.search and self.study is not None:
                    events += self._named(state, change, path)
        for name, rule in self.settings.alarms.rules.items():
            if _holds(rule, state) and not self._held_before(rule):
                event = Event(
                    kind="alarm", subject=name, at=state.last, raised=state.last, detail={"text": _words(rule, state)}
                )
                if self.store.add_event(self.settings.machine, event):
                    events.append(event)
        return tuple(events)

    def _new_changes(self, state: MachineState) -> list[FoundChange]:
        """Return the changes that no event tells yet: one that a late record moved a little is the same."""
        reported = self.store.events(self.settings.machine, "change")

        def known(c: FoundChange) -> bool:
            return any(
                e.subject == c.quantity
                and e.detail.get("up") == c.change.up
                and e.at <= c.raised
                and c.since <= e.raised
                for e in reported
            )

        return [c for c in state.changes if not known(c)]

    def _held_before(self, rule: AlarmRule) -> bool:
        """Return whether a rule held already before the latest record."""
        before = self.store.judgements(self.settings.machine)[:-1]
        return _holds(rule, watch(before, self.settings, self.priors, reference_from=self.reference_from))

    def _named(self, state: MachineState, change: FoundChange, path: Path) -> list[Event]:
        """Call the search on the records since a change of a misfit."""
        from discrepancy.problem.problem import read_problem

        machine = self.settings.machine
        since = [j for j in self.store.judgements(machine) if j.at >= change.since and not j.refused][-NAMED_FROM:]
        series = [(j.name, frame) for j in since if (frame := self.store.series(machine, j.key)) is not None]
        if not series or self.study is None:
            return []
        self.progress(
            f"{change.quantity} has changed: search for what has come in, on {count_text(len(series), 'record')}"
        )
        template = read_problem(self.study, recordings=[path])
        diagnosis = name_effect(problem_of_series(template, series), reference_priors(state, change.since))
        subject = ", ".join(f"{e['kind']}@{e['where']}" for e in diagnosis["effects"]) or diagnosis["verdict"]
        event = Event(kind="named", subject=subject, at=change.since, raised=change.raised, detail=diagnosis)
        return [event] if self.store.add_event(machine, event) else []

    def send(self) -> int:
        """Deliver the notifications that were not delivered yet, and return how many were."""
        alarms, count = self.settings.alarms, 0
        if not (alarms.command or alarms.webhook):
            return 0
        kinds = ("change", "named", "alarm") if alarms.changes else ("alarm",)
        for event in self.store.events(self.settings.machine):
            if event.kind not in kinds or event.notified is not None:
                continue
            message = {
                "machine": self.settings.machine,
                "kind": event.kind,
                "subject": event.subject,
                "since": event.at,
                "raised": event.raised,
                **event.detail,
            }
            try:
                deliver(alarms, message)
            except NotDelivered as error:
                self.progress(f"not delivered, tried again later: {error}")
                return count
            self.store.mark_notified(self.settings.machine, event)
            count += 1
        return count


def _holds(rule: AlarmRule, state: MachineState) -> bool:
    """Return whether an alarm rule holds in a state."""
    if rule.state:
        return state.word == rule.state
    trace = state.traces.get(rule.quantity)
    if trace is None:
        return False
    if rule.above is not None:
        return trace.probability_above(rule.above) >= rule.probability
    return rule.below is not None and 1.0 - trace.probability_above(rule.below) >= rule.probability


def _words(rule: AlarmRule, state: MachineState) -> str:
    if rule.state:
        return f"{rule.state}: {state.reasons[0]}"
    trace = state.traces[rule.quantity]
    mean, std = trace.now
    side, limit = ("above", rule.above) if rule.above is not None else ("below", rule.below)
    return (
        f"{rule.quantity} is {mean:.4g} ± {std:.2g} {trace.unit}, {side} {limit:g} with {rule.probability:.0%} or more"
    )


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _change_event(change: FoundChange) -> Event:
    """Return a change as it is kept."""
    low, high = change.size.interval()
    return Event(
        kind="change",
        subject=change.quantity,
        at=change.since,
        raised=change.raised,
        detail={
            "up": change.change.up,
            "kind": change.kind,
            "unit": change.unit,
            "size": _finite(change.size.size),
            "interval": [_finite(low), _finite(high)],
            "shape": change.size.shape,
            "per_day": change.size.per_day,
        },
    )
