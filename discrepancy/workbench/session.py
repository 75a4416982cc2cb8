"""A study that is open in the workbench: what the page shows of it, and the one piece of work in hand."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from discrepancy.effects.kind_picture import has_picture, kind_picture
from discrepancy.effects.kinds import kind_named, kinds
from discrepancy.effects.law_in_words import law_of
from discrepancy.questions.compare import Comparison, compare
from discrepancy.questions.unknown_force import UnknownForce
from discrepancy.report.figures import stage_title
from discrepancy.stages.stage import Stage
from discrepancy.study.candidates import Candidates
from discrepancy.study.history import save_history
from discrepancy.study.snapshot import Snapshot
from discrepancy.study.study import Study
from discrepancy.study.what_if import simulate_with
from discrepancy.workbench import views
from discrepancy.workbench.candidate_list import candidate_list
from discrepancy.workbench.force_view import force_view
from discrepancy.workbench.giving_way import GivingWay
from discrepancy.workbench.time_view import record_figures
from multibody.base.compile_events import on_compile
from multibody.base.progress import Step
from multibody.base.quantity_text import unit_text

__all__ = ["Busy", "Session", "Stopped"]

Entry = dict[str, Any]
READINGS = 20  # of a state, until one is not interrupted by the beginning of a step
BRANCHES = ("B", "A")  # names of the lines of two branches, the second first, as it is drawn below


class Stopped(KeyboardInterrupt):
    """The person has stopped the work in hand; a search keeps the stages that it has made."""


class Busy(RuntimeError):
    """Something is being computed already."""


class Session:
    """A study that is open in the workbench.

    Whatever changes the study runs in one thread of its own, one piece of work at a time, and everything is done by
    methods of `Study`.  What the page shows is read from finished stages, which never change.

    Parameters
    ----------
    study : Study
    history : path
        File that keeps every step.
    """

    def __init__(self, study: Study, history: str | Path):
        self.study = study
        self.history = Path(history)
        self.version = 0
        self.giving_way = GivingWay()
        self._changed = threading.Condition()
        self._stop = threading.Event()
        self._closed = False
        self._work: threading.Thread | None = None
        self._doing: Entry = {}
        self._error = ""
        self._comparisons: WeakKeyDictionary[Stage, Comparison] = WeakKeyDictionary()
        self._scored: Candidates | None = None  # of the stage that was scored last
        self._forces: WeakKeyDictionary[Stage, dict[str, UnknownForce]] = WeakKeyDictionary()  # known, by place
        self._kinds: dict[str, Entry] = {}  # laws with their pictures, which take long to draw
        self._beginning = threading.Lock()
        self._building = threading.Lock()  # stages of another branch are built once
        study.progress = self._progress
        study.checkpoint = lambda study: save_history(study, self.history)

    # ---------------------------------------------------------------- work in hand

    def begin(self, what: str, work: Callable[[], object], *, yields: bool = False) -> None:
        """Begin a piece of work in a thread.

        Parameters
        ----------
        what : str
        work : callable
        yields : bool
            The work was not asked for by the person: it is stopped as soon as something else is.

        Raises
        ------
        Busy
            If there is one in hand that does not yield.
        """
        with self._beginning:  # two requests at once: one is after the other, and what it finds in hand has started
            if self._doing.get("yields") and not yields:
                self.stop()
                self.join()
            with self._changed:
                if self._work is not None:
                    raise Busy(f"wait until '{self._doing.get('what', '')}' is done, or stop it")
                self._stop.clear()
                self._error, self._doing = "", {"what": what, "text": "", "share": None, "yields": yields}
                self._work = threading.Thread(target=self._run, args=(work,), daemon=True)
            self._announce()
            self._work.start()

    def _run(self, work: Callable[[], object]) -> None:
        unsubscribe = on_compile(lambda name, seconds: self._progress("compile the model's equations"))
        try:
            work()
        except Stopped:
            self._error = "stopped: what was finished before is kept"
        except Exception as error:
            self._error = f"{error.args[0] if isinstance(error, KeyError) and error.args else error}"
            if not isinstance(error, KeyError | ValueError | RuntimeError | OSError):
                self._error = f"a fault in the program: {type(error).__name__}: {error}"
                traceback.print_exc()
        finally:
            unsubscribe()
        with self._changed:
            self._work, self._doing = None, {}
        self._announce()

    def stop(self) -> None:
        """Stop the work in hand at its next report of progress."""
        self._stop.set()

    def close(self) -> None:
        """Stop the work in hand and let those go who wait for news: the command ends."""
        self.stop()
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def wait(self, version: int, seconds: float) -> None:
        """Return when something has changed since a version, after some seconds, or when the session is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self.version != version, seconds)

    def join(self) -> None:
        """Wait for the work in hand."""
        work = self._work
        if work is not None:
            work.join()

    def _progress(self, text: str) -> None:
        if threading.current_thread() is not self._work and self._work is None:
            return
        if self._doing.get("yields"):
            self.giving_way.rest()
        if self._stop.is_set():
            raise Stopped
        share = text.share if isinstance(text, Step) else None
        self._doing = {**self._doing, "text": str(text), "share": share}
        self._announce()

    def _announce(self) -> None:
        with self._changed:
            self.version += 1
            self._changed.notify_all()

    # ---------------------------------------------------------------- steps

    def do(self, action: str, given: Mapping[str, Any]) -> None:
        """Take a step of the study; its outcome is in `state`.

        Parameters
        ----------
        action : str
            ``"score"``, ``"add"``, ``"add_curve"``, ``"undo"``, ``"redo"``, ``"switch"``, ``"leave_out"``,
            ``"use_again"``, ``"set_prior"``, ``"force"``, ``"search"`` or ``"conclude"``.
        given : mapping
            Arguments of the `Study` method of that name.

        Raises
        ------
        Busy
            If something is being computed.
        ValueError
            If there is no such step, or an argument is missing.
        """
        study = self.study
        try:
            steps: dict[str, tuple[str, Callable[[], object]]] = {
                "score": ("score the candidates", self._score),
                "undo": ("undo", study.undo),
                "redo": ("redo", study.redo),
                "search": ("search on from here", study.diagnose),
                "conclude": ("conclude", study.conclude),
            }
            if action == "add":
                name = str(given["effect"])
                steps["add"] = (f"add {name} and fit again", lambda: study.add(name, strength=given.get("strength")))
            if action in ("leave_out", "use_again"):
                stretch = {k: float(given[k]) for k in ("start", "stop") if given.get(k) is not None}
                record, how = str(given["record"]), "without" if action == "leave_out" else "with"
                steps[action] = (
                    f"fit again {how} {'a stretch of ' if stretch else ''}{record}",
                    lambda: getattr(study, action)(record, **stretch),
                )
            if action == "switch":
                branch = int(given["branch"])
                steps["switch"] = ("go on from another branch", lambda: study.switch(branch))
            if action == "set_prior":
                name = str(given["name"])
                prior = {k: None if given.get(k) is None else float(given[k]) for k in ("value", "std")}
                steps["set_prior"] = (f"fit again with another prior of {name}", lambda: study.set_prior(name, **prior))
            if action == "force":
                where = str(given["where"])
                steps["force"] = (f"estimate the missing force at {where}", lambda: self._estimate(where))
            if action == "add_curve":
                where, over = str(given["where"]), str(given["over"])
                steps["add_curve"] = (
                    f"add a curve over {over} at {where} and fit again",
                    lambda: study.add_curve(where, over),
                )
        except KeyError as error:
            raise ValueError(f"'{action}' needs {error}") from None
        if action not in steps:
            raise ValueError(f"'{action}' is no step: take one of {', '.join(steps)}")
        self.begin(*steps[action], yields=bool(given.get("yields")) and action == "score")

    def _estimate(self, where: str) -> None:
        force = self.study.unknown_force(where)
        self._forces.setdefault(self.study.stage, {})[where] = force

    def _score(self) -> None:
        self._scored = self.study.candidates()

    # ---------------------------------------------------------------- what the page shows

    def state(self) -> Entry:
        """Return everything that the page shows but the figures and the candidates."""
        for _ in range(READINGS):
            # first, or a step that ends meanwhile would show the stages before it as what stands after it
            version, doing = self.version, self._doing
            entry = self._read(version, doing)
            if self.version == version or (doing and not doing.get("yields")):
                break  # else a step may have begun meanwhile: what was read is partly from before it
        return entry

    def _read(self, version: int, doing: Entry) -> Entry:
        study = self.study
        stages = list(study.stages)
        outputs = (
            []
            if not stages
            else [
                {
                    "name": n,
                    "unit": unit_text(stages[0].system.unit(n)),
                    "noise": stages[-1].noise.get(n) or None,
                }
                for n in stages[0].outputs
            ]
        )
        return {
            "version": version,
            "name": study.problem.name,
            "doing": doing or None,
            "error": self._error,
            "outputs": outputs,
            "stages": [self._stage(s) for s in stages],
            "branches": [{"names": b.names, "title": _branch_title(b)} for b in study.branches()] if stages else [],
            "records": [
                {"name": e.name, "part": part}
                for part, group in (("identify", study.problem.identify), ("validate", study.problem.validate))
                for e in group
            ],
            "left_out": [{**s.to_dict(), "words": str(s)} for s in study.left_out],
            "priors": [p.to_dict() for p in study.priors],
            "steps": study.steps,
            "scored": bool(stages) and self._scored is not None and self._scored.stage is stages[-1],
            "can_undo": study.can_undo,
            "can_redo": study.can_redo,
            "conclusion": dict(study.answer),
            "history": str(self.history),
            "parameters": self._parameters(stages[-1]) if stages else [],
        }

    def _stage(self, stage: Stage) -> Entry:
        return {
            "name": stage.name,
            "title": _title(stage),
            "effects": [str(e) for e in stage.effects],
            "rmse": {part: stage.rmse(part) for part in ("identify", "validate")},
        }

    def _parameters(self, stage: Stage) -> list[Entry]:
        calibration = stage.identify
        entries = []
        for q, std in zip(calibration.parameters, calibration.std, strict=True):
            value = float(calibration[q.name])
            reach = max(4.0 * float(std) if np.isfinite(std) else 0.0, 0.5 * abs(value)) or 1.0
            low, high = max(value - reach, q.min), min(value + reach, q.max)
            if q.name in stage.system.parameter_names:
                entry = {"name": q.name, "unit": unit_text(q.unit), "value": value, "low": low, "high": high}
                prior = {"value": float(q.value), "std": float(q.std) if np.isfinite(q.std) else None}
                entries.append({**entry, "std": float(std) if np.isfinite(std) else None, "prior": prior})
        return entries

    def _end(self, number: int) -> tuple[Stage, ...]:
        """Return the stages of a branch: of the present one, number 0, or of another."""
        if number <= 0:
            return tuple(self.study.stages)
        branches = self.study.branches()
        if number > len(branches):
            raise KeyError(f"there is no branch {number}: the history has {len(branches)} beside the present one")
        with self._building:
            return branches[number - 1].stages

    def _other(self, number: int) -> Stage:
        """Return a stage to compare with: one of the present branch, or where another ends."""
        stages = list(self.study.stages)
        if number < len(stages):
            return stages[max(number, 0)]
        if number - len(stages) < len(self.study.branches()):
            return self._end(1 + number - len(stages))[-1]
        return stages[-1]

    def _comparison(self, stage: Stage) -> Comparison:
        if stage not in self._comparisons:
            self._comparisons[stage] = compare(stage)
        return self._comparisons[stage]

    def figures(
        self,
        record: str = "",
        *,
        start: float = -np.inf,
        stop: float = np.inf,
        against: int = 1,
        predict: str = "",
        values: Mapping[str, float] | None = None,
        outputs: Collection[str] | None = None,
        columns: int | None = None,
        ends: Sequence[int] | None = None,
    ) -> list[Entry]:
        """Return the figures of a record: measurement, a stage to compare with, the latest stage, and a prediction.

        Parameters
        ----------
        record : str
            Default: the first.
        start, stop : float, s
            The visible stretch.
        against : int
            Number of the stage to compare with, among those of the study and then those of other branches.
        predict : str
            Candidate whose linear prediction is drawn too, once it was scored; of identification records only.
        values : mapping of str to float, optional
            Values of parameters: the latest model simulated with them is drawn too.
        outputs : collection of str, optional
            Those whose numbers are wanted; the figures of the others have empty lines.  Default: all.
        columns : int, optional
            Pixels across a figure: two points are kept in each, the smallest and the largest.
        ends : two ints, optional
            Numbers of the branches to draw instead, by where they end; 0 is the present one.
        """
        stages = list(self.study.stages)
        if not stages:
            return []
        latest, other = (self._end(k)[-1] for k in ends) if ends else (stages[-1], self._other(against))
        compared = self._comparison(latest)
        if record not in {s.record for s in compared}:
            record = compared.of()[0].record
        return record_figures(
            latest,
            compared,
            other,
            self._comparison(other),
            record=record,
            start=start,
            stop=stop,
            prediction=self._candidates().predict(predict) if predict else None,
            changed=simulate_with(latest, values, record) if values else None,
            outputs=outputs,
            columns=columns,
            names=BRANCHES if ends else None,
        )

    def branches(self, one: int = 0, other: int = 1) -> Entry:
        """Return two branches: their stages with the errors of every output, and the records that each has.

        Parameters
        ----------
        one, other : int
            Numbers; 0 is the present branch.
        """
        shown = []
        now = Snapshot.of(self.study)
        for number in (one, other):
            stages = self._end(number)
            at = now if number <= 0 else self.study.branches()[number - 1]
            records = list(dict.fromkeys(s.record for s in self._comparison(stages[-1])))
            shown.append(
                {
                    "number": number,
                    "differs": at.differs(),
                    "stages": [self._stage(s) for s in stages],
                    "records": records,
                    "outputs": list(stages[-1].outputs),
                }
            )
        titles = ["the present branch", *map(_branch_title, self.study.branches())]
        return {"titles": titles, "shown": shown}

    def _candidates(self) -> Candidates:
        """Return the candidates of the latest stage as they were scored; what is shown computes no stage."""
        if self._scored is None or self._scored.stage is not self._latest():
            raise ValueError("the candidates have not been scored yet")
        return self._scored

    def candidates(self) -> Entry:
        """Return the best candidates with what they are expected to change; only after they have been scored."""
        return candidate_list(self._candidates())

    def kind(self, name: str) -> Entry:
        """Return the law of a kind in words and its picture as SVG, where there is one."""
        if name not in self._kinds:
            kind = kind_named(name)
            self._kinds[name] = {"law": law_of(kind), "picture": kind_picture(kind) if has_picture(kind) else ""}
        return self._kinds[name]

    def machine(self) -> Entry:
        """Return the graph of the model: its components and their connections."""
        return views.machine(self.study.problem.model)

    def _latest(self) -> Stage:
        """Return the latest stage; a question makes none, which would be beside the work in hand."""
        stages = list(self.study.stages)
        if not stages:
            raise ValueError("the model is being compared with the records: ask again when that is done")
        return stages[-1]

    def where(self) -> list[Entry]:
        """Return in sentences where the latest model fails."""
        return views.where(self._latest())

    def against_motion(self, output: str) -> Entry:
        """Return the latest residual of an output over the motion and the load of every connection that moves."""
        return views.against_motion(self._latest(), output)

    def spectra(self, record: str = "") -> list[Entry]:
        """Return spectra and coherence of each output, and frequency responses from each input."""
        stage = self._latest()
        return views.spectra(stage, self._comparison(stage), record)

    def table(self, against: int | None = None) -> list[Entry]:
        """Return the error of the latest stage by record and output, and of a stage to compare with."""
        latest = self._latest()
        other = latest if against is None else self._other(against)
        return views.by_record(self._comparison(latest), None if other is latest else self._comparison(other))

    def force(self, where: str) -> Entry:
        """Return what is known of the missing force at a place, once it has been estimated, and what could be tried."""
        stage = self._latest()
        places = [p.name for p in stage.system.places]
        known = self._forces.get(stage, {})
        if where not in known:
            return {"places": places, "known": False}
        return {"places": places, "known": True, **force_view(known[where])}


def _title(stage: Stage) -> str:
    """Return a stage's title in words; of an added effect what it is and where."""
    if not stage.effects:
        return stage_title(stage)
    latest = stage.effects[-1]
    return f"+ {latest.definition.text.title} at {latest.where}"


def _branch_title(at: Snapshot) -> str:
    """Return in words where a branch ends, and what it was fitted to."""
    words = []
    for name in at.names[2:] or at.names[-1:]:
        kind, _, where = name.removeprefix("+ ").partition("@")
        words.append(f"+ {kinds()[kind].text.title} at {where}" if kind in kinds() else name)
    return ", ".join([" ".join(words), *([at.differs()] if at.differs() else [])])
