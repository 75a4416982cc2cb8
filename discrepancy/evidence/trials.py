"""Trial fits: models that are offered are fitted, and stand among those that were tried with their evidence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.evidence.criterion import Evidence
from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.evidence.moves import TriedModel, key_of
from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.proposals import Proposal
from discrepancy.evidence.tried_models import TriedModels, judge, misfit
from discrepancy.stages.stage import Stage
from multibody.base.errors import ModelError
from multibody.base.memory import give_back
from multibody.base.parallel import parallel_map

if TYPE_CHECKING:
    from discrepancy.effects.effect import Effect
    from discrepancy.search.state import SearchState

__all__ = ["Trials", "most_believed"]

#: Of the step to the likeliest shapes that are tried, until one makes the model more probable: from afar the whole step
#: may lead to where the law is another, or none.
SHARES_OF_STEP = (1.0, 0.5, 0.25)


@dataclass(eq=False)
class Trials:
    """Fits of the models of a search.

    Parameters
    ----------
    tried : TriedModels
        Models are added to it, and replaced where a better fit is found.
    """

    tried: TriedModels

    @property
    def _state(self) -> SearchState:
        return self.tried.state

    def fitted(
        self, parent: TriedModel, offers: Sequence[tuple[Proposal, float]], look: bool = False
    ) -> list[TriedModel]:
        """Fit the models that are offered and keep them, each with its evidence.

        With ``look`` those that are hopeless where the fit begins are not fitted further, and after the time limit only
        the first.
        """
        state = self._state
        assert parent.likelihood is not None
        _ = parent.likelihood.noise  # before the fits go side by side
        done: list[TriedModel] = []

        def tried(offer: tuple[Proposal, float]) -> TriedModel:
            proposal, p_value = offer
            model = self._trial(proposal, parent, look=look, first=not done)
            model.p_value = p_value
            model.promised = proposal.promised if math.isfinite(proposal.promised) else -math.inf
            done.append(model)
            return model

        try:
            trials = parallel_map(tried, offers)
        except KeyboardInterrupt:
            self._keep(done, parent, moved=False)
            raise
        self._keep(trials, parent)
        give_back()
        for model in trials:
            rise = f"log evidence {model.total - parent.total:+.1f}, " if model.likelihood is not None else ""
            state.progress(f"{model.name}: {rise}{model.outcome}")
        return trials

    def _trial(self, proposal: Proposal, parent: TriedModel, *, look: bool, first: bool) -> TriedModel:
        """Return a model that was fitted, or why it was not; see `fitted`."""
        model = TriedModel(
            likelihood=None, key=key_of(proposal.effects), evidence=None, move=proposal.move, parent=parent.key
        )
        if look and not first and self._state.out_of_time_for(model.name):
            model.in_full, model.outcome = False, "not fitted: the search had reached its time limit"
        elif not (look and self._is_hopeless(model, proposal, parent)):
            try:
                self._fit(model, proposal, parent)
            except (RuntimeError, ModelError, np.linalg.LinAlgError) as error:
                model.outcome = str(error)
            if model.likelihood is None and not model.outcome:
                model.outcome = "a strength is zero: it would act the other way"
        return model

    def _fit(self, model: TriedModel, proposal: Proposal, parent: TriedModel) -> None:
        """Fit a model and its noise; without a likelihood it has failed.

        Least squares gives an effect that acts against a large random force no strength, the wrong sign, or a shape
        that fits the force.  So where it gives none, or the evidence is far below what it can be, the model is also
        asked at its likeliest parameters near those of a simpler model and the strengths that are expected beside it.
        """
        simpler = parent if set(parent.key) < set(model.key) else self.tried.best_within(model.key) or parent
        for effects in (proposal.effects, *proposal.laws):
            if effects is not proposal.effects and self._state.out_of_time_for(f"{model.name} with another law"):
                break
            this = replace(model, likelihood=None, evidence=None)
            try:
                self._fit_law(this, replace(proposal, effects=effects), parent, simpler)
            except (RuntimeError, ModelError, np.linalg.LinAlgError):
                if not proposal.laws:
                    raise
            if this.likelihood is not None and this.total > model.total:
                model.likelihood, model.evidence, model.at_likeliest = this.likelihood, this.evidence, this.at_likeliest
            model.outcome = model.outcome or this.outcome
        if model.likelihood is not None:
            model.outcome = ""
            model.likelihood.free_memory()

    def _fit_law(self, model: TriedModel, proposal: Proposal, parent: TriedModel, simpler: TriedModel) -> None:
        """Fit a model with one law for each of its effects; without a likelihood it has failed."""
        fit = self._by_likelihood(proposal, parent, simpler) if self.tried.settled else None
        model.at_likeliest = fit is not None
        if fit is None:
            fit = self._by_least_squares(model, proposal, parent, simpler)
        if fit is not None and math.isfinite(fit[1].total):
            model.likelihood, model.evidence = self._with_likeliest_shapes(*fit)

    def _by_likelihood(
        self, proposal: Proposal, parent: TriedModel, simpler: TriedModel
    ) -> tuple[StageLikelihood, Evidence] | None:
        """Return a model at its likeliest parameters, from the strengths that are expected; None if it is not there.

        Where the evidence settles at the likeliest parameters, least squares leads away from them, and takes longer.
        What a law that is not linear in its strength may begin with otherwise begins with the parameters as stated; see
        `_best_fit`.
        """
        best: tuple[StageLikelihood, Evidence] | None = None
        for effects in (proposal.effects, *proposal.starts):
            self._state.progress(f"likeliest parameters of {' + '.join(key_of(effects))}")
            this, stated = replace(proposal, effects=effects), effects is not proposal.effects
            try:
                way = self.tried.way_to_likeliest(*self._near_expected(this, parent, simpler, stated=stated))
            except (RuntimeError, ModelError, np.linalg.LinAlgError):
                continue
            total = way.end[1].total
            if not way.settled and simpler is parent and total - parent.total > most_believed(proposal.promised):
                continue  # it comes from another linearisation
            if best is None or total > best[1].total:
                best = way.end
        return None if best is None or best[1].total < _least_believed(proposal, parent, simpler) else best

    def _by_least_squares(
        self, model: TriedModel, proposal: Proposal, parent: TriedModel, simpler: TriedModel
    ) -> tuple[StageLikelihood, Evidence] | None:
        """Return a model as least squares fits it, or near the strengths that are expected if that fails."""
        stage = self._best_fit(model, proposal, parent)
        if stage is None and model.outcome:
            return None
        fit = self._with_noise(stage, proposal, parent) if stage is not None else None
        if fit is not None:
            fit = self._likelier(model, fit)
        if fit is None or fit[1].total < _least_believed(proposal, parent, simpler):
            try:
                there = self._near_expected(proposal, parent, simpler)
                if simpler is parent and there[1].total - parent.total > most_believed(proposal.promised):
                    raise RuntimeError(
                        "the evidence rises far above what the score promises: it comes from another linearisation"
                    )
            except (RuntimeError, ModelError, np.linalg.LinAlgError):
                if fit is None:
                    raise
            else:
                there = self._likelier(model, there)
                if fit is None or there[1].total > fit[1].total:
                    rise = f" {there[1].total - fit[1].total:+.1f}" if fit is not None else ""
                    self._state.progress(f"{model.name}: log evidence{rise} near the strengths that are expected")
                    fit, model.at_likeliest = there, True
        return fit

    def _likelier(self, model: TriedModel, fit: tuple[StageLikelihood, Evidence]) -> tuple[StageLikelihood, Evidence]:
        """Return a fit of a model at its likeliest parameters, if models are moved there."""
        likelier = self.tried.at_likelier_parameters(*fit)
        model.at_likeliest = model.at_likeliest or likelier is not None
        return likelier or fit

    def _with_noise(self, stage: Stage, proposal: Proposal, parent: TriedModel) -> tuple[StageLikelihood, Evidence]:
        """Return a fitted model's likelihood, with its noise fitted from that of its parent, and its evidence."""
        assert parent.likelihood is not None
        likelihood = parent.likelihood.neighbour(stage, proposal.noise)
        if proposal.new_noise:  # as rich as that of the model that is extended
            likelihood = likelihood.with_richer_noise()
        return likelihood, self.tried.evidence_of(likelihood)

    def fitted_once(self, model: TriedModel, proposals: Sequence[Proposal]) -> list[TriedModel]:
        """Return the models of some proposals: those that were not tried yet are fitted, others from here as well."""
        tried = {key for key, m in self.tried.models.items() if m.in_full}
        new = [(p, 1.0) for p in proposals if key_of(p.effects) not in tried]
        if new:
            self.fitted(model, new)
        fitted = {key_of(p.effects) for p, _ in new}
        for proposal in proposals:
            if key_of(proposal.effects) not in fitted:
                self.fit_from(model, self.tried.models[key_of(proposal.effects)], proposal.effects)
        return [self.tried.models[key_of(p.effects)] for p in proposals]

    def fit_from(self, model: TriedModel, other: TriedModel, effects: tuple[Effect, ...]) -> bool:
        """Fit a model that was tried once more, beginning where another stands; tell whether that is better, and kept.

        A fit that ended in a local minimum would make the effect that the other model has beside it look indispensable.
        """
        if other.likelihood is None or model.likelihood is None:
            return False
        if self.tried.settled:
            return self._moved_from(model, other, effects)
        stage = self._best_fit(other, Proposal(move="drop", effects=effects), model)
        scale = model.stage.identify.scale
        if stage is None or not misfit(stage, scale) < (1.0 - POLICY.relevance) * misfit(other.stage, scale):
            return False
        likelihood = model.likelihood.neighbour(stage)
        fit = likelihood, self.tried.evidence_of(likelihood)
        likelier = self.tried.at_likelier_parameters(*fit)
        return self._replaced(other, likelier or fit, at_likeliest=likelier is not None)

    def _moved_from(self, model: TriedModel, other: TriedModel, effects: tuple[Effect, ...]) -> bool:
        """Move a model to its likeliest parameters once more, from those of another; tell whether that is better."""
        assert model.likelihood is not None
        try:
            there = model.likelihood.neighbour(self._state.unfitted(other.name, effects, model.stage))
            way = self.tried.way_to_likeliest(there, self.tried.evidence_of(there))
        except (RuntimeError, ModelError, np.linalg.LinAlgError):
            return False
        return self._replaced(other, way.end, at_likeliest=True, least=POLICY.improvement)

    def _replaced(
        self, other: TriedModel, fit: tuple[StageLikelihood, Evidence], *, at_likeliest: bool, least: float = 0.0
    ) -> bool:
        """Let a model stand where another fit of it has ended, if it is more probable there; tell whether it is."""
        rise = fit[1].total - other.total
        if rise <= least:
            return False
        self._state.progress(f"{other.name}: log evidence {rise:+.1f} from other start values")
        (other.likelihood, other.evidence), other.at_likeliest = fit, at_likeliest
        return True

    def calibrate_again(self, model: TriedModel) -> bool:
        """Fit a model once more where its likeliest parameters have the smaller misfit; tell whether that is better.

        Least squares has then ended elsewhere, and a random force that makes up for it hides what is missing.
        """
        if model.likelihood is None or model.at_likeliest:
            return False
        scale = model.stage.identify.scale
        try:
            stage = self._state.moved_to(model.stage, model.likelihood.likeliest_values(), trial=True)
            if misfit(stage, scale) >= (1.0 - POLICY.relevance) * misfit(model.stage, scale):
                return False
            there = replace(model, likelihood=model.likelihood.neighbour(stage))
        except (RuntimeError, ModelError, np.linalg.LinAlgError):
            return False
        return self.fit_from(there, model, model.stage.effects)

    def _keep(self, trials: Sequence[TriedModel], parent: TriedModel, *, moved: bool = True) -> None:
        """Judge models that were fitted, and let them be among those that were tried.

        With ``moved`` the best are moved to their likeliest parameters before.
        """
        self.tried.share_noise(sorted(trials, key=lambda m: -m.total)[: POLICY.beam], parent, trials)
        if moved:
            self._move_rivals(trials, parent)
        for model in trials:
            self.tried.share_noise_of_simpler(model)
            if model.likelihood is not None:
                judge(model, parent, self.tried.wander)
            self.tried.models[model.key] = model

    def _move_rivals(self, trials: Sequence[TriedModel], parent: TriedModel) -> None:
        """Move the best of some models, and the one that they extend, to their likeliest parameters.

        Those are the best that the evidence, which is linear from where least squares put them, cannot tell: it may be
        off by tens of nats for one of them and by none for another.
        """
        fitted = [m for m in trials if m.likelihood is not None and m.in_full]
        best = max((m.total for m in fitted), default=parent.total)
        gain = best - parent.total
        if gain > POLICY.improvement:
            near = [m for m in fitted if m.total >= best - POLICY.error_of_gain(gain)]
            parallel_map(self.tried.move_to_likeliest, [parent, *near])

    def _is_hopeless(self, model: TriedModel, proposal: Proposal, parent: TriedModel) -> bool:
        """Tell whether a model is so improbable where its fit begins that no fit of it matters; then it stays there.

        The evidence there is that of the linearised problem at its likeliest parameters.  A fit by simulation moves the
        linearisation, and the evidence by no more than linear evidence may be off.  Where it lies below that of the
        model that the search began with by more than its effects cost, it is wrong: their strengths could be zero.  Not
        asked is a model of which the score says what it promises, and one with a law that is not linear in its strength
        or that stands for what was taken for random: of these the linearised problem does not tell.
        """
        new = [e for e in proposal.effects if str(e) not in parent.key]
        linear = all(e.definition.linear for e in new) and not proposal.starts
        if math.isfinite(proposal.promised) or proposal.new_noise or not linear:
            return False
        assert parent.likelihood is not None
        try:
            there = parent.likelihood.neighbour(
                self._state.unfitted(model.name, proposal.effects, parent.stage), proposal.noise
            )
            evidence = self.tried.evidence_of(there)
        except (RuntimeError, ModelError, np.linalg.LinAlgError):
            return False
        best = max(m.total for m in self.tried.models.values())
        first = next(iter(self.tried.models.values())).total
        least = first - POLICY.reach * len(proposal.effects)
        most = best - POLICY.reach - POLICY.error_of_gain(best - first)
        if not least <= evidence.total < most:
            return False
        model.likelihood, model.evidence, model.in_full = there, evidence, False
        self._state.progress(f"{model.name}: begins {best - evidence.total:.1f} nats below the best, and is not fitted")
        there.free_memory()
        return True

    def _best_fit(self, model: TriedModel, proposal: Proposal, parent: TriedModel) -> Stage | None:
        """Return the best fit of a model, and note why there is none.

        Calibration of a model without a backlash replaces it by other parameters as well as possible, a softer spring
        for instance, and from there no small step leads to the backlash.  So what a law that is not linear in its
        strength may begin with otherwise begins with the parameters as stated.  A fit that ends above the misfit of the
        parent, which is the same model with strengths of zero, has ended in a minimum of its own, and is none.
        """
        best: Stage | None = None
        scale = parent.stage.identify.scale
        added = {str(e) for e in parent.stage.effects} <= {str(e) for e in proposal.effects}
        most = (1.0 + POLICY.relevance) * misfit(parent.stage, scale) if added else math.inf
        starts = [(proposal.effects, False), *((effects, True) for effects in proposal.starts)]
        for effects, from_prior in starts:
            self._state.progress(f"fit with {model.name}")
            try:
                stage = self._state.on_trial(model.name, effects, parent.stage, from_prior=from_prior)
            except (RuntimeError, ModelError) as error:
                model.outcome = model.outcome or f"could not be simulated: {error}"
                continue
            present = all(any(e.strengths.values()) for e in stage.effects) and misfit(stage, scale) <= most
            if present and (best is None or misfit(stage, scale) < misfit(best, scale)):
                best = stage
        return best

    def _near_expected(
        self, proposal: Proposal, parent: TriedModel, simpler: TriedModel, *, stated: bool = False
    ) -> tuple[StageLikelihood, Evidence]:
        """Return a model at its likeliest parameters, in the problem linearised at the strengths that are expected.

        The parameters are those of a simpler model there, or as stated.

        Raises
        ------
        RuntimeError
            If the likeliest strength is none.
        """
        assert simpler.likelihood is not None
        name = " + ".join(key_of(proposal.effects))
        begin = self.tried.at_stated_values(simpler.stage) if stated else simpler.stage
        expected = self._state.unfitted(name, proposal.effects, begin)
        values = simpler.likelihood.neighbour(expected, proposal.noise).likeliest_values()
        stage = self._state.moved_to(expected, values, trial=True)
        if not all(any(e.strengths.values()) for e in stage.effects):
            raise RuntimeError("a strength is zero: it would act the other way")
        return self._with_noise(stage, proposal, simpler)

    def _with_likeliest_shapes(
        self, likelihood: StageLikelihood, evidence: Evidence
    ) -> tuple[StageLikelihood, Evidence]:
        """Return a model with the shapes of its laws moved to the largest likelihood, where it is more probable there.

        A strength is integrated out about its likeliest value; a shape, such as the place about which a spring bends,
        is held where least squares put it, and beside a random force that is not where it is likeliest.  It stays where
        the evidence does not settle.  A linearisation from afar does not lead there in one step.
        """
        shapes = [k for e in likelihood.stage.effects for k in e.definition.free_shapes]
        if not shapes or not likelihood.noise.model.processes or self.tried.wander:
            return likelihood, evidence
        for _ in range(POLICY.likeliest_steps):
            there = self._nearer_likeliest_shapes(likelihood, evidence)
            if there is None:
                break
            rise = there[1].total - evidence.total
            self._state.progress(f"{likelihood.stage.name}: log evidence {rise:+.1f} nearer its likeliest shapes")
            likelihood, evidence = there
        return likelihood, evidence

    def _nearer_likeliest_shapes(
        self, likelihood: StageLikelihood, evidence: Evidence
    ) -> tuple[StageLikelihood, Evidence] | None:
        """Return a more probable model on the way to the likeliest shapes; None if none is promised or found.

        A rise far above what the linearised likelihood promises comes from another linearisation as well.
        """
        promised = likelihood.promise_of_shapes()
        if promised <= POLICY.improvement:
            return None
        here, likeliest = likelihood.stage.identify.to_dict(), likelihood.likeliest_values(shapes=True)
        for share in SHARES_OF_STEP:
            values = {name: here[name] + share * (value - here[name]) for name, value in likeliest.items()}
            try:
                there = likelihood.neighbour(self._state.moved_to(likelihood.stage, values, trial=True))
                moved = self.tried.evidence_of(there)
            except (RuntimeError, ModelError, np.linalg.LinAlgError):
                continue
            if 0.0 < moved.total - evidence.total <= most_believed(promised):
                return there, moved
        return None


def most_believed(promised: float) -> float:
    """Return the rise of the log evidence up to which it is that of the effect, given what the effect's score promises.

    Another linearisation alone changes the evidence: where dry friction sticks by hundreds of nats, beside a spring
    that bends and a large random force by tens.
    """
    return max(promised, 0.0) + POLICY.error_of_gain(promised)


def _least_believed(proposal: Proposal, parent: TriedModel, simpler: TriedModel) -> float:
    """Return the log evidence below which a fit has ended in the wrong place.

    With all that a simpler model has and more, a model lies below it by no more than the further effects cost; above
    its parent it lies by what the score of an effect promises.
    """
    more = set(key_of(proposal.effects)) - set(simpler.key)
    if not set(simpler.key) < set(key_of(proposal.effects)):
        return -math.inf
    if simpler is not parent or proposal.new_noise or not math.isfinite(proposal.promised):
        return simpler.total - POLICY.reach * len(more)
    return parent.total + proposal.promised - POLICY.error_of_gain(proposal.promised)
