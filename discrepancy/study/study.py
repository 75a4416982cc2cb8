"""A study: a model against records, stage by stage, until nothing that these records can show is missing."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from discrepancy.effects.effect import Effect
from discrepancy.problem.problem import Problem, noise_floors, read_problem
from discrepancy.search.effect_presence import standing
from discrepancy.search.look_ahead import look_ahead
from discrepancy.search.step import Step, scored, search_step
from discrepancy.stages.fit_stage import FittedValues, fitted_stage
from discrepancy.stages.stage import AcceptedEffect, Stage
from multibody.base.progress import silent

if TYPE_CHECKING:
    import pandas

    from discrepancy.questions.compare import Comparison
    from discrepancy.questions.locate import WhereItFails
    from discrepancy.report.conclusion import Conclusion
    from discrepancy.residual.prepared_problem import PreparedProblem
    from discrepancy.search.omnibus import Omnibus
    from discrepancy.search.prior_conflict_test import Beyond
    from estimation.fit.calibrate import UncertainParameter

__all__ = ["Study"]

Answer = TypeVar("Answer")

SHARES = (1.0, 0.3, 0.1, 0.01)  # of the strengths given, with which an effect that is added by hand is tried


@dataclass
class Study:
    """A model confronted with records, and every stage of what was done about their disagreement.

    Make one with `Study.from_file`, then call `diagnose`, or take the steps yourself: `compare`, `locate`,
    `explain`, `add`, `undo`.

    Parameters
    ----------
    problem : Problem
    progress : callable
        Gets a line of text for everything that takes a while.
    checkpoint : callable, optional
        Called with the study whenever a stage has been made, for instance to write its history.
    settled : bool
        False while it is still open whether the latest effect has made an earlier one idle.
    interrupted : bool
        True if a search was broken off; what it had found until then stands.
    in_windows_instead : bool
        True if simulations of whole records were given up for windows.
    beyond : Beyond or None
        Parameters that, outside their stated uncertainty, explain as much as the first effect found.
    follows : Omnibus or None
        Whether what is left follows the machine's inputs, asked where no effect was found.
    troubles : list of str
        What could not be asked of the latest stage, because its model cannot be simulated so.

    Attributes
    ----------
    given : Problem
        As handed in; ``problem`` may hold windows, or a copy of the model whose motion is prescribed.
    """

    problem: Problem
    progress: Callable[[str], None] = silent
    stages: list[Stage] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    prepared: PreparedProblem | None = None
    checkpoint: Callable[[Study], object] | None = None
    settled: bool = True
    interrupted: bool = False
    in_windows_instead: bool = False
    beyond: Beyond | None = None
    follows: Omnibus | None = None
    troubles: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.given = self.problem

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

    # ---------------------------------------------------------------- stages

    @property
    def stage(self) -> Stage:
        """The latest stage; the first call makes "as given" and "recalibrated"."""
        if not self.stages:
            self._begin()
        return self.stages[-1]

    def prepare(self) -> None:
        """Choose how the model is confronted with its records, if that has not been done yet."""
        from discrepancy.residual.residual_mode import prepared_problem

        if self.prepared is None:
            self._take(prepared_problem(self.problem, self.progress))

    def _take(self, prepared: PreparedProblem) -> None:
        from discrepancy.residual.tolerances import with_tolerances

        self.prepared = prepared
        self.problem = with_tolerances(prepared.problem)

    def cut_into_windows(self, errors: Mapping[str, float] | None = None) -> bool:
        """Begin again in windows where simulations with these errors (or any) do not follow; say whether that is so."""
        from discrepancy.residual.residual_mode import problem_in_windows

        found = problem_in_windows(self.given, errors, self.progress)
        if found is None:
            return False
        self._take(found)
        self.in_windows_instead = True
        self.stages.clear()
        self.steps.clear()
        self.troubles.clear()
        self.follows = None
        return True

    def _begin(self) -> None:
        self.prepare()
        self.progress("simulate the model as given")
        noise = noise_floors(self.problem.identify, self.problem.noise)
        self.stages.append(self.fitted("as given", (), None, noise, calibrated=False))
        self.progress("recalibrate the uncertain parameters")
        self.stages.append(self.fitted("recalibrated", (), None, noise))
        self.made()

    def unless_it_fails(self, what: str, ask: Callable[[], Answer]) -> Answer | None:
        """Return an answer; None, and a note among the troubles, where the latest model cannot be simulated for it."""
        from multibody.base.errors import SimulationError

        try:
            return ask()
        except SimulationError as error:
            self.troubles.append(f"{what} was not asked of '{self.stages[-1].name}': {error}")
            self.progress(self.troubles[-1])
            return None

    def made(self) -> None:
        """Tell whoever keeps the history that a stage has been made."""
        if self.checkpoint is not None:
            self.checkpoint(self)

    def held_stage(
        self,
        name: str,
        effects: tuple[Effect, ...],
        values: Mapping[str, float],
        own: Sequence[np.ndarray],
        scale: Mapping[str, float],
        noise: Mapping[str, float],
        *,
        moved: bool = True,
    ) -> Stage:
        """Return a stage at values that a fit has given before; only what is held out has its own unknowns fitted."""
        return self.fitted(name, effects, None, dict(noise), calibrated=moved, values=FittedValues(values, own, scale))

    def fitted(
        self, name: str, effects: tuple[Effect, ...], start: Stage | None, noise: Any, **options: Any
    ) -> Stage:
        """Return a fitted stage of this study; options as of `fitted_stage`."""
        return fitted_stage(
            self.problem, self.given.model, name, effects, start, noise, progress=self.progress, **options
        )

    def add(self, effect: Effect, accepted: AcceptedEffect | None = None) -> Stage:
        """Put an effect into the model, fit again, and make that the latest stage.

        Where the machine cannot be simulated with the strengths given, the fit begins at smaller ones.

        Raises
        ------
        SimulationError
            If the machine cannot be simulated with a hundredth of them either.
        """
        from multibody.base.errors import SimulationError

        stage = None
        for share in SHARES:
            smaller = replace(effect, strengths={k: share * v for k, v in effect.strengths.items()})
            try:
                stage = self._with(smaller)
                break
            except SimulationError as error:
                told = error
                self.progress(f"{effect} with {share:g} of its strengths could not be simulated")
        if stage is None:
            raise SimulationError(
                f"{effect} cannot be added: from the start values on, not even with {SHARES[-1]:g} of its strengths "
                f"({', '.join(f'{k} = {v:g}' for k, v in effect.strengths.items())}) can the machine be simulated; "
                f"give smaller ones, or other values of {', '.join(effect.shape) or 'the model'}. {told}"
            ) from told
        self.stages.append(replace(stage, accepted=accepted))
        self.made()
        return self.stages[-1]

    def tried(self, effect: Effect, instead_of: Sequence[Effect] = (), stated: bool = False) -> Stage:
        """Return the latest stage with an effect in the place of others, fitted on trial; nothing is added yet.

        ``stated`` begins where the parameters were stated in place of where the latest fit has put them.
        """
        return self._with(effect, instead_of, trial=True, from_prior=stated)

    def _with(self, effect: Effect, instead_of: Sequence[Effect] = (), **options: bool) -> Stage:
        current = self.stage
        kept = tuple(e for e in current.effects if e not in instead_of)
        return self.fitted(f"+ {effect}", (*kept, effect), current, current.noise, **options)

    def undo(self) -> Stage:
        """Take the latest effect out again."""
        if len(self.stages) > 2:
            self.stages.pop()
        return self.stage

    @property
    def mode(self) -> str:
        """How the model is confronted with the records: ``"simulation"``, ``"prediction"`` or ``"inverse"``."""
        return self.prepared.mode if self.prepared is not None else self.problem.residual

    @property
    def mode_reason(self) -> str:
        """Why it is confronted so."""
        return self.prepared.reason if self.prepared is not None else "chosen when the first stage is made"

    # ---------------------------------------------------------------- questions

    def compare(self) -> Comparison:
        """Lay the latest stage beside the records."""
        from discrepancy.questions.compare import compare

        return compare(self.stage)

    def locate(self) -> WhereItFails:
        """Say where the latest stage fails: signals, regimes, frequencies, connections."""
        from discrepancy.questions.locate import locate

        return locate(self.stage)

    def explain(self) -> Step:
        """Score every candidate on the latest stage and refit the best; nothing is added yet."""
        stage = self.stage  # the first call makes stages
        asked = self._asked(len(self.stages))
        step = search_step(stage, self.tried, **asked)
        if self.problem.max_effects - len(stage.effects) > 1:
            step = look_ahead(step, stage, self.refit, **asked)
        step = standing(step, stage, lambda trial: self.fitted(trial.name, trial.effects, trial, trial.noise))
        self.steps.append(step)
        self.stages[-1] = replace(stage, scan=step.scan)
        return step

    def _asked(self, count: int) -> dict[str, Any]:
        """Return how candidates are scored on the last of so many stages."""
        given = self.problem
        return {
            "include": given.include, "exclude": given.exclude, "level": given.level, "seed": given.seed + count,
            "progress": self.progress,
        }  # fmt: skip

    def scan_again(self) -> None:
        """Score the candidates once more at the stages from which the search went on, where that is not known any more.

        A history holds the stages of an interrupted search without their scans.
        """
        for k, after in enumerate(self.stages[1:], 1):
            before = self.stages[k - 1]
            if after.accepted is not None and before.scan is None:
                scans, *_ = scored(before, **self._asked(k))
                self.stages[k - 1] = replace(before, scan=scans[0])

    def diagnose(self) -> Conclusion:
        """Explain and add, again and again, until nothing significant is left; then conclude."""
        from discrepancy.search.loop import Search
        from discrepancy.study.conclude import conclude

        try:
            Search(self).run()
        except KeyboardInterrupt:
            if len(self.stages) < 2:
                raise  # nothing has been found yet that would be lost
            self.interrupted = True
        return conclude(self)

    def with_uncertain(self, uncertain: tuple[UncertainParameter, ...], start: Stage) -> Stage:
        """Fit a stage's model on trial with other deviations of the uncertain parameters."""
        other = Study(replace(self.problem, uncertain=uncertain), self.progress, prepared=self.prepared)
        return other.fitted(start.name, start.effects, start, start.noise, trial=True)

    def refit(self, name: str, effects: tuple[Effect, ...], start: Stage) -> Stage:
        """Fit on trial; a fit that was asked for before from the same stage is not done again."""
        return start.trial_fit(
            name, effects, lambda: self.fitted(name, effects, start, start.noise, trial=True)
        )

    # ---------------------------------------------------------------- showing

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

    def __repr__(self) -> str:
        records = f"{len(self.problem.identify)} + {len(self.problem.validate)} records"
        return f"Study({self.problem.name!r}: {records}, {len(self.stages)} stages)"
