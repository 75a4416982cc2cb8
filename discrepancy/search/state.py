"""The state of a search: the problem, how model and records are compared, and every stage and decision so far.

The loop (`discrepancy.search.loop`) acts on it, the questions read it, and `discrepancy.study.study.Study` is the same
state with the methods that users call.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from discrepancy.effects.effect import Effect
from discrepancy.problem.problem import Problem, noise_floors
from discrepancy.search.decision import Decision
from discrepancy.stages.beyond_belief import beyond_belief
from discrepancy.stages.fit_stage import FittedValues, fitted_stage
from discrepancy.stages.stage import Stage
from estimation.fit.calibrate import evaluate
from multibody.base.errors import SimulationError
from multibody.base.progress import silent

if TYPE_CHECKING:
    from discrepancy.residual.prepared_problem import PreparedProblem
    from discrepancy.search.omnibus import Omnibus
    from discrepancy.search.prior_conflict_test import PriorConflict
    from estimation.fit.calibrate import Fit, UncertainParameter
    from estimation.response.experiment import Experiment

__all__ = ["SLOWER", "SearchState", "not_much_slower"]

Answer = TypeVar("Answer")

#: Times as many evaluations of the equations that a simulation may take where a model is moved to, as it takes where it
#: was: the equations are the same, and what takes longer is far from any machine.  Chosen.  One that took fewer than
#: its record has samples counts as many: what dry friction held throughout takes next to none, until it lets go.
SLOWER = 30


@dataclass(frozen=True, kw_only=True)
class TakenBack:
    """An effect that was significant, and that is not announced.

    Parameters
    ----------
    name : str
        As ``kind@where``.
    better, worse : tuple of str
        Outputs of the records held out whose error is clearly smaller with it, and larger.
    """

    name: str
    better: tuple[str, ...]
    worse: tuple[str, ...]


@dataclass
class SearchState:
    """A model compared with records, and every stage of the search for what it lacks.

    Parameters
    ----------
    problem : Problem
        Model, records and uncertain parameters, as they are used; see ``given``.
    progress : callable
        Gets a line of text for everything that takes a while.
    stages : list of Stage
        As given, recalibrated, then one for each effect.
    decisions : list of Decision
        Of every step that looked for an effect.
    prepared : PreparedProblem, optional
        How the residual is taken; chosen when the first stage is made.
    checkpoint : callable, optional
        Called with the state whenever a stage has been made, for instance to write its history.
    elimination_pending : bool
        True while it is open whether the latest effect has made an earlier one redundant.
    interrupted : bool
        True if a search was interrupted; its stages remain.
    interruption : str
        By what it was interrupted.
    untested : str
        What is said of the best model that was fitted before that and not tested further.
    in_windows_instead : bool
        True if simulations of whole records were replaced by windows.
    prior_conflict : PriorConflict, optional
        Parameters that, outside their stated uncertainty, explain as much as the first effect.
    omnibus : Omnibus, optional
        Whether the residual follows the machine's inputs; tested where no effect was found.
    remarks : list of str
        What the search has changed in the model before it asked what is missing.
    unanswered : list of str
        Questions that the latest stage could not answer, because its model could not be simulated for them.
    not_tried : list of str
        What the search left out because it had reached its time limit.
    taken_back : list of TakenBack
        Effects that were significant and not announced, because they make a prediction of records held out worse.

    Attributes
    ----------
    given : Problem
        As handed in, very long records in sections; ``problem`` may hold windows, or a copy of the model whose motion
        is prescribed.
    """

    problem: Problem
    progress: Callable[[str], None] = silent
    stages: list[Stage] = field(default_factory=list, kw_only=True)
    decisions: list[Decision] = field(default_factory=list, kw_only=True)
    prepared: PreparedProblem | None = field(default=None, kw_only=True)
    checkpoint: Callable[[Any], object] | None = field(default=None, kw_only=True)
    elimination_pending: bool = field(default=False, kw_only=True)
    interrupted: bool = field(default=False, kw_only=True)
    interruption: str = field(default="", kw_only=True)
    untested: str = field(default="", kw_only=True)
    in_windows_instead: bool = field(default=False, kw_only=True)
    prior_conflict: PriorConflict | None = field(default=None, kw_only=True)
    omnibus: Omnibus | None = field(default=None, kw_only=True)
    unanswered: list[str] = field(default_factory=list, kw_only=True)
    remarks: list[str] = field(default_factory=list, kw_only=True)
    not_tried: list[str] = field(default_factory=list, kw_only=True)
    taken_back: list[TakenBack] = field(default_factory=list, kw_only=True)

    def __post_init__(self) -> None:
        self.given = self.problem
        self._end = math.inf

    # ---------------------------------------------------------------- time

    def start_clock(self) -> None:
        """Let the time limit of a search begin."""
        self._end = time.process_time() + self.problem.time_limit
        self.not_tried.clear()

    def out_of_time_for(self, what: str) -> bool:
        """Tell whether the search has reached its time limit, and note what it leaves out for that."""
        if time.process_time() < self._end:
            return False
        self.progress(f"the time limit is reached: not tried: {what}")
        self.not_tried.append(what)
        return True

    # ---------------------------------------------------------------- how model and records are compared

    @property
    def mode(self) -> str:
        """How the residual is taken: ``"simulation"``, ``"prediction"`` or ``"inverse"``."""
        return self.prepared.mode if self.prepared is not None else self.problem.residual

    @property
    def mode_reason(self) -> str:
        """Why it is taken so."""
        return self.prepared.reason if self.prepared is not None else "chosen when the first stage is made"

    def prepare(self) -> None:
        """Choose how model and records are compared, if that has not been done yet."""
        from discrepancy.residual.residual_mode import prepared_problem
        from discrepancy.residual.sections import in_sections

        if self.prepared is None:
            self.given = in_sections(self._with_zeros(), self.progress)
            self._take(prepared_problem(self.given, self.progress))

    def _with_zeros(self) -> Problem:
        """Return the problem, with the zeros of recorded positions unknown where these contradict each other."""
        from discrepancy.problem.contradicting_positions import (
            contradicting_positions,
            contradiction_text,
            with_own_zeros,
        )

        outputs = contradicting_positions(self.problem)
        if not outputs:
            return self.problem
        if (text := contradiction_text(outputs)) not in self.remarks:
            self.progress(text)
            self.remarks.append(text)
        return with_own_zeros(self.problem, outputs)

    def _take(self, prepared: PreparedProblem) -> None:
        from discrepancy.residual.tolerances import with_tolerances

        self.prepared = prepared
        self.problem = with_tolerances(prepared.problem)

    def cut_into_windows(self, errors: Mapping[str, float] | None = None) -> bool:
        """Begin again with windows if simulations with these errors (or any) do not follow; tell whether that is so."""
        from discrepancy.residual.residual_mode import problem_in_windows

        windows = problem_in_windows(self.given, errors, self.progress)
        if windows is None:
            return False
        self._take(windows)
        self.in_windows_instead = True
        self.stages.clear()
        self.decisions.clear()
        self.unanswered.clear()
        self.taken_back.clear()
        self.omnibus = None
        return True

    # ---------------------------------------------------------------- stages

    @property
    def stage(self) -> Stage:
        """The latest stage; the first call makes "as given" and "recalibrated"."""
        if not self.stages:
            self._begin()
        return self.stages[-1]

    @property
    def accepted_stages(self) -> list[Stage]:
        """The stages that the search has made, each with one accepted effect more."""
        return [s for s in self.stages if s.accepted is not None]

    def _begin(self) -> None:
        self.prepare()
        self.progress("simulate the model as given")
        noise = noise_floors(self.problem.identify, self.problem.noise)
        self.stages.append(self.fitted("as given", (), None, noise, calibrated=False))
        self.progress("recalibrate the uncertain parameters")
        self.stages.append(self.fitted("recalibrated", (), None, noise))
        if fault := beyond_belief(self.stages[-1]):
            self.stages.clear()
            raise SimulationError(fault)
        self.save()

    def save(self) -> None:
        """Call the checkpoint: a stage has been made or changed."""
        if self.checkpoint is not None:
            self.checkpoint(self)

    def if_simulated(self, question: str, answer: Callable[[], Answer]) -> Answer | None:
        """Return an answer; None, and a note in ``unanswered``, where the latest model cannot be simulated for it."""
        try:
            return answer()
        except SimulationError as error:
            self.unanswered.append(f"not tested on '{self.stages[-1].name}': {question}: {error}")
            self.progress(self.unanswered[-1])
            return None

    # ---------------------------------------------------------------- fits

    def fitted(self, name: str, effects: tuple[Effect, ...], start: Stage | None, noise: Any, **options: Any) -> Stage:
        """Return a fitted stage of this problem; options as of `fitted_stage`.

        A record held out that its model cannot be simulated on is no longer used, in no stage.
        """
        stage = fitted_stage(
            self.problem, self.given.model, name, effects, start, noise, progress=self.progress, **options
        )
        if not options.get("trial") and len(stage.fits("validate")) < len(self.problem.validate):
            self._without_failing(stage)
        return stage

    def _without_failing(self, stage: Stage) -> None:
        """Take the records held out that a stage could not be simulated on out of the problem and of every stage."""
        kept = {f.experiment.name for f in stage.fits("validate")}
        failing = [e.name for e in self.problem.validate if e.name not in kept]
        self.unanswered.append(
            f"held out, but not used: the model '{stage.name}' cannot be simulated on {' and '.join(failing)}; leave "
            "the record out of [records] validate, or see why it fails with vtsdt check"
        )
        self.progress(self.unanswered[-1])
        self.problem = replace(self.problem, validate=tuple(e for e in self.problem.validate if e.name in kept))
        for k, earlier in enumerate(self.stages):
            if earlier.validate is not None:
                fits = tuple(f for f in earlier.validate.fits if f.experiment.name in kept)
                validate = replace(earlier.validate, fits=fits) if fits else None
                self.stages[k] = replace(earlier, validate=validate)

    def restored(
        self,
        name: str,
        effects: tuple[Effect, ...],
        values: Mapping[str, float],
        own: Sequence[np.ndarray],
        scale: Mapping[str, float],
        noise: Mapping[str, float],
        *,
        moved: bool = True,
        trial: bool = False,
        not_excited: tuple[str, ...] | None = None,
    ) -> Stage:
        """Return a stage at the values of an earlier fit; only each held-out record's own unknowns are fitted.

        Parameters that no output depends on are found by derivatives where they are not given as ``not_excited``.
        """
        given = FittedValues(values, own, scale, not_excited)
        return self.fitted(name, effects, None, dict(noise), calibrated=moved, values=given, trial=trial)

    def unfitted(self, name: str, effects: tuple[Effect, ...], start: Stage) -> Stage:
        """Return a stage with effects at given strengths and another's parameters: nothing is fitted."""
        values = start.identify.to_dict()
        for effect in effects:
            values |= effect.parameters()
        given = FittedValues(values, start.identify.own_values, start.identify.scale)
        return self.fitted(name, effects, None, dict(start.noise), values=given, trial=True)

    def moved_to(self, stage: Stage, values: Mapping[str, float], *, trial: bool = False) -> Stage:
        """Return a fitted stage at other values of its parameters; only each record's own unknowns are fitted there.

        Parameters
        ----------
        stage : Stage
        values : mapping of str to float
            Of every parameter that was calibrated, SI.
        trial : bool
            Without the records held out, and without intervals.
        """
        base = stage.system.parameter_vector({p.name: p.value for p in self.problem.uncertain})
        there = replace(stage.identify, values=np.array([values[p.name] for p in stage.identify.parameters]))
        records = [not_much_slower(f) for f in stage.identify.fits]
        at = evaluate(stage.slim, records, there, noise=stage.noise, sensors=stage.sensors, base=base)
        return self.restored(
            stage.name,
            tuple(e.with_values(values) for e in stage.effects),
            values,
            at.own_values,
            stage.identify.scale,
            stage.noise,
            trial=trial,
            not_excited=stage.identify.not_excited,
        )

    def with_effect(self, effect: Effect, instead_of: Sequence[Effect] = (), **options: bool) -> Stage:
        """Return the latest stage with an effect added, or replacing others, and everything fitted again."""
        current = self.stage
        kept = tuple(e for e in current.effects if e not in instead_of)
        return self.fitted(f"+ {effect}", (*kept, effect), current, current.noise, **options)

    def effect_on_trial(self, effect: Effect, instead_of: Sequence[Effect] = (), from_prior: bool = False) -> Stage:
        """Return the latest stage with an effect added, or replacing others, fitted on trial.

        ``from_prior`` begins from the parameters as stated instead of from those of the latest fit.
        """
        return self.with_effect(effect, instead_of, trial=True, from_prior=from_prior)

    def on_trial(self, name: str, effects: tuple[Effect, ...], start: Stage, *, from_prior: bool = False) -> Stage:
        """Return a stage fitted on trial; the same fit from the same stage is made once.

        ``from_prior`` begins from the parameters as stated instead of from those of ``start``.
        """
        fitted = partial(self.fitted, name, effects, start, start.noise, trial=True, from_prior=from_prior)
        return start.trial_fit(f"{name} from the prior" if from_prior else name, effects, fitted)

    def with_priors(self, uncertain: tuple[UncertainParameter, ...], start: Stage) -> Stage:
        """Return a stage's model fitted on trial with other priors of the uncertain parameters."""
        problem = replace(self.problem, uncertain=uncertain)
        return fitted_stage(
            problem, self.given.model, start.name, start.effects, start, start.noise, trial=True, progress=self.progress
        )


def not_much_slower(fit: Fit) -> Experiment:
    """Return the experiment of a fit, on which a simulation may not take many times as long as that one did."""
    experiment, taken = fit.experiment, fit.response.evaluations
    if taken == 0:  # not known: the machine steps itself
        return experiment
    most = SLOWER * max(taken, np.size(experiment.record.time))
    return replace(experiment, max_evaluations=min(most, experiment.max_evaluations or most))
