"""Probabilities of models and effects, from the log evidence of everything that was tried."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from discrepancy.evidence.policy import POLICY
from discrepancy.stages.stage import RivalExplanation

if TYPE_CHECKING:
    from discrepancy.evidence.moves import TriedModel
    from discrepancy.evidence.proposals import Proposals

__all__ = ["UNKNOWN", "Posterior", "posterior", "rivals_of"]

UNKNOWN = "unknown_force"  # the kind of a force that is found without a law


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
        That a force is missing that the catalogue does not hold.
    effects : tuple of EffectProbability
        Of the effects that were found.
    models : mapping of tuple to float
        Every model that was tried, by the names of its effects.
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
    *,
    unknown: bool = False,
    temperature: float = POLICY.temperature,
) -> Posterior:
    """Return the probabilities of the models that were tried, and of the effects that were found.

    Candidates that change the same as one that was fitted, within what the records can tell, share its evidence.

    Parameters
    ----------
    models : mapping of tuple to TriedModel
    found : sequence of str
        Names of the effects of the model that was taken.
    proposals : Proposals or None
        Of the model without effects: what changes the same.
    final : Proposals or None
        Of the model that was taken: what changes the same there as well.
    unknown : bool
        Whether the model that was taken fails its predictive checks: what it leaves of the probability of "nothing" is
        then that of "unknown".
    temperature : float
        Divisor of the log evidence.

    Notes
    -----
    A model with an effect that would not matter (it makes no prediction of records left out better) counts as the
    model that it was made of.
    """
    totals = {k: m.total for k, m in models.items() if math.isfinite(m.total)}
    totals |= _twin_models(totals, proposals, final)
    probabilities = _of_what_matters(_softmax(totals, temperature), models, found)
    nothing = probabilities.get((), 0.0)
    of_unknown = sum(p for k, p in probabilities.items() if any(n.startswith(UNKNOWN) for n in k))
    effects = []
    for name in found:
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
        effects.append(EffectProbability(kind=kind, where=where, probability=own, alternatives=tuple(alternatives)))
    if unknown and not found:
        nothing, of_unknown = 0.0, nothing + of_unknown
    return Posterior(nothing=nothing, unknown=of_unknown, effects=tuple(effects), models=probabilities)


def _of_what_matters(
    probabilities: Mapping[tuple[str, ...], float], models: Mapping[tuple[str, ...], TriedModel], found: Sequence[str]
) -> dict[tuple[str, ...], float]:
    """Return the probabilities with those of effects that do not matter added to the model without them."""
    out: dict[tuple[str, ...], float] = {}
    taken = tuple(sorted(found))
    for key, p in probabilities.items():
        model = models.get(key)
        while model is not None and model.parent is not None and not model.matters and key != taken:
            key, model = model.parent, models.get(model.parent)
        out[key] = out.get(key, 0.0) + p
    return out


def _twin_models(
    totals: Mapping[tuple[str, ...], float], proposals: Proposals | None, final: Proposals | None
) -> dict[tuple[str, ...], float]:
    """Return models in which a candidate that was not fitted stands for one that was, because both change the same.

    Around a model that lacks a large effect much looks alike; what differs around the model that has it is no twin.
    """
    twins: dict[tuple[str, ...], float] = {}
    if proposals is None:
        return twins
    for key, total in totals.items():
        for name in key:
            own = proposals.named(name)
            if own is None:
                continue
            for twin in proposals.twins(name):
                other = tuple(sorted([*(n for n in key if n != name), twin.name]))
                distinguished = final is not None and name in final.alike and twin.name not in final.alike[name]
                if twin.name not in key and other not in totals and not distinguished:
                    value = total + twin.gain - own.gain
                    twins[other] = max(twins.get(other, -math.inf), min(value, total))
    return twins


def _softmax(totals: Mapping[tuple[str, ...], float], temperature: float) -> dict[tuple[str, ...], float]:
    if not totals:
        return {}
    most = max(totals.values())
    weights = {k: math.exp((v - most) / temperature) for k, v in totals.items()}
    whole = sum(weights.values())
    return {k: w / whole for k, w in weights.items()}


def rivals_of(
    best: TriedModel,
    name: str,
    models: Mapping[tuple[str, ...], TriedModel],
    proposals: Proposals | None,
    final: Proposals | None = None,
) -> tuple[RivalExplanation, ...]:
    """Return the other explanations of an effect: the models with something else in its place, best first."""
    rest = set(best.key) - {name}
    totals = {k: m.total for k, m in models.items() if math.isfinite(m.total)}
    fitted = set(totals)
    totals |= _twin_models(totals, proposals, final)
    rivals = []
    for key, total in totals.items():
        new = set(key) - rest
        if name in key or not rest <= set(key) or len(new) != 1:
            continue
        kind, _, where = next(iter(new)).partition("@")
        behind = best.total - total
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
