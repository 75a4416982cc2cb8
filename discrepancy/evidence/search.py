"""The search by evidence: models are extended from the best of those that were fitted, while the evidence rises."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from discrepancy.evidence import moves
from discrepancy.evidence.announcement import Announcement
from discrepancy.evidence.criterion import ModelPrior
from discrepancy.evidence.elastic_friction import with_elastic_friction
from discrepancy.evidence.laws_of_a_curve import CurveLaws, laws_of_curves
from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.evidence.moves import TriedModel, key_of
from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.proposals import Proposal, Proposals, entries_of, propose, proposed_effects
from discrepancy.evidence.stages_of_answer import make_stages
from discrepancy.evidence.trials import Trials, most_believed
from discrepancy.evidence.tried_models import TriedModels, judge
from discrepancy.search.decision import Decision
from discrepancy.statistics.thresholds import LEVEL_SHARES
from multibody.base.memory import give_back
from multibody.base.quantity_text import count_text

if TYPE_CHECKING:
    from discrepancy.effects.catalogue import Entry
    from discrepancy.effects.effect import Effect
    from discrepancy.search.state import SearchState
    from discrepancy.stages.stage import Stage

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
    tried : TriedModels
        Every model that was fitted.
    announcement : Announcement
        The tests that the effects of the best model had to pass.
    expansions : int
        How often a model was extended, one that was fitted again each time.
    """

    state: SearchState
    tried: TriedModels = field(init=False)
    announcement: Announcement = field(init=False)
    expansions: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self.tried = TriedModels(self.state)
        self._trials = Trials(self.tried)
        self.announcement = Announcement(self._trials)

    def run(self) -> None:
        """Extend the best models, keep of the best what predicts better, and make its stages."""
        state = self.state
        start = self.tried.known(state.stage)
        self._trials.calibrate_again(start)
        with_elastic_friction(self.tried, start)
        while (model := self._next()) is not None:
            asked = any(m.proposals is not None for m in self.tried.models.values())  # once, whatever the time limit
            if asked and state.out_of_time_for(f"what is missing beside {model.name}"):
                break
            if model.key and with_elastic_friction(self.tried, model):
                self._score_first_again(start)
            self._extend(model)
        best = self.announcement.of(self.tried.most_probable())
        self.tried.doubt()  # their probabilities are shown
        best.taken = True
        make_stages(self.tried, start, best)

    @property
    def likelihood(self) -> StageLikelihood | None:
        """Of the latest stage's model; None where the search was interrupted before that was tried."""
        model = self.tried.models.get(key_of(self.state.stages[-1].effects))
        return model.likelihood if model is not None else None

    def untested(self) -> str:
        """Return a sentence on the best model of a search that was interrupted; empty if there is none better."""
        ranked, start = self.tried.ranked(), self.tried.start
        if self.tried.taken is not None or start is None or not ranked or not ranked[0].key:
            return ""
        best, count = ranked[0], sum(m.likelihood is not None for m in self.tried.models.values()) - 1
        return (
            f"Of {count_text(count, 'model')} with effects fitted until then, the most probable is {best.name} (log "
            f"evidence {best.total - start.total:+.1f} over the model without); the test whether it predicts records "
            "that were left out better was not finished."
        )

    # ---------------------------------------------------------------- the beam

    def _next(self) -> TriedModel | None:
        """Return the model to extend next; None where the search ends.

        It is the best one.  Once that was extended in vain, it is another that is as good but for the error of the
        evidence: an effect that gains nothing beside the best hardly makes up for more.
        """
        while True:
            beam = self.tried.ranked()[: POLICY.beam]
            within = [m for m in beam if m.total >= beam[0].total - POLICY.reach]
            refined = [m for m in within if self.tried.refine(m)]  # each of them: it may change the order
            if not refined and not self.tried.share_noise_of_best(beam):
                break
        if self.expansions >= POLICY.expansions:
            return None
        as_good = [m for m in within if m.total >= beam[0].total - POLICY.improvement]
        return next((m for m in as_good if not (m.expanded or self._is_told_by_extended(m))), None)

    def _is_told_by_extended(self, model: TriedModel) -> bool:
        """Tell whether a model has what changes the same in place of an effect of one that was extended."""

        def same(other: TriedModel) -> bool:
            gone, new = set(other.key) - set(model.key), set(model.key) - set(other.key)
            if other.proposals is None or not len(gone) == len(new) == 1:
                return False
            return new <= other.proposals.alike.get(next(iter(gone)), frozenset())

        return any(same(other) for other in self.tried.models.values())

    def _score_first_again(self, start: TriedModel) -> None:
        """Score the candidates of the first model once more, because the machine is another.

        What may stand in the place of an effect follows from it; the effects that were found are not fitted again.
        """
        likelihood = start.likelihood
        assert likelihood is not None
        start.proposals = self.state.if_simulated("what else was missing", lambda: self._proposals(likelihood))
        likelihood.free_memory()
        give_back()

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
        if self.tried.prior is None:
            self.tried.prior = self._prior(stage, proposals)
            self.tried.refresh(model)
        room = problem.max_effects - len(stage.effects)
        p_values = {r.name: r.p_value for r in proposals.scan.rows}
        # first what gives a name to what has none: at the time limit the last are left out
        names = moves.names_of_curves(model, self._entries(stage), room)
        offers = [(replace(p, effects=self.tried.with_fitted_shapes(p.effects, model)), 1.0) for p in names]
        if room > 0:
            # friction that gives way moves as in the linearised problem, and no random force makes up for it
            told = bool(self.tried.elastic) and self.tried.settled
            bare = self.tried.wander <= POLICY.reach and not told
            additions = moves.additions(proposals, stage.effects, if_none_random=bare)
            offers += [(p, p_values.get(str(p.effects[-1]), 1.0)) for p in additions]
            curves = state.if_simulated("free curves", lambda: self._curves(likelihood))
            offers += curves or []
        if room > 1:
            offers += [(p, 1.0) for p in moves.pairs_in_place_of_random(proposals, stage.effects)]
            offers += [(p, 1.0) for p in moves.pairs(proposals, stage)]
        if len(stage.effects) > 1:
            offers += [(p, 1.0) for p in moves.exchanges(model, self._rival_effects(model))]
        offers += [(p, 1.0) for p in self._told_apart(model, proposals)]
        by_key: dict[tuple[str, ...], tuple[Proposal, float]] = {}
        for p, q in offers:  # two moves may lead to the same model
            by_key.setdefault(key_of(p.effects), (p, q))
        new = [offer for key, offer in by_key.items() if key not in self.tried.models]
        likelihood.free_memory()
        give_back()
        trials = self._trials.fitted(model, new, look=True)
        if self._fitted_again(model, [p.promised for p, _ in new], trials):
            return
        state.decisions.append(
            Decision(scans=(proposals.scan,), reason=self._reason(model, trials), refused=proposals.refused)
        )

    def _fitted_again(self, model: TriedModel, promised: Sequence[float], trials: Sequence[TriedModel]) -> bool:
        """Fit a model once more, beginning where one of its extensions stands; tell whether that is better, and kept.

        That is asked where the evidence rises far above what the score promised: any effect gains so much if the model
        is calibrated in the wrong place.  If that was most of it, the extensions, which began there, are forgotten.
        """
        beyond = [t for t, p in zip(trials, promised, strict=True) if t.total - model.total > most_believed(p)]
        if not beyond or self.state.out_of_time_for(f"whether {model.name} fits better from elsewhere"):
            return False
        best, before = max(beyond, key=lambda t: t.total), model.total
        if not self._trials.fit_from(best, model, model.stage.effects):
            return False
        if model.total - before <= POLICY.error_of_gain(best.total - before):
            for child in trials:
                if child.likelihood is not None:
                    judge(child, model, self.tried.wander)
            return False
        for child in trials:
            del self.tried.models[child.key]
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
            asked = [m for m in self.tried.models.values() if m.proposals is not None and str(effect) not in m.key]
            asked.sort(key=lambda m: len(set(m.key) ^ set(key_of(rest))))
            if not asked:
                continue
            source = asked[0].proposals
            assert source is not None
            own = source.named(str(effect))
            least = own.gain - POLICY.error_of_gain(own.gain) if own is not None else 0.0
            names = [c for c in source.candidates if c.gain > max(least, 0.0) and c is not own]
            rivals[str(effect)] = [proposed_effects(c, rest) for c in names[: POLICY.rivals]]
        return rivals

    def _told_apart(self, model: TriedModel, proposals: Proposals) -> list[Proposal]:
        """Return the models with what changed the same as an effect where it was lacking, and beside it no longer does.

        It was not fitted then, because a fit of the other told the same.
        """
        return [
            proposal
            for effect in model.stage.effects
            if (without := self.tried.models.get(tuple(n for n in model.key if n != key_of([effect])[0]))) is not None
            for proposal in moves.twins(model, without.proposals, proposals.alike)
        ]

    @staticmethod
    def _reason(model: TriedModel, trials: Sequence[TriedModel]) -> str:
        if not trials:
            return "no candidate promises a better model"
        best = max(trials, key=lambda m: m.total)
        return f"the best of {len(trials)} models is {best.name}, log evidence {best.total - model.total:+.1f}"
