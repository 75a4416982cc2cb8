"""The search: one step, and the loop of adding, removing, exchanging and trying curves until nothing is significant."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial

from discrepancy.effects.effect import Effect
from discrepancy.search.decision import Decision
from discrepancy.search.model_comparison import bic_difference
from discrepancy.search.moves.add_one import propose_effect, require_presence
from discrepancy.search.moves.add_pair import propose_pair
from discrepancy.search.moves.add_without_significance import propose_without_significance
from discrepancy.search.moves.exchange import Exchange, propose_exchange
from discrepancy.search.moves.free_curves import (
    laws_at_connections,
    propose_curve,
    propose_curve_for_all,
    propose_curve_for_laws,
)
from discrepancy.search.moves.remove_redundant import find_redundant_effect
from discrepancy.search.omnibus import omnibus_of_stage
from discrepancy.search.policy import POLICY
from discrepancy.search.prior_conflict_test import find_prior_conflict
from discrepancy.search.scoring import ScanSettings, score_candidates
from discrepancy.search.state import SearchState, TakenBack
from discrepancy.stages.fit_stage import with_validation
from discrepancy.stages.held_out_errors import held_out_gain_of_errors, simulated_worse
from discrepancy.stages.stage import AcceptedEffect, Stage
from discrepancy.statistics.thresholds import (
    DECISIVE_BIC,
    HARMFUL_SHARE,
    LEVEL_SHARES,
    RELEVANT_SHARE,
    SHOWN_GROWTH,
    SIMULATION_ERRORS,
)
from multibody.base.errors import SimulationError

__all__ = ["Search"]


@dataclass
class Search:
    """A search for the effects that a model lacks.

    Parameters
    ----------
    state : SearchState
        Its stages are made, replaced and removed.
    """

    state: SearchState

    def run(self) -> None:
        """Continue from the latest stage."""
        state = self.state
        if state.stage.half_of_masking_pair:
            self.undo()  # interrupted between the two effects of a masking pair, which are added together
        if state.elimination_pending:
            self.eliminate()
        self._add_significant()
        while not self._out_of_time_for("exchanges of effects") and state.if_simulated(
            "whether another effect is the better one", self._exchange
        ):
            self._add_significant()
        if not self._out_of_time_for("free curves"):
            state.if_simulated("whether a free curve is better", self._try_curves)
        whole = state.mode == "simulation" and state.given.residual == "auto"
        if not state.accepted_stages and whole and state.cut_into_windows(state.stages[1].rmse("identify")):
            self.run()
            return
        undecided = not state.accepted_stages and bool(state.decisions)
        if undecided and state.if_simulated("effects without significance", self._add_without_significance):
            self._add_significant()
        self._drop_harmful()
        state.if_simulated("whether parameters alone explain as much", self.test_prior_conflict)

    # ---------------------------------------------------------------- one step

    def explain(self) -> Decision:
        """Score every candidate on the latest stage and refit the best; nothing is added yet."""
        state, stage = self.state, self.state.stage  # the first use makes stages
        settings = self._scan_settings(len(state.stages))
        decision = propose_effect(stage, state.effect_on_trial, **settings)
        if state.problem.max_effects - len(stage.effects) > 1:
            decision = propose_pair(decision, stage, state.on_trial, **settings)
        decision = require_presence(decision, stage, lambda t: state.fitted(t.name, t.effects, t, t.noise))
        state.decisions.append(decision)
        state.stages[-1] = replace(stage, scan=decision.scan)
        return decision

    def _scan_settings(self, count: int) -> ScanSettings:
        """Return how candidates are scored on the last of so many stages."""
        given = self.state.problem
        return {
            "include": given.include,
            "exclude": given.exclude,
            "level": given.level,
            "seed": given.seed + count,
            "progress": self.state.progress,
        }

    def add(self, effect: Effect, accepted: AcceptedEffect | None = None, instead_of: Sequence[Effect] = ()) -> Stage:
        """Add an effect to the model, fit again, and make that the latest stage.

        Where the machine cannot be simulated with the strengths given, the fit begins at smaller ones.

        Parameters
        ----------
        effect : Effect
        accepted : AcceptedEffect, optional
            Why it is added, as `explain` gives it (``decision.accepted``); by default the effect counts as given.
        instead_of : sequence of Effect, optional
            Effects of the model that leave it.

        Raises
        ------
        SimulationError
            If the machine cannot be simulated with a hundredth of them either.
        """
        stage = None
        for share in POLICY.start_shares:
            smaller = replace(effect, strengths={k: share * v for k, v in effect.strengths.items()})
            try:
                stage = self.state.with_effect(smaller, instead_of)
                break
            except SimulationError as error:
                reason = error
                self.state.progress(f"{effect} with {share:g} of its strengths could not be simulated")
        if stage is None:
            strengths = ", ".join(f"{k} = {v:g}" for k, v in effect.strengths.items())
            raise SimulationError(
                f"{effect} cannot be added: the machine cannot be simulated from its start values, not even with "
                f"{POLICY.start_shares[-1]:g} of the strengths ({strengths}); "
                f"give smaller ones, or other values of {', '.join(effect.shape) or 'the model'}. {reason}"
            ) from reason
        self.state.stages.append(replace(stage, accepted=accepted))
        self.state.save()
        return self.state.stage

    def undo(self) -> Stage:
        """Remove the latest effect."""
        if len(self.state.stages) > 2:
            self.state.stages.pop()
        return self.state.stage

    # ---------------------------------------------------------------- adding

    def _add_significant(self) -> None:
        """Explain and add, as long as there is something significant and room for it."""
        state = self.state
        while len(state.stage.effects) < state.problem.max_effects and not self._out_of_time_for("a further effect"):
            decision = state.if_simulated("what is still missing", self.explain) if state.decisions else self.explain()
            if decision is None or decision.accepted is None or decision.stage is None:
                return
            if self._recalibrated_from(decision.stage):
                state.decisions.remove(decision)
                continue
            if decision.first is not None:
                state.progress(f"add {decision.first[0].effect}, the first of a masking pair")
                self.accept(*decision.first)
            state.progress(f"add {decision.accepted.effect}")
            self._add(decision.accepted, decision.stage)

    def _out_of_time_for(self, what: str) -> bool:
        """Tell whether the time limit is reached; something is looked for once in any case."""
        return bool(self.state.decisions) and self.state.out_of_time_for(what)

    def _add_without_significance(self) -> bool:
        """Add the likeliest effect where none is significant and yet the omnibus test rejects; tell if there is one."""
        state, problem = self.state, self.state.problem
        state.progress("does anything in the residual follow the inputs?")
        state.omnibus = omnibus_of_stage(state.stage, level=problem.level / LEVEL_SHARES, seed=problem.seed)
        if state.omnibus is None or not state.omnibus.rejects or not problem.max_effects:
            return False
        stage = propose_without_significance(
            state.stage,
            state.decisions[-1].scan,
            state.effect_on_trial,
            include=problem.include,
            exclude=problem.exclude,
            p_value=min(1.0, LEVEL_SHARES * state.omnibus.p),
            progress=state.progress,
        )
        if stage is None or stage.accepted is None:
            return False
        state.progress(f"add {stage.accepted.effect}")
        self._add(stage.accepted, stage)
        return True

    def _recalibrated_from(self, trial: Stage) -> bool:
        """Fit the latest stage again from the values of a trial; tell if that fit is now the latest stage.

        A fit weighs each output by its residual, so it can end in more than one place.  An effect must not get the
        credit for taking the calibration out of a worse one.
        """
        state, stage = self.state, self.state.stage
        state.progress("from there, does the model do as well without it?")
        try:
            again = state.fitted(stage.name, stage.effects, trial, stage.noise)
        except RuntimeError as error:
            state.progress(f"without it the machine could not be simulated there: {error}")
            return False
        if bic_difference(again, stage) > -DECISIVE_BIC:
            return False
        state.progress("it does better than before: the calibration continues from there")
        state.stages[-1] = replace(again, accepted=stage.accepted, notes=stage.notes)
        state.save()
        return True

    def _add(self, accepted: AcceptedEffect, trial: Stage) -> None:
        """Accept an effect, remove the stages of those that it replaces, then redundant effects."""
        self.state.elimination_pending = True
        names = {e.component_name for e in trial.effects}
        replaced = [e for e in self.state.stage.effects if e.component_name not in names]
        if replaced:
            note = f"{accepted.effect} replaces {', '.join(map(str, replaced))}, which it contains"
            self.state.progress(note)
            self._accept_without(replaced, accepted, trial, self.state.stages, note)
        else:
            self.accept(accepted, trial)
        self.eliminate()

    def accept(self, accepted: AcceptedEffect | None, trial: Stage) -> None:
        """Fit the accepted effect fully, from the end of its trial, and make that the latest stage."""
        try:
            stage = self.state.fitted(trial.name, trial.effects, trial, trial.noise)
        except RuntimeError as error:  # the trial could be simulated, its neighbourhood cannot
            self.state.progress(f"{trial.effects[-1]} could not be fitted further, the fit on trial is kept: {error}")
            stage = with_validation(self.state.problem, trial)
        present = set(map(str, stage.effects))
        self.state.stages[:] = [_unmasked(s, present) for s in self.state.stages]
        accepted = replace(accepted, effect=stage.effects[-1]) if accepted is not None else None
        self.state.stages.append(replace(stage, accepted=accepted))
        self.state.save()

    def _drop_harmful(self) -> None:
        """Take back the latest effects, one after another, that make a prediction of the records held out worse.

        What is significant in the residual may still be what the linearisation about a wrong model makes of it.  A
        force without a law is no name, and stays.
        """
        stages = self.state.stages
        self.state.taken_back.clear()  # of an earlier search
        calibrated = next(s for s in reversed(stages) if s.accepted is None)
        while (accepted := stages[-1].accepted) is not None and stages[-1].validate is not None:
            count = 2 if stages[-2].half_of_masking_pair else 1
            before = stages[-1 - count]
            gain = held_out_gain_of_errors(stages[-1], before)
            worse = {*gain.worse(HARMFUL_SHARE, SIMULATION_ERRORS)}
            worse |= {*simulated_worse(stages[-1], calibrated, SHOWN_GROWTH)}
            if accepted.effect.definition.free_form or not worse:
                return
            note = f"{accepted.effect} is not announced: records held out are predicted worse with it"
            self.state.progress(f"{note} (square error gone: {gain})")
            better = gain.better(RELEVANT_SHARE, SIMULATION_ERRORS)
            effects = [s.accepted.effect for s in reversed(stages[-count:]) if s.accepted is not None]
            for effect in effects if better else ():
                outputs = tuple(n for n in gain.outputs if n in worse)
                name = f"{effect.kind}@{effect.where}"
                self.state.taken_back.append(TakenBack(name=name, better=better, worse=outputs))
            stages[-1 - count :] = [replace(before, notes=(*before.notes, note))]
            self.state.save()

    # ---------------------------------------------------------------- backward elimination

    def eliminate(self) -> None:
        """Remove effects that the latest one has made redundant, and several laws at one place if a curve is better."""
        while self._remove_redundant():
            pass
        if self._several_laws_at_a_place():
            self._replace_by_curve(final=False)
        self.state.elimination_pending = False
        self.state.save()

    def _remove_redundant(self) -> bool:
        """Remove an earlier effect that a later one has made redundant; tell whether there was one."""
        state = self.state
        redundant = find_redundant_effect(state.stages, state.on_trial, state.progress)
        if redundant is None:
            return False
        stage, effect = redundant
        note = f"{effect} was removed again: the effect added after it explains it"
        state.progress(note)
        self._accept_without([effect], state.stages[-1].accepted, stage, state.stages[:-1], note)
        return True

    def _accept_without(
        self,
        removed: Sequence[Effect],
        accepted: AcceptedEffect | None,
        trial: Stage,
        stages: Sequence[Stage],
        note: str,
    ) -> None:
        """Accept a trial after the given stages without those that added the removed effects."""
        names = {e.component_name for e in removed}
        kept = [s for s in stages if s.accepted is None or s.accepted.effect.component_name not in names]
        if accepted is not None and accepted.masked_by in map(str, removed):
            accepted = replace(accepted, masked_by="")
        with self._stages_or_before():
            self.state.stages[:] = kept
            self.accept(accepted, trial)
        self.state.stages[-1] = replace(self.state.stages[-1], notes=(note,))

    @contextmanager
    def _stages_or_before(self) -> Iterator[list[Stage]]:
        """Restore the stages if what changes them is interrupted or fails; gives them as they were before."""
        before = list(self.state.stages)
        try:
            yield before
        except BaseException:
            self.state.stages[:] = before
            raise

    # ---------------------------------------------------------------- exchange

    def _exchange(self) -> bool:
        """Replace an effect found before by one that is better beside the later ones; tell whether there is one."""
        state = self.state
        if len(state.stage.effects) > 1:
            self._scan_again()
        exchange = propose_exchange(state.stages, state.on_trial, state.progress)
        if exchange is None:
            return False
        note = f"{exchange.new} replaces {exchange.old}: it is better beside the effects found later"
        state.progress(note)
        with self._stages_or_before() as before:
            try:
                del state.stages[exchange.index :]
                for stage in before[exchange.index :]:
                    self._make_again(stage, exchange)
                state.stages[exchange.index] = replace(state.stages[exchange.index], notes=(note,))
                better = bic_difference(state.stage, before[-1]) < 0.0
            except RuntimeError as error:
                state.progress(f"the machine could not be simulated with it at every stage: {error}")
                better = False
        if not better:
            state.stages[:] = before
        state.save()
        return better

    def _scan_again(self) -> None:
        """Score the candidates again at the stages whose scan is not known any more.

        A history holds the stages of an interrupted search without their scans.
        """
        stages = self.state.stages
        for k, after in enumerate(stages[1:], 1):
            before = stages[k - 1]
            if after.accepted is not None and before.scan is None:
                scans, *_ = score_candidates(before, **self._scan_settings(k))
                stages[k - 1] = replace(before, scan=scans[0])

    def _make_again(self, stage: Stage, exchange: Exchange) -> None:
        """Make a stage again with one effect exchanged."""
        old, new = exchange.old.component_name, exchange.new.component_name
        names = {e.component_name for e in stage.effects} - {old} | {new}
        effects = tuple(e for e in exchange.stage.effects if e.component_name in names)
        name = stage.name.replace(str(exchange.old), str(exchange.new))
        made = self.state.fitted(name, effects, exchange.stage, stage.noise)
        accepted = stage.accepted  # None of an effect that was added by hand
        if accepted is not None:
            accepted = exchange.applied_to(accepted, bic_difference(made, self.state.stage))
        self.state.stages.append(replace(made, accepted=accepted))

    # ---------------------------------------------------------------- free curves

    def _try_curves(self) -> None:
        """Replace laws by a free curve where that is clearly better, or add one where no law was found."""
        state, problem = self.state, self.state.problem
        if state.accepted_stages:
            if not self._replace_by_curve():
                self._replace_by_curve(anywhere=True)
        elif len(state.stage.effects) < problem.max_effects:
            curve = propose_curve(
                state.stage, state.on_trial, level=problem.level, seed=problem.seed, progress=state.progress
            )
            if curve is not None and self._recalibrated_from(curve):
                self._add_significant()
                self._try_curves()
            elif curve is not None:
                self.accept(curve.accepted, curve)

    def _several_laws_at_a_place(self) -> bool:
        """Tell whether there are several laws at one connection, which one curve may explain more simply."""
        laws = laws_at_connections(self.state.stage.effects)
        return len(laws) > len({e.where for e in laws})

    def _replace_by_curve(self, anywhere: bool = False, final: bool = True) -> bool:
        """Replace the laws found at a connection, or all of them, by one free curve, if that is the better model."""
        state, problem = self.state, self.state.problem
        propose = propose_curve_for_all if anywhere else partial(propose_curve_for_laws, final=final)
        proposal = propose(
            state.stages, state.on_trial, level=problem.level, seed=problem.seed, progress=state.progress
        )
        if proposal is None:
            return False
        kept, stage = proposal
        with self._stages_or_before():
            state.stages[:] = state.stages[:kept]
            self.accept(stage.accepted, stage)
        return True

    # ---------------------------------------------------------------- after the search

    def test_prior_conflict(self) -> None:
        """Ask whether parameters outside their stated uncertainty explain as much as the first effect."""
        state = self.state
        accepted = state.accepted_stages
        if not accepted:
            return
        state.progress("would parameters outside their stated uncertainty explain as much?")
        first = accepted[1] if accepted[0].half_of_masking_pair and len(accepted) > 1 else accepted[0]
        state.prior_conflict = find_prior_conflict(state.problem, state.with_priors, state.stages[1], first)


def _unmasked(stage: Stage, present: Collection[str]) -> Stage:
    """Return a stage whose effect is masked by no effect that has been removed from the model."""
    accepted = stage.accepted
    if accepted is None or not accepted.masked_by or accepted.masked_by in present:
        return stage
    return replace(stage, accepted=replace(accepted, masked_by=""))
