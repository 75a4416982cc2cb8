"""The search by evidence: models are extended from the best of those that were fitted, while the evidence rises."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.evidence import moves
from discrepancy.evidence.criterion import Evidence, ModelPrior, log_evidence
from discrepancy.evidence.laws_of_a_curve import CurveLaws, laws_of_curves
from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.evidence.moves import TriedModel, key_of
from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.posterior import rivals_of
from discrepancy.evidence.predictive import (
    PredictiveGain,
    held_out_gain,
    predictive_gain,
)
from discrepancy.evidence.proposals import Proposal, Proposals, entries_of, propose, proposed_effects
from discrepancy.evidence.standstill import places_that_stick
from discrepancy.evidence.unknown_law import unknown_law
from discrepancy.search.moves import Decision
from discrepancy.stages.fit_stage import with_validation
from discrepancy.stages.held_out_errors import SimulationGain, held_out_gain_of_errors
from discrepancy.stages.stage import AcceptedEffect, Stage
from discrepancy.statistics.thresholds import LEVEL_SHARES
from multibody.base.errors import ModelError
from multibody.base.memory import give_back
from multibody.base.parallel import parallel_map
from multibody.base.quantity_text import count_text

if TYPE_CHECKING:
    from discrepancy.effects.catalogue import Entry
    from discrepancy.effects.effect import Effect
    from discrepancy.search.state import SearchState

__all__ = ["EvidenceSearch"]


@dataclass(eq=False)
class EvidenceSearch:
    """A search for the effects that a model lacks, by the marginal likelihood of whole models.

    Parameters
    ----------
    state : SearchState
        Its stages are made; its decisions list what was asked.

    Attributes
    ----------
    models : dict of tuple to TriedModel
        Every model that was fitted, by the sorted names of its effects.
    predictive : dict of str to PredictiveGain
        By how much records left out are predicted better with an effect.
    unconfirmed : list of str
        Effects that no record held out is predicted better with.
    prior : ModelPrior or None
    expansions : int
        How often a model was extended, one that was fitted again each time.
    """

    state: SearchState
    models: dict[tuple[str, ...], TriedModel] = field(default_factory=dict, init=False)
    predictive: dict[str, PredictiveGain] = field(default_factory=dict, init=False)
    unconfirmed: list[str] = field(default_factory=list, init=False)
    prior: ModelPrior | None = field(default=None, init=False)
    expansions: int = field(default=0, init=False)

    def run(self) -> None:
        """Extend the best models, keep of the best what predicts better, and make its stages."""
        state = self.state
        start = self._known(state.stage)
        while (model := self._next()) is not None:
            if self.expansions and state.out_of_time_for(f"what is missing beside {model.name}"):
                break
            self._extend(model)
        best = self._confirmed(self._kept_by_prediction(self._ranked()[0]))
        best = self._beside_unknown_law(best)
        best.taken = True
        self._make_stages(start, best)

    @property
    def likelihood(self) -> StageLikelihood | None:
        """Of the latest stage's model; None where the search was interrupted before that was tried."""
        model = self.models.get(key_of(self.state.stages[-1].effects))
        return model.likelihood if model is not None else None

    @property
    def start(self) -> TriedModel | None:
        """The model without effects, if it was tried."""
        return self.models.get(())

    @property
    def taken(self) -> TriedModel | None:
        """The model that is the answer; None before there is one."""
        return next((m for m in self.models.values() if m.taken), None)

    def untested(self) -> str:
        """Return a sentence on the best model of a search that was interrupted; empty if there is none better."""
        ranked = self._ranked()
        if self.taken is not None or self.start is None or not ranked or not ranked[0].key:
            return ""
        best, count = ranked[0], sum(m.likelihood is not None for m in self.models.values()) - 1
        return (
            f"Of {count_text(count, 'model')} with effects fitted until then, the most probable is {best.name} (log "
            f"evidence {best.total - self.start.total:+.1f} over the model without); the test whether it predicts "
            "records that were left out better was not finished."
        )

    # ---------------------------------------------------------------- the beam

    def _ranked(self) -> list[TriedModel]:
        """Return the models that may be extended or taken, best first."""
        return sorted((m for m in self.models.values() if m.better), key=lambda m: -m.total)

    def _next(self) -> TriedModel | None:
        """Return the model to extend next; None where the search ends.

        It is the best one.  Once that was extended in vain, it is another that is as good but for the error of the
        evidence: an effect that gains nothing beside the best hardly makes up for more.
        """
        while True:
            beam = self._ranked()[: POLICY.beam]
            within = [m for m in beam if m.total >= beam[0].total - POLICY.reach]
            if not [m for m in within if self._refine(m)]:  # each of them: it may change the order
                break
        if self.expansions >= POLICY.expansions:
            return None
        as_good = [m for m in within if m.total >= beam[0].total - POLICY.improvement]
        return next((m for m in as_good if not m.expanded), None)

    def _refine(self, model: TriedModel) -> bool:
        """Let the noise of a model have further latent processes; tell whether that was not done before."""
        if model.likelihood is None or model.likelihood.grow:
            return False
        self.state.progress(f"what is random beside {model.name}")
        model.likelihood = model.likelihood.with_richer_noise()
        self._refresh(model)
        if model.parent is not None:
            parent = self.models[model.parent]
            children = [m for m in self.models.values() if m.parent == parent.key and m.likelihood is not None]
            if self._share_noise([model], parent, children):
                for child in children:
                    if child.matters:
                        self._judge(child, parent)
        model.likelihood.free_memory()
        give_back()
        return True

    def _share_noise(self, sources: Sequence[TriedModel], parent: TriedModel, children: Sequence[TriedModel]) -> bool:
        """Fit the noise of a model once more from that of better ones, and if that is likelier, that of its children.

        The likelihood of a noise model has several maxima.  One that was found beside an effect, and would do as well
        without it, must not count for the effect; nor must one that was found later count against those before it.
        """
        better = [m for m in sources if m.total > parent.total and self._with_noise_of(m, parent)]
        if better:
            for child in children:
                self._with_noise_of(parent, child)
        return bool(better)

    def _share_noise_of_simpler(self, model: TriedModel) -> None:
        """Fit the noise of a model once more, from that of the best with fewer of its effects, if it lies far below.

        Its effects may all be nearly zero, so it is as likely as that but for the price of their names.  One that is
        made by an exchange or by dropping an effect begins with the random forces found beside what it no longer has,
        and may lack one that stands for that.
        """
        simpler = [m for m in self.models.values() if m.likelihood is not None and set(m.key) < set(model.key)]
        best = max(simpler, key=lambda m: m.total, default=model)
        if best.total > model.total + POLICY.reach:
            self._with_noise_of(best, model)

    def _with_noise_of(self, source: TriedModel, model: TriedModel) -> bool:
        """Fit the noise of a model once more, from that of another; tell whether it is likelier."""
        if source.likelihood is None or model.likelihood is None:
            return False
        likelier = model.likelihood.with_likelier_noise(source.likelihood.noise.model)
        if likelier is None:
            return False
        before, model.likelihood = model.total, likelier
        self._refresh(model)
        self.state.progress(
            f"{model.name}: log evidence {model.total - before:+.1f} with the random forces found beside {source.name}"
        )
        return True

    def _extend(self, model: TriedModel) -> None:
        """Score the candidates of a model, fit those that promise most, and keep every model that was fitted."""
        state, problem = self.state, self.state.problem
        likelihood = model.likelihood
        assert likelihood is not None
        stage = likelihood.stage
        model.expanded = True
        self.expansions += 1
        state.progress(f"extend the model with {model.name}")
        proposals = state.if_simulated("what is still missing", lambda: self._proposals(likelihood))
        if proposals is None:
            model.outcome = "it could not be asked what is still missing"
            return
        model.proposals = proposals
        if self.prior is None:
            self.prior = self._prior(stage, proposals)
            self._refresh(model)
        offers: list[tuple[Proposal, float]] = []
        room = problem.max_effects - len(stage.effects)
        p_values = {r.name: r.p_value for r in proposals.scan.rows}
        if room > 0:
            offers += [(p, p_values.get(str(p.effects[-1]), 1.0)) for p in moves.additions(proposals, stage.effects)]
            curves = state.if_simulated("free curves", lambda: self._curves(likelihood))
            offers += curves or []
        if room > 1:
            offers += [(p, 1.0) for p in moves.pairs_in_place_of_random(proposals, stage.effects)]
            offers += [(p, 1.0) for p in moves.pairs(proposals, stage)]
        if len(stage.effects) > 1:
            offers += [(p, 1.0) for p in moves.exchanges(model, self._rival_effects(model))]
        offers += [(p, 1.0) for p in moves.names_of_curves(model, self._entries(stage), room)]
        new = [(p, q) for p, q in offers if key_of(p.effects) not in self.models]
        likelihood.free_memory()
        give_back()
        trials = self._fitted(model, new, look=True)
        if self._fitted_again(model, [p.promised for p, _ in new], trials):
            return
        state.decisions.append(
            Decision(scans=(proposals.scan,), reason=self._reason(model, trials), refused=proposals.refused)
        )

    def _fitted_again(self, model: TriedModel, promised: Sequence[float], trials: Sequence[TriedModel]) -> bool:
        """Fit a model once more, beginning where one of its extensions stands; tell whether that is better, and kept.

        That is asked where the evidence rises far above what the score promised: any effect gains so much if the model
        is calibrated in the wrong place.  The extensions, which began there, are then forgotten.
        """
        beyond = [t for t, p in zip(trials, promised, strict=True) if t.total - model.total > _most_believed(p)]
        if not beyond or not self._fit_from(max(beyond, key=lambda t: t.total), model, model.stage.effects):
            return False
        for child in trials:
            del self.models[child.key]
        model.expanded, model.proposals = False, None
        return True

    def _proposals(self, likelihood: StageLikelihood) -> Proposals:
        problem = self.state.problem
        return propose(
            likelihood,
            include=problem.include,
            exclude=problem.exclude,
            level=problem.level,
            seed=problem.seed + len(likelihood.stage.effects),
            progress=self.state.progress,
        )

    def _curves(self, likelihood: StageLikelihood) -> list[tuple[Proposal, float]]:
        problem = self.state.problem
        self.state.progress(f"free curves at {len(likelihood.stage.system.places)} places")
        return moves.curve(likelihood, level=problem.level / LEVEL_SHARES, seed=problem.seed)

    def _prior(self, stage: Stage, proposals: Proposals) -> ModelPrior:
        """Return what is known of models before the records are seen, from the first model that is extended."""
        names = [e.name for e in self._entries(stage)]
        shapes = {c.name: len(c.candidate.shapes) for c in proposals.candidates}
        values = self.state.stages[0].p
        stated = dict(zip(self.state.stages[0].system.parameter_names, map(float, values), strict=False))
        return ModelPrior(candidates=len(names), shapes=shapes, stated=stated)

    def _entries(self, stage: Stage) -> list[Entry]:
        return entries_of(stage, self.state.problem.include, self.state.problem.exclude)

    def laws_of_curves(self) -> list[tuple[Effect, list[CurveLaws]]]:
        """Return the free curves of the model that is the answer, each with the laws that come nearest to it."""
        likelihood = self.likelihood
        if likelihood is None:
            return []
        stage = likelihood.stage
        found = laws_of_curves(likelihood.linearised, stage.effects, self._entries(stage))
        return [(curve, laws) for curve, _, laws in found]

    def _rival_effects(self, model: TriedModel) -> dict[str, list[Proposal]]:
        """Return what else may stand in the place of each effect of a model: the candidates of the model without it."""
        rivals: dict[str, list[Proposal]] = {}
        for effect in model.stage.effects:
            rest = tuple(e for e in model.stage.effects if e is not effect)
            asked = [m for m in self.models.values() if m.proposals is not None and str(effect) not in m.key]
            asked.sort(key=lambda m: len(set(m.key) ^ set(key_of(rest))))
            if not asked:
                continue
            source = asked[0].proposals
            assert source is not None
            own = source.named(str(effect))
            least = own.gain - max(POLICY.reach, POLICY.linear_error * own.gain) if own is not None else 0.0
            names = [c for c in source.candidates if c.gain > max(least, 0.0) and c is not own]
            rivals[str(effect)] = [proposed_effects(c, rest) for c in names[: POLICY.rivals]]
        return rivals

    def _fitted(
        self, parent: TriedModel, offers: Sequence[tuple[Proposal, float]], look: bool = False
    ) -> list[TriedModel]:
        """Fit the models that are offered and keep them, each with its evidence.

        With ``look`` those that are hopeless where the fit begins are not fitted further, and after the time limit only
        the first.
        """
        state = self.state
        assert parent.likelihood is not None
        source = parent.likelihood
        _ = source.noise  # before the fits go side by side

        done: list[TriedModel] = []

        def tried(offer: tuple[Proposal, float]) -> TriedModel:
            model = fitted(offer)
            done.append(model)
            return model

        def fitted(offer: tuple[Proposal, float]) -> TriedModel:
            proposal, p_value = offer
            model = TriedModel(
                likelihood=None,
                key=key_of(proposal.effects),
                evidence=None,
                move=proposal.move,
                parent=parent.key,
                p_value=p_value,
            )
            if look and done and state.out_of_time_for(model.name):
                model.outcome = "not fitted: the search had reached its time limit"
                return model
            if look and self._is_hopeless(model, proposal, parent):
                return model
            stage = self._best_fit(model, proposal, parent)
            if stage is not None or not model.outcome:
                try:
                    if stage is None:
                        stage = self._likeliest_near_expected(model, proposal, parent)
                    likelihood = source.neighbour(stage, proposal.noise)
                    if proposal.new_noise:  # as rich as that of the model that is extended
                        likelihood = likelihood.with_richer_noise()
                    assert self.prior is not None
                    evidence = log_evidence(likelihood, self.prior)
                    if model.at_likeliest and evidence.total - parent.total > _most_believed(proposal.promised):
                        raise RuntimeError(
                            "least squares gives it no strength, and the rise of the evidence is far above what its "
                            "score promises: it comes from another linearisation"
                        )
                    if math.isfinite(evidence.total):
                        likelihood, evidence = self._with_likeliest_shapes(likelihood, evidence)
                        model.likelihood, model.evidence = likelihood, evidence
                        likelihood.free_memory()
                except (RuntimeError, ModelError, np.linalg.LinAlgError) as error:
                    model.outcome = str(error)
            if model.likelihood is None and not model.outcome:
                model.outcome = "a strength is zero: it would act the other way"
            return model

        try:
            trials = parallel_map(tried, offers)
        except KeyboardInterrupt:
            self._keep(done, parent)
            raise
        self._keep(trials, parent)
        give_back()
        for model in trials:
            rise = f"log evidence {model.total - parent.total:+.1f}, " if model.likelihood is not None else ""
            state.progress(f"{model.name}: {rise}{model.outcome}")
        return trials

    def _keep(self, trials: Sequence[TriedModel], parent: TriedModel) -> None:
        """Judge models that were fitted, and let them be among those that were tried."""
        self._share_noise(sorted(trials, key=lambda m: -m.total)[: POLICY.beam], parent, trials)
        for model in trials:
            self._share_noise_of_simpler(model)
            if model.likelihood is not None:
                self._judge(model, parent)
            self.models[model.key] = model

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
        assert self.prior is not None
        try:
            there = parent.likelihood.neighbour(
                self.state.unfitted(model.name, proposal.effects, parent.stage), proposal.noise
            )
            evidence = log_evidence(there, self.prior)
        except (RuntimeError, ModelError, np.linalg.LinAlgError):
            return False
        best = max(m.total for m in self.models.values())
        first = next(iter(self.models.values())).total
        least = first - POLICY.reach * len(proposal.effects)
        most = best - POLICY.reach - max(POLICY.reach, POLICY.linear_error * (best - first))
        if not least <= evidence.total < most:
            return False
        model.likelihood, model.evidence, model.in_full = there, evidence, False
        self.state.progress(f"{model.name}: begins {best - evidence.total:.1f} nats below the best, and is not fitted")
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
        most = (1.0 + POLICY.relevance) * _misfit(parent.stage, scale) if added else math.inf
        starts = [(proposal.effects, False), *((effects, True) for effects in proposal.starts)]
        for effects, from_prior in starts:
            self.state.progress(f"fit with {model.name}")
            try:
                stage = self.state.on_trial(model.name, effects, parent.stage, from_prior=from_prior)
            except (RuntimeError, ModelError) as error:
                model.outcome = model.outcome or f"could not be simulated: {error}"
                continue
            present = all(any(e.strengths.values()) for e in stage.effects) and _misfit(stage, scale) <= most
            if present and (best is None or _misfit(stage, scale) < _misfit(best, scale)):
                best = stage
        return best

    def _likeliest_near_expected(self, model: TriedModel, proposal: Proposal, parent: TriedModel) -> Stage:
        """Return a model at its likeliest parameters, in the problem linearised at the strengths that are expected.

        Least squares gives an effect that acts against a large random force no strength at all, or the wrong sign.

        Raises
        ------
        RuntimeError
            If the likeliest strength is none either.
        """
        assert parent.likelihood is not None
        expected = self.state.unfitted(model.name, proposal.effects, parent.stage)
        values = parent.likelihood.neighbour(expected, proposal.noise).likeliest_values()
        stage = self.state.moved_to(expected, values)
        if not all(any(e.strengths.values()) for e in stage.effects):
            raise RuntimeError("a strength is zero: it would act the other way")
        model.at_likeliest = True
        return stage

    def _with_likeliest_shapes(
        self, likelihood: StageLikelihood, evidence: Evidence
    ) -> tuple[StageLikelihood, Evidence]:
        """Return a model with the shapes of its laws moved to the largest likelihood, if it is more probable there.

        A strength is integrated out about its likeliest value; a shape, such as the place about which a spring bends,
        is held where least squares put it, and beside a random force that is not where it is likeliest.  With dry
        friction it stays: what sticks does not follow from a linearisation elsewhere.  A rise far above what the
        linearised likelihood promises comes from another linearisation as well.
        """
        shapes = [k for e in likelihood.stage.effects for k in e.definition.free_shapes]
        if not shapes or not likelihood.noise.model.processes or places_that_stick(likelihood.linearised):
            return likelihood, evidence
        promised = likelihood.promise_of_shapes()
        if promised <= POLICY.improvement:
            return likelihood, evidence
        try:
            stage = self.state.moved_to(likelihood.stage, likelihood.likeliest_values(shapes=True))
            there = likelihood.neighbour(stage)
            assert self.prior is not None
            moved = log_evidence(there, self.prior)
        except (RuntimeError, ModelError, np.linalg.LinAlgError):
            return likelihood, evidence
        rise = moved.total - evidence.total
        if not 0.0 < rise <= _most_believed(promised):
            return likelihood, evidence
        self.state.progress(f"{stage.name}: log evidence {rise:+.1f} at the likeliest shapes")
        return there, moved

    def _judge(self, model: TriedModel, parent: TriedModel) -> None:
        """Note whether a model is better than the one that it was made of."""
        if not model.in_full:
            model.better, model.outcome = False, "not fitted: far below the best model where the fit would begin"
            return
        gain = model.total - parent.total
        # laws in the place of a curve are the same force, with fewer parameters
        more = len(model.stage.effects) > len(parent.stage.effects) and model.move != "name a curve"
        if gain <= (POLICY.improvement if more else 0.0):
            model.better, model.outcome = False, "not better"
        elif more and (why := moves.why_irrelevant(model, parent)):
            model.refuse(f"better, but {why}")
        else:
            model.better, model.outcome = True, "better"

    def _known(self, stage: Stage) -> TriedModel:
        """Return the model of a stage among those that were tried; it joins them if it is new."""
        key = key_of(stage.effects)
        if key not in self.models:
            self.state.progress("what is random: sensor noise and latent forces")
            likelihood = StageLikelihood(stage=stage)
            model = TriedModel(likelihood=likelihood, key=key, evidence=None, outcome="start", better=True)
            self.models[key] = model
            self._refresh(model)
        return self.models[key]

    def _refresh(self, model: TriedModel) -> None:
        prior = self.prior or ModelPrior(candidates=1, shapes={}, stated={})
        assert model.likelihood is not None
        model.evidence = log_evidence(model.likelihood, prior)

    @staticmethod
    def _reason(model: TriedModel, trials: Sequence[TriedModel]) -> str:
        if not trials:
            return "no candidate promises a better model"
        best = max(trials, key=lambda m: m.total)
        return f"the best of {len(trials)} models is {best.name}, log evidence {best.total - model.total:+.1f}"

    # ---------------------------------------------------------------- what remains

    def _kept_by_prediction(self, best: TriedModel) -> TriedModel:
        """Drop effects without which records left out are predicted as well, one after another."""
        state = self.state
        while best.key and best.likelihood is not None:
            weakest: tuple[float, TriedModel, str] | None = None
            for model in self._fitted_once(best, [*self._simplifications(best), *moves.drops(best)]):
                if model.likelihood is None:
                    continue
                if best.total > model.total:
                    self._with_noise_of(best, model)
                gain = predictive_gain(best.likelihood, model.likelihood)
                dropped = " + ".join(sorted(set(best.key) - set(model.key)))
                if new := set(model.key) - set(best.key):
                    dropped += f" in place of {' + '.join(sorted(new))}"
                else:
                    self.predictive[dropped] = gain
                state.progress(
                    f"{dropped}: log predictive score of {gain.blocks} blocks left out {gain.gain:+.1f} "
                    f"± {gain.standard_error:.1f}"
                )
                why = self._why_dropped(best, model, gain)
                if why and (weakest is None or gain.gain < weakest[0]):
                    weakest = gain.gain, model, f"{dropped} is not taken: {why}"
            if weakest is None:
                return best
            state.progress(weakest[2])
            best.refuse(weakest[2], weakest[1])
            best = weakest[1]
        return best

    def _simplifications(self, best: TriedModel) -> list[Proposal]:
        """Return the models with a simpler law in the place of another, unless a parameter of the model is that law."""
        owned = {n for m in self.models.values() if m.proposals is not None for n in m.proposals.owned}
        return [p for p in moves.simplifications(best) if not owned & {str(e) for e in p.effects}]

    @staticmethod
    def _why_dropped(best: TriedModel, without: TriedModel, gain: PredictiveGain) -> str:
        """Return why an effect is dropped again; an empty text where it stays."""
        if not gain.exceeds(POLICY.predictive_errors):
            return "records left out are predicted no better with it"
        if not best.is_more_probable_than(without):
            return "the model without it is more probable"
        return moves.why_irrelevant(best, without)

    def _confirmed(self, best: TriedModel) -> TriedModel:
        """Drop effects that predict nothing of the records held out better, or some output worse, one after another.

        They may be there: where nothing is announced, the evidence for them stands in the probabilities.  They are not
        announced, because the model predicts nothing better with them.  Of several the one goes first that the evidence
        asks for least: of two that stand for each other, either is idle beside the other.  Where forces that nobody
        recorded make most of an output's error, its square hardly shows an effect; the log predictive score knows these
        forces.
        """
        state = self.state
        while best.key and best.likelihood is not None and state.problem.validate:
            self._move_to_likeliest(best)
            weakest: tuple[float, TriedModel, str] | None = None
            for model in self._fitted_once(best, moves.drops(best)):
                if model.likelihood is None:
                    continue
                gain = self._held_out_gain_of_errors(best.stage, model.stage)
                dropped = " + ".join(sorted(set(best.key) - set(model.key)))
                state.progress(f"{dropped}: share of the held-out mean square error that is gone: {gain}")
                helps = gain.helps(POLICY.relevance, 0.0) or moves.matters_to_prediction(best, model)
                if not helps:
                    score = held_out_gain(state.problem, best.likelihood, model.likelihood)
                    state.progress(
                        f"{dropped}: log predictive score of {score.blocks} blocks held out {score.gain:+.1f} "
                        f"± {score.standard_error:.1f}"
                    )
                    helps = score.exceeds(POLICY.predictive_errors)
                if helps and not gain.harms(POLICY.harm, POLICY.simulation_errors):
                    continue
                if weakest is None or model.total > weakest[0]:
                    weakest = model.total, model, dropped
            if weakest is None:
                return best
            best.unconfirmed = True
            best.refuse(f"{weakest[2]} is not announced: the records held out are not predicted better", weakest[1])
            state.progress(best.outcome)
            self.unconfirmed.append(weakest[2])
            best = weakest[1]
        return best

    def _held_out_gain_of_errors(self, one: Stage, other: Stage) -> SimulationGain:
        problem = self.state.problem
        return held_out_gain_of_errors(with_validation(problem, one), with_validation(problem, other))

    def _move_to_likeliest(self, model: TriedModel) -> None:
        """Move a model to the parameters of largest likelihood, unless it is clearly less probable there.

        Trials are fitted by least squares.  Beside a large random force these are far from the likeliest parameters:
        the strength of an effect is then mostly what the random force happened to be.  But the model without the effect
        was calibrated by least squares, and the records held out must not be predicted worse than by that.  The step is
        that of the linearised problem.  Where it is right the log evidence stays, but for what another linearisation
        makes of it, which is some nats where dry friction sticks.
        """
        likelihood, prior = model.likelihood, self.prior
        if likelihood is None or prior is None or model.at_likeliest:
            return
        try:
            stage = self.state.moved_to(likelihood.stage, likelihood.likeliest_values())
            there = likelihood.neighbour(stage)
            evidence = log_evidence(there, prior)
        except (RuntimeError, ModelError, np.linalg.LinAlgError) as error:
            self.state.progress(f"{model.name} stays at the parameters of least squares: {error}")
            return
        if evidence.total < model.total - POLICY.reach:
            return
        if self._held_out_gain_of_errors(there.stage, likelihood.stage).harms(POLICY.harm, POLICY.simulation_errors):
            self.state.progress(f"{model.name} stays at the parameters of least squares, which predict better")
            return
        self.state.progress(
            f"{model.name}: log evidence {evidence.total - model.total:+.1f} at the likeliest parameters"
        )
        model.likelihood, model.evidence, model.at_likeliest = there, evidence, True

    def _beside_unknown_law(self, best: TriedModel) -> TriedModel:
        """Return the most probable of a model and those with one effect less or none, each with an unknown law.

        A force without a name is a rival of every name.  Where it explains the records better than an effect does, and
        the effect adds nothing to it, the name is wrong, or is one of many that would do.
        """
        fewer = [self.models[key] for p in moves.drops(best) if (key := key_of(p.effects)) in self.models]
        rivals = list({m.key: m for m in (best, *fewer, *([self.start] if self.start else []))}.values())
        for model in rivals:
            self._ask_for_unknown_law(model)
        likeliest = max(rivals, key=lambda m: m.log_weight_with_law)
        if likeliest is best or likeliest.log_weight_with_law <= best.log_weight_with_law:
            return best
        law = likeliest.unknown_law
        assert law is not None
        best.better = False
        best.outcome = f"a law that is not in the catalogue explains the records better: {law.name}"
        self.state.progress(f"{best.name}: {best.outcome}")
        return likeliest

    def _ask_for_unknown_law(self, model: TriedModel) -> None:
        likelihood = model.likelihood
        if likelihood is None or model.unknown_law is not None:
            return
        self.state.progress(f"what follows the machine's state beside {model.name}")
        model.unknown_law = self.state.if_simulated(
            "whether something follows the machine's state by an unknown law", lambda: unknown_law(likelihood)
        )
        likelihood.free_memory()
        give_back()

    def _fitted_once(self, model: TriedModel, proposals: Sequence[Proposal]) -> list[TriedModel]:
        """Return the models of some proposals: those that were not tried yet are fitted, others from here as well."""
        tried = {key for key, m in self.models.items() if m.in_full}
        new = [(p, 1.0) for p in proposals if key_of(p.effects) not in tried]
        if new:
            self._fitted(model, new)
        fitted = {key_of(p.effects) for p, _ in new}
        for proposal in proposals:
            if key_of(proposal.effects) not in fitted:
                self._fit_from(model, self.models[key_of(proposal.effects)], proposal.effects)
        return [self.models[key_of(p.effects)] for p in proposals]

    def _fit_from(self, model: TriedModel, other: TriedModel, effects: tuple[Effect, ...]) -> bool:
        """Fit a model that was tried once more, beginning where another stands; tell whether that is better, and kept.

        A fit that ended in a local minimum would make the effect that the other model has beside it look indispensable.
        """
        if other.likelihood is None or model.likelihood is None:
            return False
        stage = self._best_fit(other, Proposal(move="drop", effects=effects), model)
        scale = model.stage.identify.scale
        if stage is None or not _misfit(stage, scale) < (1.0 - POLICY.relevance) * _misfit(other.stage, scale):
            return False
        likelihood = model.likelihood.neighbour(stage)
        assert self.prior is not None
        evidence = log_evidence(likelihood, self.prior)
        if evidence.total <= other.total:
            return False
        self.state.progress(f"{other.name}: log evidence {evidence.total - other.total:+.1f} from other start values")
        other.likelihood, other.evidence = likelihood, evidence
        return True

    def _make_stages(self, start: TriedModel, best: TriedModel) -> None:
        """Make the stages of the best model, one for each effect, in the order in which they raise the evidence."""
        state = self.state
        self._fit_further(start)
        self._keep_scans()
        if best.likelihood is None or best.key == start.key:
            return
        had = {str(e) for e in start.stage.effects}
        order = self._order([e for e in best.stage.effects if str(e) not in had], best)
        effects = tuple(e for e in best.stage.effects if str(e) in had)
        names = {str(e) for e in effects}
        for effect in order:
            names.add(str(effect))
            effects = tuple(e for e in best.stage.effects if str(e) in names)
            state.progress(f"add {effect}")
            tried = self.models.get(key_of(effects))
            from_trial = tried.stage if tried is not None and tried.likelihood is not None else best.stage
            before = state.stages[-1]
            name = f"+ {effect}"
            try:
                if tried is not None and tried.at_likeliest:
                    stage = state.moved_to(replace(from_trial, name=name), from_trial.identify.to_dict())
                else:
                    stage = state.fitted(name, from_trial.effects if tried else effects, from_trial, before.noise)
            except RuntimeError as error:
                state.progress(f"{effect} could not be fitted further, the fit on trial is kept: {error}")
                stage = with_validation(state.problem, from_trial)
            fitted = next(e for e in stage.effects if str(e) == str(effect))
            others = (*(e for e in stage.effects if e is not fitted), fitted)
            model = self.models.get(key_of(effects))
            parent = self.models.get(key_of(before.effects))
            known = model is not None and parent is not None
            gain = model.total - parent.total if known else math.nan  # type: ignore[union-attr]
            accepted = AcceptedEffect(
                effect=fitted,
                p_value=self._p_value(str(fitted)),
                delta_bic=-2.0 * gain,
                rivals=rivals_of(best, str(fitted), self.models, start.proposals, best.proposals),
            )
            state.stages.append(replace(stage, effects=others, accepted=accepted))
            self._keep_scans()
            state.save()

    def _fit_further(self, start: TriedModel) -> None:
        """Make the stage that the search began with again, where a better fit of it was found on trial."""
        before = self.state.stages[-1]
        if start.likelihood is None or start.at_likeliest or start.stage is before:
            return
        stage = self.state.fitted(before.name, before.effects, start.stage, before.noise)
        self.state.stages[-1] = replace(stage, accepted=before.accepted, notes=before.notes)
        self.state.save()

    def _keep_scans(self) -> None:
        """Give the latest stage the scores of its candidates, if its model was extended."""
        stages = self.state.stages
        model = self.models.get(key_of(stages[-1].effects))
        if model is not None and model.proposals is not None:
            stages[-1] = replace(stages[-1], scan=model.proposals.scan)

    def _order(self, effects: Sequence[Effect], best: TriedModel) -> list[Effect]:
        """Return effects in the order in which the search can have added them."""

        def alone(effect: Effect) -> float:
            model = self.models.get(key_of([effect]))
            return model.total if model is not None else -math.inf

        return sorted(effects, key=lambda e: -alone(e))

    def _p_value(self, name: str) -> float:
        """Return the smallest family-wise p-value with which a candidate was scored at any step."""
        found = [r.p_value for d in self.state.decisions for s in d.scans for r in s.rows if r.name == name]
        return min(found, default=1.0)


def _most_believed(promised: float) -> float:
    """Return the rise of the log evidence up to which it is that of the effect, given what the effect's score promises.

    Another linearisation alone changes the evidence: where dry friction sticks by hundreds of nats, beside a spring
    that bends and a large random force by tens.
    """
    return max(promised, 0.0) + max(POLICY.reach, POLICY.linear_error * promised)


def _misfit(stage: Stage, scale: Mapping[str, float]) -> float:
    """Return the sum over the outputs of the mean square error, each in its scale."""
    return sum((error / scale[name]) ** 2 for name, error in stage.rmse("identify").items())
