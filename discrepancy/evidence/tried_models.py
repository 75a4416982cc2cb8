"""The models that a search has tried, the parameters at which they stand, and the noise that they share."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from discrepancy.evidence import moves
from discrepancy.evidence.criterion import Evidence, ModelPrior, log_evidence
from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.evidence.moves import TriedModel, key_of
from discrepancy.evidence.parameter_errors import ParameterErrors, parameter_errors
from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.standstill import places_that_stick
from discrepancy.stages.fit_stage import with_validation
from multibody.base.errors import ModelError
from multibody.base.memory import give_back

if TYPE_CHECKING:
    from discrepancy.effects.effect import Effect
    from discrepancy.search.state import SearchState
    from discrepancy.stages.stage import Stage

__all__ = ["TriedModels", "judge", "misfit"]


@dataclass(frozen=True, eq=False)
class Way:
    """A model on its way to its likeliest parameters: where it began, and after each step.

    Parameters
    ----------
    seen : tuple of (StageLikelihood, Evidence)
    settled : bool
        Whether it has come so near to the likeliest parameters that another linearisation changes nothing.
    """

    seen: tuple[tuple[StageLikelihood, Evidence], ...]
    settled: bool

    @property
    def changes(self) -> list[float]:
        """By how much each step changed the log evidence, nats."""
        return [abs(b[1].total - a[1].total) for a, b in pairwise(self.seen)]

    @property
    def wander(self) -> float:
        """Nats by which another linearisation changes the evidence, beyond what a step to likelier parameters gains."""
        return 0.0 if self.settled else max(_not_foreseen(self.seen), default=0.0)

    @property
    def end(self) -> tuple[StageLikelihood, Evidence]:
        """Where the evidence has settled; where it has not, the most probable place."""
        return self.seen[-1] if self.settled else max(self.seen, key=lambda place: place[1].total)


@dataclass(eq=False)
class TriedModels:
    """Every model that a search has tried.

    Parameters
    ----------
    state : SearchState
        Of the search.

    Attributes
    ----------
    models : dict of tuple to TriedModel
        By the sorted names of their effects.
    prior : ModelPrior or None
        What is known of models before the records are seen, once a model was extended.
    wander : float
        Nats by which the evidence of the first model changes with where it is linearised.
    moved : bool
        Whether models are moved to their likeliest parameters; not where least squares is as good a place as any.
    elastic : set of str
        Parameters of dry frictions that give way, which were put in the place of those that fade.
    """

    state: SearchState
    models: dict[tuple[str, ...], TriedModel] = field(default_factory=dict, init=False)
    prior: ModelPrior | None = field(default=None, init=False)
    wander: float = field(default=0.0, init=False)
    moved: bool = field(default=False, init=False)
    elastic: set[str] = field(default_factory=set, init=False)
    _asked: set[tuple[tuple[str, ...], tuple[str, ...]]] = field(default_factory=set, init=False)
    _errors: WeakKeyDictionary[StageLikelihood, ParameterErrors] = field(default_factory=WeakKeyDictionary, init=False)

    @property
    def settled(self) -> bool:
        """Whether models are moved to their likeliest parameters, and their evidence settles there."""
        return self.moved and self.wander == 0.0

    @property
    def stated(self) -> dict[str, float]:
        """Uncertain parameters of the study, at the values that it states."""
        return {p.name: p.value for p in self.state.problem.uncertain if p.name not in self.elastic}

    @property
    def start(self) -> TriedModel | None:
        """The model without effects, if it was tried."""
        return self.models.get(())

    @property
    def taken(self) -> TriedModel | None:
        """The model that is the answer; None before there is one."""
        return next((m for m in self.models.values() if m.taken), None)

    def ranked(self) -> list[TriedModel]:
        """Return the models that may be extended or taken, best first."""
        return sorted((m for m in self.models.values() if m.better), key=lambda m: -m.total)

    def most_probable(self) -> TriedModel:
        """Return the model that may be taken of which most evidence remains where it is overstated."""
        self.doubt()
        return max(self.ranked(), key=lambda m: m.total - m.overstated)

    def known(self, stage: Stage) -> TriedModel:
        """Return the model of a stage among those that were tried; it joins them if it is new."""
        key = key_of(stage.effects)
        if key not in self.models:
            self.state.progress("what is random: sensor noise and latent forces")
            likelihood = StageLikelihood(stage=stage)
            model = TriedModel(likelihood=likelihood, key=key, evidence=None, outcome="start", better=True)
            self.models[key] = model
            self.refresh(model)
            self._settle(model)
            self._linearise_along_motion(model, likelihood)
        return self.models[key]

    def _linearise_along_motion(self, model: TriedModel, likelihood: StageLikelihood) -> None:
        """Linearise along the likeliest motion from here on, where the evidence depends on the linearisation else.

        It does if another changes it by more than two evidences of one model may differ.  The likeliest motion is taken
        if the linearised machine holds along it, and the evidence depends on it no more.

        Parameters
        ----------
        model : TriedModel
            The first one.
        likelihood : StageLikelihood
            Of it as it was calibrated, along a simulation.
        """
        if self.wander <= POLICY.reach:
            return
        there = likelihood.linearised_along_motion()
        if there.linearisation_error > POLICY.improvement:
            return
        before = model.likelihood, model.evidence, model.at_likeliest
        along = self.wander, self.moved
        model.likelihood, model.at_likeliest = there, False
        self.wander, self.moved = 0.0, False
        self.refresh(model)
        self._settle(model)
        if self.wander <= along[0]:
            self.state.progress("linearised along the likeliest motion under the forces that nobody recorded")
            return
        (model.likelihood, model.evidence, model.at_likeliest), (self.wander, self.moved) = before, along

    def refresh(self, model: TriedModel) -> None:
        """Compute the evidence of a model again: its noise or the prior has changed."""
        assert model.likelihood is not None
        model.evidence = self.evidence_of(model.likelihood)

    def evidence_of(self, likelihood: StageLikelihood) -> Evidence:
        """Return the evidence of a model."""
        return log_evidence(likelihood, self.prior or ModelPrior(candidates=1, shapes={}, stated={}))

    def best_within(self, key: tuple[str, ...]) -> TriedModel | None:
        """Return the best model that has only some of these effects; None where none was tried."""
        within = [m for m in self.models.values() if m.likelihood is not None and set(m.key) < set(key)]
        return max(within, key=lambda m: m.total, default=None)

    def with_fitted_shapes(self, effects: Sequence[Effect], model: TriedModel) -> tuple[Effect, ...]:
        """Return effects, those that a model lacks with their shapes in the best model that was fitted with each.

        How dry friction fades is hardly seen in a force over the speed, and decides how the machine reverses.
        """
        fitted = [m for m in self.models.values() if m.likelihood is not None and m.in_full]
        best = {_law_of(e): e for m in sorted(fitted, key=lambda m: m.total) for e in m.stage.effects}
        own = {_law_of(e) for e in model.stage.effects}
        known = [e if _law_of(e) in own else best.get(_law_of(e), e) for e in effects]
        return tuple(replace(e, shape=k.shape, proposed=k.proposed) for e, k in zip(effects, known, strict=True))

    def keep_only(self, *models: TriedModel) -> None:
        """Forget all other models."""
        self.models = {m.key: m for m in models}
        self._asked.clear()

    def total_of(self, effects: Sequence[Effect]) -> float:
        """Return the log evidence of the model with some effects.

        Of one that was not tried or could not be fitted it is that of the best with some of them: the strengths of the
        others could be zero.
        """
        key = key_of(effects)
        model = self.models.get(key)
        if model is None or not math.isfinite(model.total):
            model = self.best_within(key)
        return model.total if model is not None else -math.inf

    def doubt(self) -> None:
        """Note by how many nats the evidence of each model is overstated.

        What effects gain over the best model with fewer of them holds only as far as their standard errors are as
        small as the likelihood promises.  Rivals, models with as many effects, are compared by their whole evidence:
        the share that holds is computed for the best of them and applies to all.
        """
        fitted, start = [m for m in self.models.values() if m.likelihood is not None], self.start
        if start is None or start.likelihood is None:
            return
        first = start.of_records
        for count in sorted({len(m.key) for m in fitted}):
            rivals = [m for m in fitted if len(m.key) == count]
            best = max(rivals, key=lambda m: m.total)
            simpler, gained = self.best_within(best.key), best.of_records - first
            doubted = 0.0
            if simpler is not None:
                further = best.of_records - simpler.of_records
                doubted = simpler.overstated + (1.0 - self._share_that_holds(best, simpler.key)) * max(further, 0.0)
            for model in rivals:
                own = max(model.of_records - first, 0.0)
                model.overstated = doubted * own / gained if gained > 0.0 else 0.0

    def _share_that_holds(self, model: TriedModel, simpler: tuple[str, ...]) -> float:
        """Return what share of its gain over a simpler model holds."""
        if model.total <= self.models[simpler].total or (errors := self.errors_of(model)) is None:
            return 1.0
        new = [e for e in model.stage.effects if not set(key_of([e])) <= set(simpler)]
        return errors.share_that_holds(self._strengths_of(new))

    def errors_of(self, model: TriedModel) -> ParameterErrors | None:
        """Return how sure the parameters of a model are; None where that cannot be computed."""
        assert model.likelihood is not None
        if model.likelihood not in self._errors:
            try:
                self._errors[model.likelihood] = parameter_errors(model.likelihood)
            except (RuntimeError, ModelError, np.linalg.LinAlgError) as error:
                self.state.progress(f"{model.name}: its standard errors cannot be computed: {error}")
                return None
        return self._errors[model.likelihood]

    def _strengths_of(self, effects: Sequence[Effect]) -> dict[str, float]:
        """Return the strengths of effects; of parameters of the machine, how far they are from what is stated."""
        stated = self.prior.stated if self.prior is not None else {}
        return {
            name: value - (stated.get(name, 0.0) if e.definition.stated else 0.0)
            for e in effects
            for name, value in ((e.parameter_name(k), v) for k, v in e.strengths.items())
        }

    # ---------------------------------------------------------------- parameters

    def _settle(self, model: TriedModel) -> None:
        """Move the first model to its likeliest parameters, and measure how much another linearisation changes there.

        The evidence of a model is that about its likeliest parameters, and least squares puts it elsewhere: to it what
        a random force does is an error like any other, and what the linearised problem says from there is an
        extrapolation.  A linear problem has the same evidence everywhere, and nearly linear ones have; those stay.
        Where dry friction sticks the evidence may differ by hundreds of nats, from step to step as well, and the
        parameters as stated may be the better place to begin.
        """
        assert model.likelihood is not None
        assert model.evidence is not None
        if not model.likelihood.noise.model.processes or not places_that_stick(model.likelihood.linearised):
            return
        ways = [self.whole_way(model.likelihood, model.evidence)]
        if max(ways[0].changes, default=0.0) <= POLICY.improvement:
            return
        try:
            stage = self.at_stated_values(model.stage)
            there = model.likelihood.neighbour(stage)
            ways.append(self.whole_way(there, self.evidence_of(there)))
        except (RuntimeError, ModelError, np.linalg.LinAlgError):
            pass
        best = max(ways, key=lambda way: way.end[1].total)
        self.wander, self.moved = best.wander, True
        model.at_likeliest = best.end[0] is not model.likelihood
        model.likelihood, model.evidence = best.end
        self.state.progress(
            f"{model.name}: the likeliest parameters change the log evidence by {ways[0].changes[0]:.1f}, and another "
            f"linearisation there by {self.wander:.1f}"
            + (", from the parameters as stated" if best is not ways[0] else "")
        )

    def at_stated_values(self, stage: Stage) -> Stage:
        """Return a fitted stage with the uncertain parameters of the study as it states them."""
        return self.state.moved_to(stage, stage.identify.to_dict() | self.stated, trial=True)

    def at_likelier_parameters(
        self, likelihood: StageLikelihood, evidence: Evidence
    ) -> tuple[StageLikelihood, Evidence] | None:
        """Return a model at its likeliest parameters, if models are moved there.

        Where the evidence does not settle the model is returned where it is most probable, if clearly more so.  With
        effects it is then judged as it stands there: a rise of the likelihood that the linearised problem promises at
        other parameters, and that no step has brought, is none.  The model without effects has the benefit of that
        doubt.
        """
        return self._likelier(likelihood, evidence) if self.moved else None

    def _likelier(self, likelihood: StageLikelihood, evidence: Evidence) -> tuple[StageLikelihood, Evidence] | None:
        way = self.way_to_likeliest(likelihood, evidence)
        if self.wander and likelihood.stage.effects and not way.settled:
            standing = [replace(place, as_it_stands=True, given_noise=place.noise) for place, _ in way.seen]
            return max(((place, self.evidence_of(place)) for place in standing), key=lambda seen: seen[1].total)
        return way.end if way.settled or way.end[1].total > evidence.total + POLICY.improvement else None

    def move_to_likeliest(self, model: TriedModel) -> None:
        """Move a model from where least squares put it to its likeliest parameters, if it is not there.

        Where the fits of all models do so by themselves, it stays.
        """
        likelihood, evidence = model.likelihood, model.evidence
        if self.moved or model.at_likeliest or likelihood is None or evidence is None:
            return
        if not likelihood.noise.model.processes or likelihood.rise_to_likeliest <= POLICY.improvement:
            return
        there = self._likelier(likelihood, evidence)
        if there is None:
            return
        self.state.progress(f"{model.name}: log evidence {there[1].total - evidence.total:+.1f} at likelier parameters")
        model.by_least_squares = model.stage
        (model.likelihood, model.evidence), model.at_likeliest = there, True
        there[0].free_memory()

    def way_to_likeliest(self, likelihood: StageLikelihood, evidence: Evidence) -> Way:
        """Move a model step by step to its likeliest parameters, until it has come near enough.

        That is where a further step raises the linearised likelihood by no more than the evidence may be off: within
        two and a half standard deviations the linearisation holds.  A model that is not near and has become less
        probable wanders, and is moved no further.
        """
        seen = [(likelihood, evidence)]
        steps = self._steps_to_likeliest(likelihood)
        while seen[-1][0].rise_to_likeliest > POLICY.improvement:
            falls = len(seen) > 1 and seen[-1][1].total <= seen[-2][1].total + POLICY.improvement
            if falls or (there := next(steps, None)) is None:
                return Way(tuple(seen), settled=False)
            seen.append(there)
        return Way(tuple(seen), settled=True)

    def whole_way(self, likelihood: StageLikelihood, evidence: Evidence) -> Way:
        """Move a model in the same way to the end, to see whether it settles at all.

        It does if its evidence ends where another step does not change it, and none after the first, which leads away
        from least squares, changed it in a way that was not foreseen.
        """
        seen = [(likelihood, evidence)]
        for there in self._steps_to_likeliest(likelihood):
            seen.append(there)
            if abs(there[1].total - seen[-2][1].total) <= POLICY.improvement:
                return Way(tuple(seen), settled=max(_not_foreseen(seen), default=0.0) <= POLICY.improvement)
        return Way(tuple(seen), settled=False)

    def _steps_to_likeliest(self, likelihood: StageLikelihood) -> Iterator[tuple[StageLikelihood, Evidence]]:
        """Move a model to its likeliest parameters, some times, and linearise it there each time."""
        for _ in range(POLICY.likeliest_steps):
            try:
                stage = self.state.moved_to(likelihood.stage, likelihood.likeliest_values(), trial=True)
                likelihood = likelihood.neighbour(stage)
                evidence = self.evidence_of(likelihood)
            except (RuntimeError, ModelError, np.linalg.LinAlgError):
                return
            yield likelihood, evidence

    def as_reported(self, model: TriedModel) -> Stage:
        """Return the stage of a model as the answer shows it: fitted in full, and evaluated on the records held out.

        At its likeliest parameters a model stays as it is, but the one that the search began with is shown as it was
        calibrated, unless a better fit of it by least squares was found.
        """
        trial, first = model.stage, self.state.stages[-1]
        if model.at_likeliest and key_of(first.effects) == model.key:
            return first
        return trial if trial.machine is not None else trial.once("as reported", lambda: self._in_full(model))

    def _in_full(self, model: TriedModel) -> Stage:
        trial = model.stage
        try:
            if model.at_likeliest:
                return self.state.moved_to(trial, trial.identify.to_dict())
            return self.state.fitted(trial.name, trial.effects, trial, trial.noise)
        except RuntimeError as error:
            self.state.progress(f"{model.name} could not be fitted further, the fit on trial is kept: {error}")
            return with_validation(self.state.problem, trial)

    # ---------------------------------------------------------------- noise

    def refine(self, model: TriedModel) -> bool:
        """Let the noise of a model have further latent processes; tell whether that was not done before."""
        if model.likelihood is None or model.likelihood.grow:
            return False
        self.state.progress(f"what is random beside {model.name}")
        model.likelihood = model.likelihood.with_richer_noise()
        self.refresh(model)
        assert model.evidence is not None
        if (there := self.at_likelier_parameters(model.likelihood, model.evidence)) is not None:
            model.likelihood, model.at_likeliest = there[0].with_richer_noise(), True
            self.refresh(model)
        if model.parent is not None:
            parent = self.models[model.parent]
            children = [m for m in self.models.values() if m.parent == parent.key and m.likelihood is not None]
            if self.share_noise([model], parent, children):
                for child in children:
                    if child.matters:
                        judge(child, parent, self.wander)
        model.likelihood.free_memory()
        give_back()
        return True

    def share_noise(self, sources: Sequence[TriedModel], parent: TriedModel, children: Sequence[TriedModel]) -> bool:
        """Fit the noise of a model once more from that of better ones, and if that is likelier, that of its children.

        The likelihood of a noise model has several maxima.  One that was found beside an effect, and would do as well
        without it, must not count for the effect; nor must one that was found later count against those before it.
        """
        better = [m for m in sources if m.total > parent.total and self.with_noise_of(m, parent)]
        if better:
            for child in children:
                self.with_noise_of(parent, child)
        return bool(better)

    def share_noise_of_best(self, beam: Sequence[TriedModel]) -> bool:
        """Fit the noise of rivals once more, from that of the best of them; tell whether that is likelier for any.

        The best may be ahead for the random forces that were found beside it, which do as well beside another.
        """
        asked = [(beam[0].key, m.key) for m in beam[1:]]
        new = [m for m, pair in zip(beam[1:], asked, strict=True) if pair not in self._asked]
        self._asked.update(asked)
        return bool([m for m in new if self.with_noise_of(beam[0], m)])

    def share_noise_of_simpler(self, model: TriedModel) -> None:
        """Fit the noise of a model once more, from that of the best with fewer of its effects, if it lies far below.

        Its effects may all be nearly zero, so it is as likely as that but for the price of their names.  One that is
        made by an exchange or by dropping an effect begins with the random forces found beside what it no longer has,
        and may lack one that stands for that.
        """
        best = self.best_within(model.key)
        if best is not None and best.total > model.total + POLICY.reach:
            self.with_noise_of(best, model)

    def with_noise_of(self, source: TriedModel, model: TriedModel) -> bool:
        """Fit the noise of a model once more, from that of another; tell whether it is likelier.

        Where the other is better by more than an effect costs, it may be so for the motion along which it is
        linearised.
        """
        if source.likelihood is None or model.likelihood is None:
            return False
        better = source.likelihood.along_motion and source.total > model.total + POLICY.reach
        forces = source.likelihood.forces if better else ()
        likelier = model.likelihood.with_likelier_noise(source.likelihood.noise.model, forces)
        if likelier is None:
            return False
        before, model.likelihood = model.total, likelier
        self.refresh(model)
        self.state.progress(
            f"{model.name}: log evidence {model.total - before:+.1f} with the random forces found beside {source.name}"
        )
        return True


def _law_of(effect: Effect) -> tuple[str, ...]:
    """Return what distinguishes an effect's law: its name and its strengths, because a kind may have two laws."""
    return (str(effect), *effect.strengths)


def _not_foreseen(seen: Sequence[tuple[StageLikelihood, Evidence]]) -> list[float]:
    """Return by how much each step after the first changed the evidence in a way that the linearisation did not say.

    It says how much the likelihood rises to the likeliest parameters.  A step from afar that gains a part of it, and
    ends nearer, is a step on the way.
    """
    changes = [(b[1].total - a[1].total, a[0].rise_to_likeliest) for a, b in pairwise(seen)]
    return [0.0 if 0.0 <= change <= rise else abs(change) for change, rise in changes[1:]]


def judge(model: TriedModel, parent: TriedModel, wander: float) -> None:
    """Note whether a model is better than the one that it was made of.

    Parameters
    ----------
    model, parent : TriedModel
    wander : float
        Nats by which evidence changes with the linearisation: an effect must raise it by more, unless its score, for
        which both models are linearised alike, promises enough.
    """
    if not model.in_full:
        model.better, model.outcome = False, "not fitted: far below the best model where the fit would begin"
        return
    gain = model.total - parent.total
    # laws in the place of a curve are the same force, with fewer parameters
    more = len(model.stage.effects) > len(parent.stage.effects) and model.move != "name a curve"
    if gain <= (POLICY.improvement if more else 0.0):
        model.better, model.outcome = False, "not better"
    elif more and gain <= wander and not model.promises_enough:
        model.better, model.outcome = False, f"better by less than another linearisation changes ({wander:.1f} nats)"
    elif more and (why := moves.why_irrelevant(model, parent, wander)):
        model.refuse(f"better, but {why}")
    else:
        model.better, model.outcome = True, "better"


def misfit(stage: Stage, scale: Mapping[str, float]) -> float:
    """Return the sum over the outputs of the mean square error, each in its scale."""
    return sum((error / scale[name]) ** 2 for name, error in stage.rmse("identify").items())
