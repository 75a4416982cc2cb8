"""The models that a search tried, and the moves from one to the next: add, pair, exchange, drop, a curve, its names."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.effects.effect import Effect
from discrepancy.effects.from_scan_row import contained, effect_of
from discrepancy.effects.kinds import kind_named
from discrepancy.evidence.criterion import Evidence
from discrepancy.evidence.laws_of_a_curve import laws_of_curves
from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.predictive import changed_share, shift_over_noise, simulation_gain
from discrepancy.evidence.proposals import Proposal, Proposals, ScoredCandidate, proposed_effects
from discrepancy.evidence.unknown_law import UnknownLaw
from discrepancy.sensitivities.free_curve_scan import scan_free_curves
from discrepancy.stages.stage import Stage
from discrepancy.statistics.masking_pairs import Pair, PairScores

if TYPE_CHECKING:
    from discrepancy.effects.catalogue import Entry
    from discrepancy.statistics.scan_result import ScanRow

__all__ = [
    "TriedModel",
    "additions",
    "curve",
    "drops",
    "exchanges",
    "key_of",
    "names_of_curves",
    "pairs",
    "pairs_in_place_of_random",
    "simplifications",
    "twins",
    "why_irrelevant",
]


def key_of(effects: Sequence[Effect]) -> tuple[str, ...]:
    """Return what distinguishes a model from others: the sorted names of its effects."""
    return tuple(
        sorted(f"{e}{f' over {e.over}' if e.over else ''}{f' #{e.number}' if e.number > 1 else ''}" for e in effects)
    )


@dataclass(eq=False, kw_only=True)
class TriedModel:
    """A model that a search fitted.

    Parameters
    ----------
    likelihood : StageLikelihood or None
        Of the fit on trial; None where the model could not be built or simulated.
    key : tuple of str
        ``kind@where`` of its effects, sorted.
    evidence : Evidence or None
    move : str
        By which it was reached: ``"start"``, ``"add"``, ``"add a pair"``, ``"add a curve"``, ``"exchange"``,
        ``"name a curve"``, ``"simplify"`` or ``"drop"``.
    parent : tuple of str or None
        The model that it was made of.
    p_value : float
        Family-wise probability that chance gives a candidate the score of the new effect.
    promised : float
        By how much the score of its new effect says that the log evidence rises; minus infinity where none says so.
    outcome : str
        Why it was taken or not.
    proposals : Proposals or None
        What it may be extended by, once that has been asked.
    expanded : bool
        Whether that was asked.
    better : bool
        Whether the evidence is for it, against the model that it was made of, and the difference matters.
    matters : bool
        False where records are not predicted better with it, whatever the evidence.
    taken : bool
        Whether it is the search's answer.
    unconfirmed : bool
        Whether the evidence is for it, and the records held out are predicted no better with it.
    overstated : float
        Nats of its evidence that do not hold, because its standard errors are larger than its likelihood promises;
        once `discrepancy.evidence.tried_models.TriedModels.doubt` has asked.
    unknown_law : UnknownLaw or None
        What follows the machine's state beside it, once that has been asked.
    at_likeliest : bool
        Whether its parameters are those of largest likelihood and no longer of least squares.
    by_least_squares : Stage or None
        The fit of a model that was moved there because others could not be told from it.
    in_full : bool
        Whether it was fitted; else it stands where the fit would have begun, too improbable for any fit to matter, or
        has no likelihood, because the time limit came first.
    counts_for : tuple of str or None
        Model whose probability its own is part of, where it does not matter; None: the one that it was made of.
    as_good : bool
        Whether the evidence holds it for as good as the simpler law that was taken in its place: it is another answer.
    """

    likelihood: StageLikelihood | None
    key: tuple[str, ...]
    evidence: Evidence | None
    move: str = "start"
    parent: tuple[str, ...] | None = None
    p_value: float = 1.0
    promised: float = -math.inf
    outcome: str = ""
    proposals: Proposals | None = None
    expanded: bool = False
    better: bool = False
    matters: bool = True
    taken: bool = False
    unconfirmed: bool = False
    overstated: float = 0.0
    unknown_law: UnknownLaw | None = None
    at_likeliest: bool = False
    by_least_squares: Stage | None = None
    in_full: bool = True
    counts_for: tuple[str, ...] | None = None
    as_good: bool = False

    def refuse(self, why: str, instead: TriedModel | None = None) -> None:
        """Note that the model is not taken although the evidence is for it: the difference does not matter.

        Its probability is that of the model that stays instead; by default of the one that it was made of.  Where that
        has another law in the place of one of this, and the evidence tells neither from the other, it keeps its own.
        """
        self.outcome, self.better, self.matters = why, False, False
        if instead is not None:
            self.counts_for = instead.key
            another_law = bool(set(instead.key) - set(self.key))
            self.as_good = another_law and abs(self.total - instead.total) <= POLICY.improvement

    @property
    def stage(self) -> Stage:
        """The fitted stage; only where there is one."""
        assert self.likelihood is not None
        return self.likelihood.stage

    @property
    def name(self) -> str:
        """``kind@where`` of its effects joined by ``" + "``; ``"nothing"`` without any."""
        return " + ".join(self.key) or "nothing"

    @property
    def total(self) -> float:
        """Log evidence; minus infinity where there is none."""
        return self.evidence.total if self.evidence is not None else -math.inf

    @property
    def log_odds(self) -> float:
        """Log prior probability of the model; zero where it has no evidence."""
        return self.evidence.log_odds if self.evidence is not None else 0.0

    @property
    def of_records(self) -> float:
        """Log evidence without the prior probability of the model."""
        return self.total - self.log_odds

    def is_more_probable_than(self, other: TriedModel) -> bool:
        """Tell whether the model is more probable than another, in the probabilities that are shown."""
        return self._log_weight() > other._log_weight()

    @property
    def promises_enough(self) -> bool:
        """Whether its score pays for the effect by itself, so that its gain is not that of another linearisation.

        For a score the models with and without the effect are linearised alike.
        """
        return self.promised > POLICY.reach

    @property
    def log_weight_with_law(self) -> float:
        """Log weight among the shown probabilities, with what follows the machine's state if that is announced."""
        law = self.unknown_law
        told = law is not None and law.announced
        return self._log_weight(law.gain, law.log_odds) if law is not None and told else self._log_weight()

    def log_weight_with_law_in_place(self, other: TriedModel) -> float:
        """Return the same, where that stands in the place of an effect of another model, which was fitted."""
        law = self.unknown_law
        return (
            self._log_weight(self.gain_of_law(other), law.log_odds) if law is not None and law.announced else -math.inf
        )

    def gain_of_law(self, other: TriedModel) -> float:
        """Return by how much an unknown law raises the evidence where it stands in the place of an effect of another.

        The effect was fitted and what has no name was not, so it must be better by more than two linearisations may
        differ.  Of its gain no more holds than of that of the effect: rivals are compared by their whole evidence.
        Where the other model has the same law beside its effect, the two differ by that effect alone.  If too little of
        it is left there to be announced, what that gains does not speak against the effect either.
        """
        law, beside = self.unknown_law, other.unknown_law
        assert law is not None
        gain = law.gain
        if beside is not None and beside.places == law.places:
            if beside.announced:
                return gain
            gain -= max(beside.gain, 0.0)
        rise = other.total - self.total
        doubted = max(other.overstated - self.overstated, 0.0) / rise if rise > 0.0 else 0.0
        return gain - POLICY.reach - doubted * max(gain, 0.0)

    def _log_weight(self, gain: float = 0.0, log_odds: float = 0.0) -> float:
        """Return the log weight with something more that gains so much, its log prior odds included."""
        odds = self.log_odds + log_odds
        return (self.total - self.overstated + gain - odds) / POLICY.temperature + odds

    def to_dict(self) -> dict[str, object]:
        """Return it as it stands in decisions.json."""
        evidence, law = self.evidence, self.unknown_law
        return {
            "effects": list(self.key),
            "move": self.move,
            "from": list(self.parent) if self.parent is not None else None,
            "log_evidence": None
            if evidence is None
            else {
                "total": evidence.total,
                "log_likelihood": evidence.log_likelihood,
                "log_prior_density": evidence.log_prior,
                "log_prior_odds": evidence.log_odds,
                "log_noise": evidence.log_noise,
                "overstated": self.overstated,
            },
            "p_value": self.p_value,
            "taken": self.taken,
            "outcome": self.outcome,
            **({"unknown_law": law.to_dict()} if law is not None else {}),
        }


# -------------------------------------------------------------------- moves


def additions(proposals: Proposals, effects: Sequence[Effect], *, if_none_random: bool = False) -> list[Proposal]:
    """Return the models with one effect more that are worth a full fit.

    With ``if_none_random`` so are those that do best if no force is random, where dry friction holds the machine.
    """
    instead = [_in_place_of_random(c, effects) for (c, *others) in proposals.instead if not others]
    names = {str(p.effects[-1]) for p in instead}
    ahead = [c for c in proposals.ahead() if c.name not in names]
    names |= {c.name for c in ahead}
    bare = [c for c in proposals.if_none_random if if_none_random and c.name not in names]
    return [*instead, *(proposed_effects(c, effects) for c in (*ahead, *bare))]


def pairs_in_place_of_random(proposals: Proposals, effects: Sequence[Effect]) -> list[Proposal]:
    """Return the models with two effects more that together do what the latent processes of the noise do."""
    found = [each for each in proposals.instead if len(each) > 1]
    return [
        replace(_in_place_of_random(b, _in_place_of_random(a, effects).effects), move="add a pair") for a, b in found
    ]


def _in_place_of_random(candidate: ScoredCandidate, effects: Sequence[Effect]) -> Proposal:
    return replace(proposed_effects(candidate, effects), noise=None, new_noise=True)


def pairs(proposals: Proposals, stage: Stage) -> list[Proposal]:
    """Return the models with two effects more, where the two together promise clearly more than either alone.

    What a parameter of the model does as well is no candidate, and stands in no pair.
    """
    entries = {c.name: c.entry for c in proposals.candidates}

    def excluded(a: ScanRow, b: ScanRow) -> bool:
        return contained(a, b) or not {a.name, b.name} <= set(entries)

    scores = PairScores(proposals.scan, excluded)
    alone = max((c.gain for c in proposals.candidates), default=0.0)
    # the gain of a single effect has paid for its strength and shape, but not for its name
    cost = 2.0 * POLICY.effect_cost + math.log(max(len(proposals.candidates), 1))
    chosen: list[Proposal] = []
    kept: list[Pair] = []
    for pair in scores.masking():
        if len(chosen) == POLICY.pairs:
            break
        if 0.5 * pair.gain - cost < alone + POLICY.pair_advantage:
            break
        if any(scores.twins(pair, other) for other in kept):
            continue
        kept.append(pair)
        first = effect_of(entries[pair.rows[0].name], pair.rows[0], stage.effects)
        second = effect_of(entries[pair.rows[1].name], pair.rows[1], (*stage.effects, first))
        chosen.append(Proposal(move="add a pair", effects=(*stage.effects, first, second)))
    return chosen


def exchanges(model: TriedModel, rivals: Mapping[str, Sequence[Proposal]]) -> list[Proposal]:
    """Return the models with one effect replaced by another explanation of it.

    Parameters
    ----------
    model : TriedModel
    rivals : mapping of str to sequence of Proposal
        For each effect, by name, what else may stand in its place.
    """
    effects = model.stage.effects
    out = []
    for k, effect in enumerate(effects):
        for proposal in list(rivals.get(str(effect), ()))[: POLICY.rivals]:
            new = proposal.effects[-1]
            if any(str(new) == str(e) for e in effects):
                continue
            out.append(Proposal(move="exchange", effects=(*effects[:k], *effects[k + 1 :], new)))
    return out


def twins(
    model: TriedModel, source: Proposals | None, but: Mapping[str, Collection[str]] = MappingProxyType({})
) -> list[Proposal]:
    """Return the models with one effect replaced by a candidate that changes the same where the model lacks it.

    Parameters
    ----------
    model : TriedModel
    source : Proposals or None
        Of the model without the effect, or of a simpler one.
    but : mapping of str to collection of str
        Candidates that are left out, for each effect.
    """
    if model.likelihood is None or source is None:
        return []
    alike = {str(e): source.twins(str(e)) for e in model.stage.effects}
    return exchanges(
        model,
        {
            name: [proposed_effects(c, ()) for c in same if c.name not in but.get(name, ())]
            for name, same in alike.items()
        },
    )


def names_of_curves(model: TriedModel, entries: Sequence[Entry], room: int) -> list[Proposal]:
    """Return the models with laws of the catalogue in the place of a free curve.

    Parameters
    ----------
    model : TriedModel
    entries : sequence of Entry
        The catalogue.
    room : int
        Effects that a model may have more.
    """
    assert model.likelihood is not None
    return [
        Proposal(move="name a curve", effects=(*rest, *named.effects))
        for _, rest, laws in laws_of_curves(model.likelihood.linearised, model.stage.effects, entries)
        for named in laws
        if len(named.effects) <= room + 1
    ]


def drops(model: TriedModel) -> list[Proposal]:
    """Return the models with one effect less."""
    effects = model.stage.effects
    return [Proposal(move="drop", effects=tuple(e for e in effects if e is not gone)) for gone in effects]


def simplifications(model: TriedModel) -> list[Proposal]:
    """Return the models with a simpler law in the place of one that contains it."""
    effects = model.stage.effects
    out = []
    for k, effect in enumerate(effects):
        for kind in effect.definition.contains:
            simpler = _simpler(effect, kind)
            if simpler is not None and str(simpler) not in map(str, effects):
                out.append(Proposal(move="simplify", effects=(*effects[:k], *effects[k + 1 :], simpler)))
    return out


def _simpler(effect: Effect, kind: str) -> Effect | None:
    """Return a law of another kind in the place of one that contains it, as strong as that is in the mean."""
    names = kind_named(kind).strengths
    if kind_named(kind).at != effect.definition.at or not effect.ports:
        return None
    usual = Effect(kind=kind, where=effect.where, domain=effect.domain).usual_shape()
    mean = sum(map(abs, effect.strengths.values())) / len(effect.strengths)
    return Effect(
        kind=kind,
        where=effect.where,
        strengths=dict.fromkeys(names, mean),
        shape={k: effect.shape.get(k, v) for k, v in usual.items()},
        ports=effect.ports,
        domain=effect.domain,
        load=effect.load if kind_named(kind).needs else "",
    )


def curve(likelihood: StageLikelihood, *, level: float, seed: int) -> list[tuple[Proposal, float]]:
    """Return the model with the free curve that promises most, and its p-value, if one is significant."""
    effects = likelihood.stage.effects
    offer = scan_free_curves(likelihood.weighted, effects, level=level, seed=seed)
    best = list(zip(offer.effects, offer.p_values, strict=True))[:1]
    return [(Proposal(move="add a curve", effects=(*effects, e)), float(p)) for e, p in best]


def _matters_to_prediction(model: TriedModel, parent: TriedModel) -> bool:
    """Tell whether predictions from sample to sample are better than a parent's by a relevant share.

    A mean square error that falls by a small share s in all of N samples gains N s / 2 nats.
    """
    assert model.likelihood is not None
    assert model.evidence is not None
    assert parent.evidence is not None
    gain = model.evidence.log_likelihood - parent.evidence.log_likelihood
    return gain >= 0.5 * POLICY.relevance * model.likelihood.count


def why_irrelevant(model: TriedModel, parent: TriedModel, wander: float) -> str:
    """Return why the effects that a model has more do not matter; an empty text if they do.

    Each must move some output by the noise of its sensor, at one instant at least, or change the error of one by a
    share that one could see, as a small offset does, or make predictions from sample to sample better by such a share.
    Where the error of an output is changed so, the records left out must not show that this is no improvement, and none
    may be made worse.  How sure it is that there is an improvement at all is for the log predictive score to say, which
    knows the unrecorded forces: where these make most of the error of a simulation, its square hardly shows an effect
    of a tenth of that, and be it certain.

    Parameters
    ----------
    model, parent : TriedModel
    wander : float
        Nats by which evidence changes with the linearisation.
    """
    assert model.likelihood is not None
    assert parent.likelihood is not None
    gain = simulation_gain(model.likelihood, parent.likelihood, fitted_again=wander == 0.0)
    errors = gain.in_normal_errors(POLICY.simulation_errors)
    if gain.harms(POLICY.harm, errors):
        return f"some output of records left out is simulated worse (square error gone: {gain})"
    if _matters_to_prediction(model, parent):
        return ""
    had = {str(e) for e in parent.stage.effects}
    shown = changed_share(model.stage, parent.stage) >= POLICY.relevance
    for effect in model.stage.effects:
        if str(effect) not in had and not np.any(shown) and shift_over_noise(model.likelihood, effect) < 1.0:
            share = 100.0 * POLICY.relevance
            return f"{effect} moves no output by the noise of its sensor, nor changes {share:g} % of a square error"
    if np.any(shown) and np.all(~shown | gain.rules_out(POLICY.relevance, errors)):
        return f"records left out are not simulated better (square error gone: {gain})"
    return ""
