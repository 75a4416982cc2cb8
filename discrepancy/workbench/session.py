"""A study that is open in the workbench: what the page shows of it, and the one piece of work in hand."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from discrepancy.effects.kind_picture import has_picture, kind_picture
from discrepancy.effects.kinds import kind_named
from discrepancy.effects.law_in_words import law_of
from discrepancy.questions.compare import Comparison, compare
from discrepancy.report.figures import stage_title
from discrepancy.stages.stage import Stage
from discrepancy.study.candidates import Candidates
from discrepancy.study.history import save_history
from discrepancy.study.study import Study
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
        self._conclusion: Entry = {}
        self._comparisons: dict[int, Comparison] = {}
        self._scored: Candidates | None = None  # of the stage that was scored last
        self._forces: dict[int, set[str]] = {}  # places whose missing force is known, by stage
        self._kept: list[Stage] = []  # stages that were undone or replaced, which another branch is compared with
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
        before = list(self.study.stages)
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
        self._kept += [s for s in before[2:] if s not in self.study.stages and s not in self._kept]
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
            ``"score"``, ``"add"``, ``"add_curve"``, ``"undo"``, ``"redo"``, ``"leave_out"``, ``"set_prior"``,
            ``"force"``, ``"search"`` or ``"conclude"``.
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
                "search": ("search on from here", lambda: self._keep_conclusion(study.diagnose())),
                "conclude": ("conclude", lambda: self._keep_conclusion(study.conclude())),
            }
            if action == "add":
                name = str(given["effect"])
                steps["add"] = (f"add {name} and fit again", lambda: study.add(name, strength=given.get("strength")))
            if action == "leave_out":
                stretch = {k: float(given[k]) for k in ("start", "stop") if given.get(k) is not None}
                record = str(given["record"])
                steps["leave_out"] = (
                    f"fit again without {'a stretch of ' if stretch else ''}{record}",
                    lambda: study.leave_out(record, **stretch),
                )
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
        self.study.unknown_force(where)
        self._forces.setdefault(id(self.study.stage), set()).add(where)

    def _score(self) -> None:
        self._scored = self.study.candidates()

    def _keep_conclusion(self, conclusion: Any) -> None:
        self._conclusion = {"verdict": conclusion.verdict, "sentence": conclusion.sentence}

    # ---------------------------------------------------------------- what the page shows

    def state(self) -> Entry:
        """Return everything that the page shows but the figures and the candidates."""
        study = self.study
        # first, or a step that ends meanwhile would show the stages before it as what stands after it
        version, doing = self.version, self._doing
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
            "kept": [{"name": s.name, "effects": list(map(str, s.effects))} for s in self._kept],
            "records": [
                {"name": e.name, "part": part}
                for part, group in (("identify", study.problem.identify), ("validate", study.problem.validate))
                for e in group
            ],
            "left_out": [s.to_dict() for s in study.left_out],
            "steps": study.steps,
            "scored": bool(stages) and self._scored is not None and self._scored.stage is stages[-1],
            "can_undo": len(stages) > 2,
            "can_redo": study.can_redo,
            "conclusion": self._conclusion,
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

    def _branch(self, index: int) -> Stage:
        stages = [*self.study.stages, *self._kept]
        return stages[index] if -len(stages) <= index < len(stages) else stages[-1]

    def _comparison(self, stage: Stage) -> Comparison:
        key = id(stage)
        if key not in self._comparisons:
            self._comparisons[key] = compare(stage)
        return self._comparisons[key]

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
            Candidate whose linear prediction is drawn too; of identification records only.
        values : mapping of str to float, optional
            Values of parameters: the latest model simulated with them is drawn too.
        outputs : collection of str, optional
            Those whose numbers are wanted; the figures of the others have empty lines.  Default: all.
        columns : int, optional
            Pixels across a figure: two points are kept in each, the smallest and the largest.
        """
        stages = list(self.study.stages)
        if not stages:
            return []
        latest, other = stages[-1], self._branch(against)
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
            changed=self.study.what_if(values, record) if values else None,
            outputs=outputs,
            columns=columns,
        )

    def _candidates(self) -> Candidates:
        return self.study.candidates()

    def candidates(self) -> Entry:
        """Return the best candidates with what they are expected to change; only after they have been scored."""
        return candidate_list(self._candidates())

    def kind(self, name: str) -> Entry:
        """Return the law of a kind in words and its picture as SVG, where there is one."""
        kind = kind_named(name)
        return {"law": law_of(kind), "picture": kind_picture(kind) if has_picture(kind) else ""}

    def machine(self) -> Entry:
        """Return the graph of the model: its components and their connections."""
        return views.machine(self.study.problem.model)

    def where(self) -> list[Entry]:
        """Return in sentences where the latest model fails."""
        return views.where(self.study.stages[-1])

    def against_motion(self, output: str) -> Entry:
        """Return the latest residual of an output over the motion and the load of every connection that moves."""
        return views.against_motion(self.study.stages[-1], output)

    def spectra(self, record: str = "") -> list[Entry]:
        """Return spectra and coherence of each output, and frequency responses from each input."""
        stage = self.study.stages[-1]
        return views.spectra(stage, self._comparison(stage), record)

    def table(self, against: int | None = None) -> list[Entry]:
        """Return the error of the latest stage by record and output, and of a stage to compare with."""
        latest = self.study.stages[-1]
        other = latest if against is None else self._branch(against)
        return views.by_record(self._comparison(latest), None if other is latest else self._comparison(other))

    def force(self, where: str) -> Entry:
        """Return what is known of the missing force at a place, once it has been estimated, and what could be tried."""
        stage = self.study.stages[-1]
        places = [p.name for p in stage.system.places]
        if where not in self._forces.get(id(stage), ()):
            return {"places": places, "known": False}
        return {"places": places, "known": True, **force_view(self.study.unknown_force(where))}


def _title(stage: Stage) -> str:
    """Return a stage's title in words; of an added effect what it is and where."""
    if not stage.effects:
        return stage_title(stage)
    latest = stage.effects[-1]
    return f"+ {latest.definition.text.title} at {latest.where}"
