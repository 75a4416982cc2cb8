"""The loop of a search: explain, add, take out what has become idle, until nothing significant is left."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

from discrepancy.effects.effect import Effect
from discrepancy.search.model_comparison import bic_difference
from discrepancy.search.step import LOOKS
from discrepancy.stages.fit_stage import with_validation
from discrepancy.stages.stage import AcceptedEffect, Stage
from discrepancy.statistics.thresholds import DECISIVE_BIC

if TYPE_CHECKING:
    from discrepancy.search.exchange import Swap
    from discrepancy.study.study import Study

__all__ = ["Search"]


@dataclass
class Search:
    """A search for what is missing, in a study whose stages it makes.

    Parameters
    ----------
    study : Study
    """

    study: Study

    def run(self) -> None:
        """Go on from where the study stands."""
        study = self.study
        if study.stage.half_of_masking_pair:
            study.undo()  # a search was broken off between two effects that hide each other: they come together
        if not study.settled:
            self._settle()
        self._add_significant()
        while study.unless_it_fails("whether another effect does better", self._swap):
            self._add_significant()
        study.unless_it_fails("whether a curve tells more", self._free_curves)
        whole = study.mode == "simulation" and study.given.residual == "auto"
        if not self._found and whole and study.cut_into_windows(study.stages[1].rmse("identify")):
            self.run()
            return
        if not self._found and study.steps and study.unless_it_fails("what else it could be", self._by_refits):
            self._add_significant()
        study.unless_it_fails("what parameters alone would explain", self._ask_beyond)

    @property
    def _found(self) -> list[Stage]:
        return [s for s in self.study.stages if s.accepted is not None]

    def _add_significant(self) -> None:
        """Explain and add, as long as there is something significant and room for it."""
        study = self.study
        while len(study.stage.effects) < study.problem.max_effects:
            step = study.unless_it_fails("what is still missing", study.explain) if study.steps else study.explain()
            if step is None or step.accepted is None or step.stage is None:
                return
            if self._recalibrated(step.stage):
                study.steps.remove(step)
                continue
            if step.first is not None:
                study.progress(f"add {step.first[0].effect}, which the next effect hides")
                self.accept(*step.first)
            study.progress(f"add {step.accepted.effect}")
            self._add(step.accepted, step.stage)

    def _recalibrated(self, trial: Stage) -> bool:
        """Fit the latest stage anew from where a trial has put everything else; say if that is now the latest stage.

        A fit weighs each output by what is left of it, so it can settle in more than one place.  An effect must not be
        paid for getting the calibration out of a worse one.
        """
        study, stage = self.study, self.study.stage
        study.progress("from there, does the model do as well without it?")
        try:
            again = study.fitted(stage.name, stage.effects, trial, stage.noise)
        except RuntimeError as error:
            study.progress(f"without it the machine could not be simulated there: {error}")
            return False
        if bic_difference(again, stage) > -DECISIVE_BIC:
            return False
        study.progress("it does better than before: the calibration goes on from there")
        study.stages[-1] = replace(again, accepted=stage.accepted, notes=stage.notes)
        study.made()
        return True

    def _add(self, accepted: AcceptedEffect, trial: Stage) -> None:
        self.study.settled = False
        self._accept_instead(accepted, trial)
        self._settle()

    def _by_refits(self) -> bool:
        """Refit with the likeliest effects where none is significant and yet something is missing; say if one is it."""
        from discrepancy.search.omnibus import omnibus_of_stage
        from discrepancy.search.without_significance import last_resort

        study, problem = self.study, self.study.problem
        study.progress("does anything that is left follow the inputs?")
        study.follows = omnibus_of_stage(study.stage, level=problem.level / LOOKS, seed=problem.seed)
        if study.follows is None or not study.follows.rejects or not problem.max_effects:
            return False
        found = last_resort(
            study.stage, study.steps[-1].scan, study.tried,
            include=problem.include, exclude=problem.exclude,
            p_value=min(1.0, LOOKS * study.follows.p), progress=study.progress,
        )  # fmt: skip
        if found is None or found.accepted is None:
            return False
        study.progress(f"add {found.accepted.effect}")
        self._add(found.accepted, found)
        return True

    def _ask_beyond(self) -> None:
        if not self._found:
            return
        from discrepancy.search.prior_conflict_test import beyond_priors

        self.study.progress("would parameters outside their stated uncertainty explain as much?")
        found = self._found
        first = found[1] if found[0].half_of_masking_pair and len(found) > 1 else found[0]
        self.study.beyond = beyond_priors(self.study, self.study.stages[1], first)

    def _settle(self) -> None:
        """Take out what the latest effect has made idle, and several laws at one place if one curve tells more."""
        while self._drop_idle():
            pass
        if self._crowded():
            self._swap_for_curve(last_word=False)
        self.study.settled = True
        self.study.made()

    def accept(self, accepted: AcceptedEffect | None, trial: Stage) -> None:
        """Fit the accepted effect fully, from where its trial ended, and make that the latest stage."""
        try:
            stage = self.study.fitted(trial.name, trial.effects, trial, trial.noise)
        except RuntimeError as error:  # the trial could be simulated, what is near it cannot
            self.study.progress(f"{trial.effects[-1]} could not be fitted further, the trial's fit stands: {error}")
            stage = with_validation(self.study.problem, trial)
        told = replace(accepted, effect=stage.effects[-1]) if accepted is not None else None
        there = set(map(str, stage.effects))
        self.study.stages[:] = [_told_alone(s, there) for s in self.study.stages]
        self.study.stages.append(replace(stage, accepted=told))
        self.study.made()

    def _drop_idle(self) -> bool:
        """Take out an earlier effect that a later one has made idle; say whether there was one."""
        from discrepancy.search.backward_elimination import drop_idle

        dropped = drop_idle(self.study.stages, self.study.refit, self.study.progress)
        if dropped is None:
            return False
        stage, effect = dropped
        note = f"{effect} was taken out again: the effect added after it explains it"
        self.study.progress(note)
        self._again(self.study.stages[-1].accepted, stage, self.study.stages[:-1], [effect], note)
        return True

    def _accept_instead(self, accepted: AcceptedEffect, trial: Stage) -> None:
        """Accept an effect, and take the stages of those out of the story in whose place it stands."""
        names = {e.component_name for e in trial.effects}
        gone = [e for e in self.study.stage.effects if e.component_name not in names]
        if not gone:
            self.accept(accepted, trial)
            return
        note = f"{accepted.effect} stands in the place of {', '.join(map(str, gone))}, which it contains"
        self.study.progress(note)
        self._again(accepted, trial, self.study.stages, gone, note)

    def _again(
        self, accepted: AcceptedEffect | None, trial: Stage, stages: Sequence[Stage], gone: Sequence[Effect], note: str
    ) -> None:
        """Accept a trial after the given stages without those that added effects that have gone."""
        names = {e.component_name for e in gone}
        kept = [s for s in stages if s.accepted is None or s.accepted.effect.component_name not in names]
        if accepted is not None and accepted.masked_by in map(str, gone):
            accepted = replace(accepted, masked_by="")
        before = list(self.study.stages)
        try:
            self.study.stages[:] = kept
            self.accept(accepted, trial)
        except BaseException:  # interrupted: what was there before stays
            self.study.stages[:] = before
            raise
        self.study.stages[-1] = replace(self.study.stages[-1], notes=(note,))

    def _swap(self) -> bool:
        """Put another effect in the place of one found before, if it does better beside the later ones; say so."""
        from discrepancy.search.exchange import better_in_its_place

        study = self.study
        if len(study.stage.effects) > 1:
            study.scan_again()
        swap = better_in_its_place(study.stages, study.refit, study.progress)
        if swap is None:
            return False
        note = f"{swap.new} stands in the place of {swap.old}: beside what was found later it does better"
        study.progress(note)
        before = list(study.stages)
        try:
            del study.stages[swap.index :]
            for stage in before[swap.index :]:
                self._tell_anew(stage, swap)
            study.stages[swap.index] = replace(study.stages[swap.index], notes=(note,))
            better = bic_difference(study.stage, before[-1]) < 0.0
        except RuntimeError as error:
            study.progress(f"the machine could not be simulated with it at every stage: {error}")
            better = False
        except BaseException:  # interrupted: what was there before stays
            study.stages[:] = before
            raise
        if not better:
            study.stages[:] = before
        study.made()
        return better

    def _tell_anew(self, stage: Stage, swap: Swap) -> None:
        """Make a stage of the story again, with an effect in the place of another."""
        told = {e.component_name for e in stage.effects} - {swap.old.component_name} | {swap.new.component_name}
        effects = tuple(e for e in swap.stage.effects if e.component_name in told)
        name = stage.name.replace(str(swap.old), str(swap.new))
        made = self.study.fitted(name, effects, swap.stage, stage.noise)
        accepted = stage.accepted  # None of an effect that was added by hand
        if accepted is not None:
            accepted = swap.accepted(accepted, bic_difference(made, self.study.stage))
        self.study.stages.append(replace(made, accepted=accepted))

    def _free_curves(self) -> None:
        """Ask whether a curve tells the truth better than the laws found, or finds what no law did."""
        from discrepancy.search.backward_elimination import free_curve

        level, seed = self.study.problem.level, self.study.problem.seed
        if any(s.accepted is not None for s in self.study.stages):
            if not self._swap_for_curve():
                self._swap_for_curve(anywhere=True)
        elif len(self.study.stage.effects) < self.study.problem.max_effects:
            found = free_curve(self.study.stage, self.study.refit, level=level, seed=seed, progress=self.study.progress)
            if found is not None and self._recalibrated(found):
                self._add_significant()
                self._free_curves()
            elif found is not None:
                self.accept(found.accepted, found)

    def _crowded(self) -> bool:
        """Tell whether several laws stand at one connection, which one curve may tell more simply."""
        effects = self.study.stage.effects
        laws = [e.where for e in effects if e.definition.at == "connection" and not e.definition.free_form]
        return len(laws) > len(set(laws))

    def _swap_for_curve(self, anywhere: bool = False, last_word: bool = True) -> bool:
        """Put one free curve in the place of the laws found at a connection, or of all, if that is the better model."""
        from discrepancy.search.backward_elimination import curve_instead, replace_by_curve

        study = self.study
        look = curve_instead if anywhere else partial(replace_by_curve, last_word=last_word)
        swapped = look(
            study.stages, study.refit, level=study.problem.level, seed=study.problem.seed, progress=study.progress
        )
        if swapped is None:
            return False
        kept, stage = swapped
        before = list(self.study.stages)
        try:
            self.study.stages[:] = self.study.stages[:kept]
            self.accept(stage.accepted, stage)
        except BaseException:  # interrupted: what was there before stays
            self.study.stages[:] = before
            raise
        return True


def _told_alone(stage: Stage, there: Collection[str]) -> Stage:
    """Return a stage of the story; where the effect that hid its own is not in the model any more, without that."""
    accepted = stage.accepted
    if accepted is None or not accepted.masked_by or accepted.masked_by in there:
        return stage
    return replace(stage, accepted=replace(accepted, masked_by=""))
