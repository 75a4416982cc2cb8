"""Probabilities of models and effects, from the log evidence of everything that was tried."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.unknown_law import UNKNOWN
from discrepancy.stages.stage import RivalExplanation
from discrepancy.statistics.verdicts import Verdict

if TYPE_CHECKING:
    from discrepancy.evidence.criterion import ModelPrior
    from discrepancy.evidence.moves import TriedModel
    from discrepancy.evidence.proposals import Proposals

__all__ = ["Posterior", "posterior", "rivals_of"]


@dataclass(frozen=True, kw_only=True)
class EffectProbability:
    """How probable it is that an effect is missing, and what else it could be.

    Parameters
    ----------
    kind, where : str
    probability : float
        Of all models that hold it.
    alternatives : tuple of (str, float)
        Other explanations in its place, as ``kind@where``, with their probabilities: the most probable that together
        with it reach 95 %.
    """

    kind: str
    where: str
    probability: float
    alternatives: tuple[tuple[str, float], ...] = ()

    def to_dict(self) -> dict[str, object]:
        """Return it as it stands in diagnosis.json."""

        def entry(name: str, probability: float) -> dict[str, object]:
            kind, _, where = name.partition("@")
            return {"kind": kind, "where": where, "probability": probability}

        own = entry(f"{self.kind}@{self.where}", self.probability)
        return {**own, "set": [own, *(entry(n, p) for n, p in self.alternatives)]}


@dataclass(frozen=True, kw_only=True)
class Posterior:
    """Probabilities of what is missing.

    Parameters
    ----------
    nothing : float
        That nothing is.
    unknown : float
        That something is missing that the catalogue does not hold, also if the search does not see it.
    effects : tuple of EffectProbability
        Of the effects that were found.
    models : mapping of tuple to float
        Every model that was tried, by the names of its effects, if nothing is missing that the search does not see.
        Where nothing was found, the first that together reach 95 % are the answers that the records leave open.
    """

    nothing: float
    unknown: float
    effects: tuple[EffectProbability, ...]
    models: Mapping[tuple[str, ...], float]

    def to_dict(self) -> dict[str, object]:
        """Return it as it stands in diagnosis.json."""
        return {
            "nothing": self.nothing,
            "unknown": self.unknown,
            "effects": [e.to_dict() for e in self.effects],
            "models": [
                {"effects": list(k), "probability": p}
                for k, p in sorted(self.models.items(), key=lambda t: -t[1])
                if p >= 1e-4
            ],
        }


def posterior(
    models: Mapping[tuple[str, ...], TriedModel],
    found: Sequence[str],
    proposals: Proposals | None,
    final: Proposals | None = None,
    prior: ModelPrior | None = None,
    *,
    unknown: bool = False,
    wander: float = 0.0,
    temperature: float = POLICY.temperature,
) -> Posterior:
    """Return the probabilities of the models that were tried, and of the effects that were found.

    Candidates that change the same as one that was fitted, within what the records can tell, share its evidence; those
    that were not fitted beside the model that was taken have their linear evidence.

    Parameters
    ----------
    models : mapping of tuple to TriedModel
    found : sequence of str
        Names of the effects of the model that was taken.
    proposals : Proposals or None
        Of the model without effects: what changes the same.
    final : Proposals or None
        Of the model that was taken: what changes the same there as well, and what else might be added.
    prior : ModelPrior or None
        What a further effect costs; without it none is added.
    unknown : bool
        Whether the model that was taken fails its predictive checks: what it leaves of the probability of "nothing" is
        then that of "unknown".
    wander : float
        Nats by which evidence changes with the linearisation; what models with effects gain less of it counts.
    temperature : float
        Divisor of the log evidence.  What is known before the records are seen is not divided.

    Notes
    -----
    A model with an effect that would not matter (it makes no prediction of records left out better) counts as the
    model that it was made of, and so do those that change the same.  A model that only the records held out did not
    confirm keeps its probability, unless the answer is a part of it: the evidence of all other records is for it.  So
    does one that the evidence cannot tell from the simpler law that was taken in its place.
    """
    first = models[()].total if () in models else -math.inf
    weights = {
        k: _Weight(_of_records(m, first, wander), m.log_odds, k) for k, m in models.items() if math.isfinite(m.total)
    }
    weights |= _twin_models(weights, proposals, final)
    taken = models.get(tuple(sorted(found)))
    weights |= _unknown_laws(weights, models, found)
    if prior is not None and final is not None and taken is not None:
        weights |= _models_not_fitted(weights, taken, final, prior)
    probabilities = _of_what_matters(weights, temperature, models, found)
    nothing = probabilities.get((), 0.0)
    of_unknown = sum(p for k, p in probabilities.items() if any(n.startswith(UNKNOWN) for n in k))
    effects = [_probability_of(name, found, probabilities) for name in found]
    if not found:
        unseen = nothing if unknown else nothing * _share_unseen()
        nothing, of_unknown = nothing - unseen, of_unknown + unseen
    return Posterior(nothing=nothing, unknown=of_unknown, effects=tuple(effects), models=probabilities)


def _share_unseen() -> float:
    """Return how much of the probability of "nothing" is that of something outside the catalogue that was not seen.

    Before the records are seen it is as probable as one effect of the catalogue: half as probable as nothing.
    """
    odds = 0.5 * POLICY.unseen
    return odds / (1.0 + odds)


def _of_records(model: TriedModel, first: float, wander: float) -> float:
    """Return the log evidence of a model without its prior odds, what is overstated or chance of it left out.

    Another linearisation changes it by chance: of what a model gains over the first it is the part by which an effect
    must raise the evidence to be better at all; see `discrepancy.evidence.tried_models.judge`.
    """
    total = model.total - model.overstated
    if model.key and not model.promises_enough and math.isfinite(first):
        total -= min(wander, max(total - first, 0.0))
    return total - model.log_odds


def _probability_of(
    name: str, found: Sequence[str], probabilities: Mapping[tuple[str, ...], float]
) -> EffectProbability:
    """Return how probable an effect of the model that was taken is, and what else may stand in its place."""
    own = sum(p for k, p in probabilities.items() if name in k)
    kind, _, where = name.partition("@")
    rest = {n for n in found if n != name}
    others: dict[str, float] = {}
    for key, p in probabilities.items():
        new = set(key) - rest
        if name not in key and rest <= set(key) and len(new) == 1:
            other = next(iter(new))
            others[other] = others.get(other, 0.0) + p
    alternatives, total = [], own
    for other, p in sorted(others.items(), key=lambda t: -t[1]):
        if total >= POLICY.set_share or p < POLICY.listed:
            break
        alternatives.append((other, p))
        total += p
    place = where.partition(" over ")[0].partition(" #")[0]  # a free curve is named with its argument
    return EffectProbability(kind=kind, where=place, probability=own, alternatives=tuple(alternatives))


@dataclass(frozen=True)
class _Weight:
    """Log evidence of a model without its prior odds, these, and the fitted model that it was derived from."""

    data: float
    odds: float
    of: tuple[str, ...]

    @property
    def total(self) -> float:
        return self.data + self.odds


def _of_what_matters(
    weights: Mapping[tuple[str, ...], _Weight],
    temperature: float,
    models: Mapping[tuple[str, ...], TriedModel],
    found: Sequence[str],
) -> dict[tuple[str, ...], float]:
    """Return the probabilities with those of effects that do not matter added to the model without them."""
    logs = {k: w.data / temperature + w.odds for k, w in weights.items()}
    most = max(logs.values(), default=0.0)
    whole = sum(math.exp(v - most) for v in logs.values())
    out: dict[tuple[str, ...], float] = {}
    taken = tuple(sorted(found))
    for key, value in logs.items():
        model = models.get(weights[key].of)
        passed: set[tuple[str, ...]] = set()
        while model is not None and not model.matters and key != taken and model.key not in passed:
            if model.as_good or (model.unconfirmed and not (found and set(found) < set(model.key))):
                break
            passed.add(model.key)
            other = model.counts_for if model.counts_for is not None else model.parent
            if other is None:
                break
            key, model = other, models.get(other)
        out[key] = out.get(key, 0.0) + math.exp(value - most) / whole
    return out


def _twin_models(
    weights: Mapping[tuple[str, ...], _Weight], proposals: Proposals | None, final: Proposals | None
) -> dict[tuple[str, ...], _Weight]:
    """Return models in which a candidate that was not fitted stands for one that was, because both change the same.

    Around a model that lacks a large effect much looks alike; what differs around the model that has it is no twin.
    """
    twins: dict[tuple[str, ...], _Weight] = {}
    if proposals is None:
        return twins
    for key, weight in weights.items():
        for name in key:
            own = proposals.named(name)
            if own is None:
                continue
            for twin in proposals.twins(name):
                other = tuple(sorted([*(n for n in key if n != name), twin.name]))
                distinguished = final is not None and name in final.alike and twin.name not in final.alike[name]
                if twin.name not in key and other not in weights and not distinguished:
                    value = weight.data + min(twin.gain - own.gain, 0.0)
                    if other not in twins or value > twins[other].data:
                        twins[other] = _Weight(value, weight.odds, key)
    return twins


def _unknown_laws(
    weights: Mapping[tuple[str, ...], _Weight], models: Mapping[tuple[str, ...], TriedModel], found: Sequence[str]
) -> dict[tuple[str, ...], _Weight]:
    """Return the models with something that follows the machine's state beside them, where that has been asked.

    Where it stands in the place of an effect that was found, it counts as in
    `discrepancy.evidence.moves.TriedModel.log_weight_with_law_in_place`.
    """
    beside = {}
    taken = models.get(tuple(sorted(found)))
    for key, model in models.items():
        law = model.unknown_law
        if law is not None and law.predicts and key in weights:
            weight = weights[key]
            gain = model.gain_of_law(taken) if taken is not None and set(key) < set(found) else law.gain
            data, odds = weight.data + gain - law.log_odds, weight.odds + law.log_odds
            beside[(*key, law.name)] = _Weight(data, odds, key)
    return beside


def _models_not_fitted(
    weights: Mapping[tuple[str, ...], _Weight], taken: TriedModel, final: Proposals, prior: ModelPrior
) -> dict[tuple[str, ...], _Weight]:
    """Return the model that was taken with each of the candidates that were not fitted beside it.

    Those that promised most were fitted, so none is better than the best of these.  Of those for which the records do
    not ask, the ones remain that may still be of a size that matters: what the records cannot tell is as probable as it
    was before.
    """
    base, count = weights[taken.key], len(taken.key)
    odds = base.odds + prior.log_probability_of_names(count + 1) - prior.log_probability_of_names(count)
    fitted = [w.data for k, w in weights.items() if len(k) == count + 1 and set(taken.key) < set(k)]
    most = max(fitted, default=math.inf)
    negligible = {r.name for r in final.scan.rows if r.verdict is Verdict.NEGLIGIBLE}
    more = {}
    for c in final.candidates:
        key = tuple(sorted([*taken.key, c.name]))
        if math.isfinite(c.gain) and c.name not in taken.key and key not in weights and c.name not in negligible:
            more[key] = _Weight(min(base.data + c.gain, most), odds, key)
    return more


def rivals_of(
    best: TriedModel,
    name: str,
    models: Mapping[tuple[str, ...], TriedModel],
    proposals: Proposals | None,
    final: Proposals | None = None,
) -> tuple[RivalExplanation, ...]:
    """Return the other explanations of an effect: the models with something else in its place, best first."""
    rest = set(best.key) - {name}
    weights = {
        k: _Weight(m.of_records - m.overstated, m.log_odds, k)
        for k, m in models.items()
        if math.isfinite(m.total) and (m.matters or m.unconfirmed or m.as_good or m is best)
    }
    fitted = set(weights)
    weights |= _twin_models(weights, proposals, final)
    rivals = []
    for key, weight in weights.items():
        new = set(key) - rest
        if name in key or not rest <= set(key) or len(new) != 1:
            continue
        kind, _, where = next(iter(new)).partition("@")
        behind = best.total - best.overstated - weight.total
        rivals.append(
            RivalExplanation(
                kind=kind,
                where=where,
                delta_bic=2.0 * behind,
                refitted=key in fitted,
                indistinguishable=math.exp(-max(behind, 0.0) / POLICY.temperature) > POLICY.tie,
            )
        )
    return tuple(sorted(rivals, key=lambda r: r.delta_bic))
