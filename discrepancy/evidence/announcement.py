"""Which effects of the best model are announced: those that predict better what was left out and held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from discrepancy.evidence import moves
from discrepancy.evidence.moves import TriedModel, key_of
from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.predictive import PredictiveGain, held_out_gain, predictive_gain
from discrepancy.evidence.proposals import Proposal
from discrepancy.evidence.trials import Trials
from discrepancy.evidence.tried_models import TriedModels
from discrepancy.evidence.unknown_law_search import at_a_second_place, unknown_law
from discrepancy.search.state import SearchState
from discrepancy.stages.fit_stage import with_validation
from discrepancy.stages.held_out_errors import SimulationGain, held_out_gain_of_errors, simulated_worse
from discrepancy.stages.stage import Stage
from multibody.base.errors import ModelError, SimulationError
from multibody.base.memory import give_back

__all__ = ["Announcement"]


@dataclass(eq=False)
class Announcement:
    """The tests that the effects of the best model have to pass.

    Parameters
    ----------
    trials : Trials
        Of the search.

    Attributes
    ----------
    predictive : dict of str to PredictiveGain
        By how much records left out are predicted better with an effect.
    unconfirmed : list of str
        Effects that no record held out is predicted better with.
    """

    trials: Trials
    predictive: dict[str, PredictiveGain] = field(default_factory=dict, init=False)
    unconfirmed: list[str] = field(default_factory=list, init=False)

    def of(self, best: TriedModel) -> TriedModel:
        """Return what remains of the best model: the answer.

        Where the records held out refuse one of its effects, what the other records cannot tell from it is asked in its
        place, and stands if all of it passes.
        """
        kept = self._kept_by_prediction(best)
        answer = self._confirmed(kept)
        for other in self._as_good(kept) if answer is not kept else ():
            if self._kept_by_prediction(other) is other and self._confirmed(other) is other:
                answer = other
                self.unconfirmed.clear()
                break
        return self._beside_unknown_law(answer)

    def _as_good(self, refused: TriedModel) -> list[TriedModel]:
        """Return the models that the evidence holds for as good as one that was refused, most probable first.

        Simpler laws, and what changes the same in place of an effect, are fitted if they were not; of what was fitted
        in the search the models with as many effects or fewer count, but not those without some of its own.
        """
        source = self._tried.start.proposals if self._tried.start is not None else None
        offers = [*self._simplifications(refused), *moves.twins(refused, source)]
        fitted = self.trials.fitted_once(refused, offers) if offers else []
        rivals = [m for m in self._tried.models.values() if m.in_full and len(m.key) <= len(refused.key)]
        rivals = [m for m in rivals if not set(m.key) <= set(refused.key)]
        models = {m.key: m for m in (*fitted, *rivals) if m.likelihood is not None}
        good = [m for m in models.values() if m.total >= refused.total - POLICY.improvement]
        return sorted(good, key=lambda m: -m.total)

    @property
    def _tried(self) -> TriedModels:
        return self.trials.tried

    @property
    def _state(self) -> SearchState:
        return self.trials.tried.state

    def _kept_by_prediction(self, best: TriedModel) -> TriedModel:
        """Drop effects without which records left out are predicted as well, one after another."""
        state = self._state
        while best.key and best.likelihood is not None:
            weakest: tuple[float, TriedModel, str] | None = None
            for model in self.trials.fitted_once(best, [*self._simplifications(best), *moves.drops(best)]):
                if model.likelihood is None:
                    continue
                if best.total > model.total:
                    self._tried.with_noise_of(best, model)
                gain = predictive_gain(best.likelihood, model.likelihood)
                dropped = " + ".join(sorted(set(best.key) - set(model.key)))
                if new := set(model.key) - set(best.key):
                    dropped += f" in place of {' + '.join(sorted(new))}"
                else:
                    self.predictive[dropped] = gain
                state.progress(f"{dropped}: log predictive score of {gain.blocks} blocks left out {gain}")
                self._tried.doubt()
                why = self._why_dropped(best, model, gain)
                if why and (weakest is None or gain.total < weakest[0]):
                    weakest = gain.total, model, f"{dropped} is not taken: {why}"
            if weakest is None:
                return best
            state.progress(weakest[2])
            best.refuse(weakest[2], weakest[1])
            best = weakest[1]
        return best

    def _simplifications(self, best: TriedModel) -> list[Proposal]:
        """Return the models with a simpler law in the place of another, unless a parameter of the model is that law.

        Of the model without effects: the strength of the law in question is a parameter of the others, and does the
        same.
        """
        start = self._tried.start
        owned = start.proposals.owned if start is not None and start.proposals is not None else {}
        return [p for p in moves.simplifications(best) if not any(str(e) in owned for e in p.effects)]

    def _why_dropped(self, best: TriedModel, without: TriedModel, gain: PredictiveGain) -> str:
        """Return why an effect is dropped again; an empty text where it stays."""
        named_anyway = bool(set(without.key) - set(best.key))  # by a simpler law in its place
        sure = gain.exceeds(POLICY.predictive_errors) if named_anyway else gain.exceeds_normal(POLICY.naming_errors)
        if not sure:
            return "records left out are predicted no better with it"
        if not best.is_more_probable_than(without):
            return "the model without it is more probable"
        return moves.why_irrelevant(best, without, self._tried.wander)

    def _confirmed(self, best: TriedModel) -> TriedModel:
        """Drop effects that predict nothing of the records held out better, or some output worse, one after another.

        They may be there: where nothing is announced, the evidence for them stands in the probabilities.  They are not
        announced, because the model predicts nothing better with them.  Of several the one goes first that the evidence
        asks for least: of two that stand for each other, either is idle beside the other.  Where forces that nobody
        recorded make most of an output's error, its square hardly shows an effect; the log predictive score knows these
        forces.
        """
        state = self._state
        while best.key and best.likelihood is not None and state.problem.validate:
            fails = self._not_simulated(best.stage)
            if not fails:
                self._move_to_likeliest(best)
            fewer = [*self.trials.fitted_once(best, moves.drops(best)), *self._far_simpler(best)]
            fewer = [m for m in fewer if m.likelihood is not None]
            refused, why = self._not_needed(best, fewer) if not fails else (fewer or [self._begun_with], fails)
            if not refused:
                return best
            simpler = max(refused, key=lambda m: m.total)
            gone = " + ".join(sorted(set(best.key) - set(simpler.key)))
            best.unconfirmed = True
            best.refuse(f"{gone} is not announced: {why}", simpler)
            state.progress(best.outcome)
            self.unconfirmed += sorted(set(best.key) - set(simpler.key))
            best = simpler
        return best

    def _far_simpler(self, best: TriedModel) -> list[TriedModel]:
        """Return the most probable model of those with two effects less, three less and so on.

        Two effects that undo each other seem indispensable, each beside the other.
        """
        within = [m for m in self._tried.models.values() if m.key and set(m.key) < set(best.key) and m.in_full]
        return [
            max(alike, key=lambda m: m.total)
            for size in range(1, len(best.key) - 1)
            if (alike := [m for m in within if len(m.key) == size])
        ]

    def _not_simulated(self, stage: Stage) -> str:
        """Return why the records held out cannot be simulated by a model; an empty text where they can."""
        try:
            self._validated(stage)
        except SimulationError as error:
            return f"the records held out cannot be simulated with it: {error}"
        return ""

    def _not_needed(self, best: TriedModel, fewer: Sequence[TriedModel]) -> tuple[list[TriedModel], str]:
        """Return the models with fewer effects that do for the records held out, and why the rest is not announced."""
        state = self._state
        shown = self._tried.as_reported(best)
        worse = self._simulated_worse(shown)
        if worse and self._is_certain(best, shown):
            state.progress(f"{best.name}: the larger error of {' and '.join(worse)} may be chance")
            worse = ()
        refused: list[TriedModel] = []
        for model in fewer:
            dropped = " + ".join(sorted(set(best.key) - set(model.key)))
            try:
                without = self._validated(self._shown_without(model))
            except SimulationError as error:
                state.progress(f"without {dropped} the records held out cannot be simulated: {error}")
                continue
            gain = held_out_gain_of_errors(shown, without)
            state.progress(f"{dropped}: share of the held-out mean square error that is gone: {gain}")
            helps = gain.helps(POLICY.relevance, 0.0)
            if not helps:
                assert best.likelihood is not None
                assert model.likelihood is not None
                score = held_out_gain(state.problem, best.likelihood, model.likelihood)
                state.progress(f"{dropped}: log predictive score of {score.blocks} blocks held out {score}")
                helps = score.exceeds(POLICY.predictive_errors)
            harms = gain.harms(POLICY.harm, gain.in_normal_errors(POLICY.simulation_errors))
            if not helps or worse or harms or simulated_worse(shown, without, POLICY.growth_by_chance):
                refused.append(model)
        why = "the records held out are not predicted better"
        if worse:
            why = f"{' and '.join(worse)} of the records held out would be simulated worse than after calibration"
        return refused, why

    def _shown_without(self, model: TriedModel) -> Stage:
        """Return what an effect is compared with: the calibrated model as reported, any other as it was tried."""
        return self._tried.as_reported(model) if model is self._begun_with else model.stage

    @property
    def _begun_with(self) -> TriedModel:
        return self._tried.models[key_of(self._state.stages[-1].effects)]

    def _simulated_worse(self, stage: Stage) -> tuple[str, ...]:
        """Return the outputs of the records held out whose error a report would show grown since calibration."""
        return simulated_worse(stage, self._tried.as_reported(self._begun_with), POLICY.growth)

    def _is_certain(self, model: TriedModel, shown: Stage) -> bool:
        """Tell whether the records held out ask for a model although the error of an output is larger with it.

        Its rise must be one that so few records show by chance, and not large.
        """
        start = self._begun_with
        assert model.likelihood is not None
        calibrated = self._tried.as_reported(start)
        if start.likelihood is None or simulated_worse(shown, calibrated, POLICY.growth_by_chance):
            return False
        gain = self._held_out_gain_of_errors(shown, calibrated)
        if gain.harms(POLICY.harm, POLICY.simulation_errors):
            return False
        score = held_out_gain(self._state.problem, model.likelihood, start.likelihood)
        return score.exceeds(POLICY.certain_errors)

    def _held_out_gain_of_errors(self, one: Stage, other: Stage) -> SimulationGain:
        """Return by how much a stage, which has been validated, simulates the records held out better than another."""
        return held_out_gain_of_errors(one, self._validated(other))

    def _validated(self, stage: Stage) -> Stage:
        return stage if stage.validate is not None else with_validation(self._state.problem, stage)

    def _move_to_likeliest(self, model: TriedModel) -> None:
        """Move a model to the parameters of largest likelihood, unless it is clearly less probable there.

        Trials are fitted by least squares.  Beside a large random force these are far from the likeliest parameters:
        the strength of an effect is then mostly what the random force happened to be.  But the model without the effect
        was calibrated by least squares, and the records held out must not be predicted worse than by that.  The step is
        that of the linearised problem.  Where it is right the log evidence stays, but for what another linearisation
        makes of it, which is some nats where dry friction sticks.
        """
        likelihood = model.likelihood
        if likelihood is not None and model.by_least_squares is not None:
            fitted, model.by_least_squares = model.by_least_squares, None
            if self._predicts_worse(self._validated(model.stage), fitted):
                self._state.progress(f"{model.name} goes back to the parameters of least squares, which predict better")
                model.likelihood, model.at_likeliest = likelihood.neighbour(fitted), False
                self._tried.refresh(model)
            return
        if likelihood is None or model.at_likeliest:
            return
        try:
            stage = self._state.moved_to(likelihood.stage, likelihood.likeliest_values(), trial=True)
            there = likelihood.neighbour(with_validation(self._state.problem, stage))
            evidence = self._tried.evidence_of(there)
        except (RuntimeError, ModelError, np.linalg.LinAlgError) as error:
            self._state.progress(f"{model.name} stays at the parameters of least squares: {error}")
            return
        if evidence.total < model.total - POLICY.reach:
            return
        if self._predicts_worse(there.stage, likelihood.stage):
            self._state.progress(f"{model.name} stays at the parameters of least squares, which predict better")
            return
        self._state.progress(
            f"{model.name}: log evidence {evidence.total - model.total:+.1f} at the likeliest parameters"
        )
        model.likelihood, model.evidence, model.at_likeliest = there, evidence, True

    def _predicts_worse(self, moved: Stage, fitted: Stage) -> bool:
        """Tell whether a model predicts the records held out worse where it was moved than where it was fitted."""
        gain = self._held_out_gain_of_errors(moved, fitted)
        return gain.harms(POLICY.harm, POLICY.simulation_errors) or bool(self._simulated_worse(moved))

    def _beside_unknown_law(self, best: TriedModel) -> TriedModel:
        """Return the most probable of a model and those with one effect less or none, each with an unknown law.

        A force without a name is a rival of every name.  Where it explains the records clearly better than an effect
        does, and the effect adds nothing to it, the name is wrong, or is one of many that would do.  A free curve has
        no name that could be wrong, and the model that has it predicts.
        """
        curves = {e for effect in best.stage.effects if effect.definition.free_form for e in key_of([effect])}
        models = self._tried.models
        fewer = [models[key] for p in moves.drops(best) if (key := key_of(p.effects)) in models]
        if self._tried.start is not None:
            fewer.append(self._tried.start)
        rivals = list({m.key: m for m in (best, *fewer) if curves <= set(m.key)}.values())
        for model in rivals:
            self._ask_for_unknown_law(model)
        if best.key and best.unknown_law is not None and best.unknown_law.announced:
            for model in rivals:  # the effect and the function may be one law that acts at two places
                self._ask_for_a_second_place(model)
        self._tried.doubt()  # what was fitted since may have changed it, and the probabilities are shown with it
        likeliest = max(rivals[1:], key=lambda m: m.log_weight_with_law_in_place(best), default=best)
        if likeliest is best or likeliest.log_weight_with_law_in_place(best) <= best.log_weight_with_law:
            return best
        law = likeliest.unknown_law
        assert law is not None
        best.better = False
        best.outcome = f"a law that is not in the catalogue explains the records better: {law.name}"
        self._state.progress(f"{best.name}: {best.outcome}")
        return likeliest

    def _ask_for_unknown_law(self, model: TriedModel) -> None:
        likelihood = model.likelihood
        if likelihood is None or model.unknown_law is not None:
            return
        self._state.progress(f"what follows the machine's state beside {model.name}")
        model.unknown_law = self._state.if_simulated(
            "whether something follows the machine's state by an unknown law", lambda: unknown_law(likelihood)
        )
        likelihood.free_memory()
        give_back()

    def _ask_for_a_second_place(self, model: TriedModel) -> None:
        likelihood, law = model.likelihood, model.unknown_law
        if likelihood is None or law is None or law.gain <= 0.0:
            return
        self._state.progress(f"whether what follows the machine's state beside {model.name} acts at a second place")
        further = self._state.if_simulated(
            "whether an unknown law acts at a second place", lambda: at_a_second_place(likelihood, law)
        )
        model.unknown_law = further if further is not None else law
        likelihood.free_memory()
        give_back()
