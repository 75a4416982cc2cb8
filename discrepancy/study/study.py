"""A study: a search with the methods that users call."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.conclusion.conclude import conclude
from discrepancy.conclusion.conclusion import Conclusion
from discrepancy.effects.effect import Effect
from discrepancy.evidence.search import EvidenceSearch
from discrepancy.problem.problem import read_problem
from discrepancy.questions.compare import Comparison, compare
from discrepancy.questions.locate import WhereItFails, locate
from discrepancy.questions.unknown_force import UnknownForce
from discrepancy.search.decision import Decision
from discrepancy.search.loop import Search
from discrepancy.search.state import SearchState
from discrepancy.stages.stage import AcceptedEffect, Stage
from discrepancy.study.candidates import Candidates, Prediction, candidates_of, named_effect
from discrepancy.study.left_out import Stretch, stretch_of, stretches_in, without_stretches
from discrepancy.study.priors import Prior, with_priors
from discrepancy.study.snapshot import Snapshot, ends
from discrepancy.study.unknown import curve_at, force_at
from discrepancy.study.what_if import simulate_with
from multibody.base.progress import silent, visible
from multibody.base.quantity_text import count_text
from multibody.base.stopping import go_on

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

__all__ = ["Study"]

#: States up to which "auto" searches by evidence: the machines that it was developed on have up to so many, and the
#: time of its filter grows with the cube of them.
MOST_STATES_BY_EVIDENCE = 10


@dataclass(repr=False)
class Study(SearchState):
    """A model compared with records, and every stage of the search for what it lacks.

    Make one with `Study.from_file`, then call `diagnose`, or take the steps yourself: `compare`, `locate`,
    `candidates`, `predict`, `explain`, `add`, `leave_out`, `use_again`, `set_prior`, `undo`, `redo`, `switch`.  `plot`
    and `report` show where it stands.
    Parameters and attributes are those of `discrepancy.search.state.SearchState` and these:

    Parameters
    ----------
    steps : list of dict
        What was asked of this study, in order; `discrepancy.study.script` writes it as a script.
    left_out : list of Stretch
        Stretches of records that are not used.
    priors : list of Prior
        Priors of uncertain parameters that are not as the study file has them.
    answer : mapping
        ``verdict``, ``sentence`` and ``next_measurement`` of the latest conclusion, while the stages are those of it.
    past, undone, cut : list of Snapshot
        The study before each step, after each step that was undone, and what could no longer be redone.

    Attributes
    ----------
    source : Problem
        As handed in, with every record whole.
    """

    steps: list[dict[str, Any]] = field(default_factory=list, kw_only=True)
    left_out: list[Stretch] = field(default_factory=list, kw_only=True)
    priors: list[Prior] = field(default_factory=list, kw_only=True)
    answer: Mapping[str, Any] = field(default_factory=dict, kw_only=True)
    past: list[Snapshot] = field(default_factory=list, kw_only=True)
    undone: list[Snapshot] = field(default_factory=list, kw_only=True)
    cut: list[Snapshot] = field(default_factory=list, kw_only=True)

    def __post_init__(self) -> None:
        if isinstance(self.problem, str | Path):
            raise TypeError(f"Study takes a Problem: a study file is read by Study.from_file({str(self.problem)!r})")
        super().__post_init__()
        self.source = self.problem

    @classmethod
    def from_file(
        cls,
        path: str | Path,
        *,
        seed: int | None = None,
        max_effects: int | None = None,
        progress: Callable[[str], None] = silent,
    ) -> Study:
        """Return the study that a study file describes; see `discrepancy.problem.problem.read_problem`."""
        return cls(read_problem(path, seed=seed, max_effects=max_effects), progress)

    def compare(self) -> Comparison:
        """Compare the latest stage with the records."""
        return compare(self.stage)

    def locate(self) -> WhereItFails:
        """Locate the error of the latest stage: signals, regimes, frequencies, connections."""
        return locate(self.stage)

    def candidates(self) -> Candidates:
        """Score every candidate on the latest stage, without refits; nothing is added."""
        with self._progress_shown():
            return candidates_of(self)

    def predict(self, name: str) -> Prediction:
        """Return what a candidate such as ``"coulomb_friction@guide"`` is expected to change, without a simulation."""
        return self.candidates().predict(name)

    def what_if(self, values: Mapping[str, float], record: str) -> np.ndarray:
        """Return the outputs of the latest model on a record with other parameters; see `simulate_with`."""
        return simulate_with(self.stage, values, record)

    def explain(self) -> Decision:
        """Score every candidate on the latest stage and refit the best; nothing is added yet."""
        with self._progress_shown():
            return Search(self).explain()

    def add(
        self,
        effect: Effect | str,
        accepted: AcceptedEffect | None = None,
        *,
        strength: float | Mapping[str, float] | None = None,
        shape: Mapping[str, float] | None = None,
    ) -> Stage:
        """Add an effect to the model, fit again, and make that the latest stage.

        Where the machine cannot be simulated with the strengths given, the fit begins at smaller ones.

        Parameters
        ----------
        effect : Effect or str
            An effect, or the name of a candidate such as ``"coulomb_friction@guide"``; it takes the place of simpler
            effects that it contains.
        accepted : AcceptedEffect, optional
            Why it is added, as `explain` gives it (``decision.accepted``); by default the effect counts as given.
        strength : float or mapping of str to float, optional
            Of a candidate, SI, where the fit begins; default: what its score lets expect.
        shape : mapping of str to float, optional
            Other parameters of a candidate's law where the fit begins.

        Raises
        ------
        KeyError
            If there is no candidate of that name.
        ValueError
            If its law has no such strength or parameter.
        SimulationError
            If the machine cannot be simulated with a hundredth of the strengths either.
        """
        step: dict[str, Any] = {"action": "add", "effect": str(effect)}
        replaced: tuple[Effect, ...] = ()
        if isinstance(effect, str):
            given = {"strength": dict(strength) if isinstance(strength, Mapping) else strength, "shape": shape}
            step |= {k: v for k, v in given.items() if v}
            with self._progress_shown():
                effect, replaced = named_effect(self, effect, strength, shape)
        else:
            step |= {"strength": dict(effect.strengths), "shape": dict(effect.shape)}
            _ = self.stage  # made on first use, and not by this step
        with self._step(step):
            Search(self).add(effect, accepted, replaced)
        return self.stage

    def unknown_force(self, where: str) -> UnknownForce:
        """Return the force at a place that would explain all of the residual, over time and over what it depends on."""
        with self._progress_shown():
            return force_at(self, where)

    def add_curve(self, where: str, over: str = "position") -> Stage:
        """Add a force given by points, fit again, and make that the latest stage.

        Parameters
        ----------
        where : str
            Place, as of the effects there.
        over : str
            What it is a function of: ``"position"``, ``"speed"``, ``"time"``, or ``"friction"``, a level over the
            position that turns with the direction.

        Raises
        ------
        KeyError
            If there is no such place, or nothing to be a function of.
        """
        with self._progress_shown():
            curve = curve_at(self, where, over)
        with self._step({"action": "add_curve", "where": where, "over": over}):
            Search(self).add(curve, None)
        return self.stage

    def leave_out(self, record: str, start: float = -np.inf, stop: float = np.inf) -> Stage:
        """Leave a stretch of a record out, or the whole record, and fit every stage again without it.

        Parameters
        ----------
        record : str
            Name of a record, or of a part of one.
        start, stop : float, s
            Default: the record's own beginning and end.

        Raises
        ------
        KeyError
            If there is no such record.
        ValueError
            If the stretch is empty, or nothing would be left to fit.
        """
        stretch = stretch_of(self.source, self.problem, Stretch(record, start, stop))
        with self._step({"action": "leave_out", **stretch.to_dict()}):
            self._fit_again([*self.left_out, stretch], self.priors)
        return self.stage

    def use_again(self, record: str, start: float = -np.inf, stop: float = np.inf) -> Stage:
        """Use what was left out of a record again, and fit every stage again with it.

        Parameters
        ----------
        record : str
        start, stop : float, s
            Only what was left out within these times; default: all that was left out of the record.

        Raises
        ------
        KeyError
            If nothing of such a record is left out there.
        """
        stretch = Stretch(record, start, stop)
        again = stretches_in(self.left_out, stretch)
        with self._step({"action": "use_again", **stretch.to_dict()}):
            self._fit_again([s for s in self.left_out if s not in again], self.priors)
        return self.stage

    def set_prior(self, name: str, value: float | None = None, std: float | None = None) -> Stage:
        """State another value or standard deviation of an uncertain parameter, and fit every stage again with it.

        Parameters
        ----------
        name : str
            Parameter by full name.
        value, std : float, optional
            SI; default: as the study file has it.

        Raises
        ------
        KeyError
            If it is no uncertain parameter.
        ValueError
            If the value is outside its bounds, or the standard deviation is not positive.
        """
        prior = Prior(name, value, std)
        with_priors(self.source, [prior])  # refuses what cannot be
        with self._step({"action": "set_prior", **prior.to_dict()}):
            stated = [] if value is None and std is None else [prior]
            self._fit_again(self.left_out, [*(p for p in self.priors if p.name != name), *stated])
        return self.stage

    def _fit_again(self, stretches: Sequence[Stretch], priors: Sequence[Prior]) -> None:
        """Make the stages that there are again without some stretches, and with other priors."""
        before = self.stages[2:]
        self.begin_with(stretches, priors)
        for earlier in before:
            current, effects = self.stage, earlier.effects
            name = f"+ {effects[-1]}" if effects else current.name
            stage = self.fitted(name, effects, current, current.noise, begin=earlier.identify.to_dict())
            self.stages.append(replace(stage, accepted=earlier.accepted))

    def begin_with(self, stretches: Sequence[Stretch], priors: Sequence[Prior]) -> None:
        """Use the records without some stretches, and other priors, and forget every stage."""
        self.problem = self.given = with_priors(without_stretches(self.source, stretches), priors)
        self.left_out[:], self.priors[:] = list(stretches), list(priors)
        self.prepared, self.in_windows_instead, self.answer = None, False, {}
        for forgotten in (self.stages, self.decisions, self.unanswered, self.taken_back):
            forgotten.clear()

    # ---------------------------------------------------------------- steps back and forth

    def undo(self) -> Stage:
        """Take the latest step back, whatever it was: all effects of a search together; `redo` takes it again."""
        return self._move(self.past, self.undone, "undo")

    def redo(self) -> Stage:
        """Take the step again that was undone last, as it ended then; nothing is computed."""
        return self._move(self.undone, self.past, "redo")

    @property
    def can_undo(self) -> bool:
        """True if there is a step that `undo` would take back."""
        return bool(self.past)

    @property
    def can_redo(self) -> bool:
        """True if there is something that `redo` would bring back."""
        return bool(self.undone)

    def _move(self, moments: list[Snapshot], others: list[Snapshot], action: str) -> Stage:
        if moments:
            now = Snapshot.of(self)
            moments[-1].put_back(self)
            moments.pop()
            others.append(now)
            self._log({"action": action})
        return self.stage

    def branches(self) -> tuple[Snapshot, ...]:
        """Return where the other branches of the history end: what was undone, replaced, or fitted to other records."""
        return ends(Snapshot.of(self), [*self.cut, *self.past, *reversed(self.undone)])

    def switch(self, branch: int) -> Stage:
        """Go on from the end of another branch; nothing is computed, and `undo` comes back.

        Parameters
        ----------
        branch : int
            Its number in `branches`.

        Raises
        ------
        KeyError
            If there is no such branch.
        """
        known = self.branches()
        if not 0 <= branch < len(known):
            numbers = f"take one of 0 to {len(known) - 1}" if known else "the history has only one"
            raise KeyError(f"there is no branch {branch}: {numbers}")
        with self._step({"action": "switch", "branch": branch}):
            known[branch].put_back(self)
        return self.stage

    @contextmanager
    def _step(self, step: dict[str, Any]) -> Iterator[None]:
        """Take a step, which is undone as a whole; where it fails or is stopped, everything is as before it."""
        before = Snapshot.of(self)
        self.answer = {}
        try:
            with self._progress_shown():
                yield
        except BaseException:
            before.put_back(self)
            if self.stages:
                self.save()  # the step may have saved what it had made until then
            raise
        self._keep(before)
        self._log(step)

    def _keep(self, before: Snapshot) -> None:
        for earlier in (*self.past, *self.undone):  # `before` keeps them: a step is often undone at once
            earlier.forget_results([*self.stages, *before.stages])
        self.past.append(before)
        self.cut += self.undone
        self.undone.clear()

    def _log(self, step: dict[str, Any]) -> None:
        self.steps.append(step)
        self.save()

    @contextmanager
    def _progress_shown(self) -> Iterator[None]:
        """Show progress below the cell of a notebook, unless another display was asked for."""
        given = self.progress
        with visible(given) as self.progress:
            try:
                yield
            finally:
                self.progress = given

    def _begin(self) -> None:
        with self._progress_shown():
            super()._begin()

    def diagnose(self) -> Conclusion:
        """Search for what the model lacks, as ``problem.search`` says; then conclude."""
        with self._progress_shown():
            return self._diagnosed()

    def searches_by_evidence(self) -> bool:
        """Tell whether `diagnose` searches by evidence: where the study says so, or, on "auto", where it was tried.

        That is where whole records of a small machine are simulated.  A machine with a part that steps itself is
        searched by steps.
        """
        if self.problem.model.stepped_part:  # evidence asks for states and rates
            return False
        if self.problem.search != "auto":
            return self.problem.search == "evidence"
        self.prepare()
        # The filter of the evidence takes all outputs at one instant.
        own_clocks = any(e.at_own_instants for e in self.problem.identify)
        few_states = len(self.stage.system.states) <= MOST_STATES_BY_EVIDENCE
        return self.mode == "simulation" and not own_clocks and few_states

    def restart_search(self) -> None:
        """Go back to before the latest search, if it is by evidence: what it had tried is not in a history.

        A search by steps goes on from its latest stage.
        """
        if self.past and self.steps and self.steps[-1]["action"] == "search" and self.searches_by_evidence():
            self.past[-1].put_back(self)

    def _diagnosed(self) -> Conclusion:
        self.interrupted, self.interruption, self.untested = False, "", ""
        _ = self.stage  # made on first use
        self._keep(Snapshot.of(self))
        self.answer = {}
        step: dict[str, Any] = {"action": "search"}
        self._log(step)
        by_evidence: EvidenceSearch | None = None
        self.start_clock()
        try:
            if self.searches_by_evidence():
                by_evidence = EvidenceSearch(self)
                by_evidence.run()
                self.if_simulated("whether parameters alone explain as much", Search(self).test_prior_conflict)
            if by_evidence is None or (not by_evidence.announcement.unconfirmed and self._cut_into_windows()):
                by_evidence = None
                Search(self).run()
        except KeyboardInterrupt as stopped:
            step["stopped"] = self.interrupted = True
            self.save()
            self.interruption = str(stopped) or "interrupted"
            self.untested = by_evidence.untested() if by_evidence is not None else ""
            go_on()
        return self._answered(conclude(self, by_evidence))

    def _cut_into_windows(self) -> bool:
        """Begin again with windows where whole records cannot be simulated well and nothing explains that.

        An effect that is probable and predicts the records held out no better does explain it.
        """
        if self.accepted_stages or self.mode != "simulation" or self.given.residual != "auto":
            return False
        return self.cut_into_windows(self.stages[1].rmse("identify"))

    def to_frame(self) -> pandas.DataFrame:
        """Return the root mean square error of every output, stage by stage, on both parts."""
        import pandas

        rows = {}
        for stage in self.stages:
            row = {}
            for part in ("identify", "validate"):
                for name, value in stage.rmse(part).items():
                    row[part, f"{name} [{stage.system.unit(name)}]"] = value
            rows[stage.name] = row
        names = list(dict.fromkeys(name for row in rows.values() for name in row))
        columns = pandas.MultiIndex.from_tuples(names) if names else None
        cells = [[row.get(name, np.nan) for name in names] for row in rows.values()]
        return pandas.DataFrame(cells, index=list(rows), columns=columns)

    def conclude(self) -> Conclusion:
        """Return the conclusion of the stages as they are, without a search."""
        _ = self.stage
        return self._answered(conclude(self))

    def _answered(self, conclusion: Conclusion) -> Conclusion:
        words = {k: getattr(conclusion, k) for k in ("verdict", "sentence")}
        self.answer = {**words, "next_measurement": list(conclusion.next_measurement)}
        self.save()
        return conclusion

    def plot(self) -> Figure:
        """Draw the error of the outputs from stage to stage: of all, or of the worst where there are many."""
        from discrepancy.report.figures import falling_error

        _ = self.stage
        return falling_error(Conclusion(verdict="", sentence="", stages=tuple(self.stages)))

    def report(self, path: str | Path) -> Path:
        """Write the report of the stages as they are, and return its path.

        Parameters
        ----------
        path : str or Path
            A page (``"report.html"``), which is written alone; or a folder, for the page with its figures, JSON and
            the model of every stage.
        """
        from discrepancy.report.write import write_page, write_report

        path = Path(path)
        if path.suffix in (".html", ".htm"):
            return write_page(self.conclude(), path)
        write_report(self.conclude(), path)
        return path / "report.html"

    def _repr_html_(self) -> str:
        from discrepancy.stages.errors_view import errors_view

        text = f"{count_text(len(self.problem.identify), 'record')} to fit, {len(self.problem.validate)} held out."
        return errors_view(f"Study '{self.problem.name}'", self.stages, text)

    def __repr__(self) -> str:
        records = f"{len(self.problem.identify)} + {len(self.problem.validate)} records"
        return f"Study({self.problem.name!r}: {records}, {count_text(len(self.stages), 'stage')})"
