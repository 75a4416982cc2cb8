"""A rival of every named effect: something that follows from motion and inputs, by no law of the catalogue."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from discrepancy.evidence.features import FeatureBlock, feature_blocks
from discrepancy.evidence.likelihood import StageLikelihood, noise_floor, record_columns, smaller_noises, with_columns
from discrepancy.evidence.policy import POLICY
from discrepancy.innovations.noise_fit import fit_noise, gains_of_random_columns
from discrepancy.innovations.noise_model import NoiseModel

__all__ = ["SystematicForce", "systematic_force"]

#: Standard deviations of the weights that are tried: nats that each feature would gain, and their root.
SIZES = (3.0, 10.0, 30.0, 100.0, 300.0)
#: Groups of features beside which the noise is fitted again, best first, and how often.
FITTED_AGAIN, ROUNDS = 3, 2


@dataclass(frozen=True, eq=False, kw_only=True)
class SystematicForce:
    """The best description of what is missing by a general function of motion and inputs at one place.

    Parameters
    ----------
    where : str
        The connection on which it acts as a force, the input or the output that it is added to.
    on : str
        What it depends on.
    gain : float, nats
        By which the evidence rises with it, the price for the choice of place, features and size included.
    share : ndarray, shape (n_c,)
        Of the simulation's mean square error that it explains.
    """

    where: str
    on: str
    gain: float
    share: np.ndarray

    def __str__(self) -> str:
        return f"something at {self.where} that depends on {self.on}: log evidence {self.gain:+.1f}"

    @property
    def sentence(self) -> str:
        """What it says."""
        return (
            f"Something acts at {self.where} that depends on {self.on}, by no law of the catalogue "
            f"(log evidence {self.gain:+.0f})."
        )

    def to_dict(self) -> dict[str, object]:
        """Return it as it stands in diagnosis.json."""
        return {
            "where": self.where,
            "depends_on": self.on,
            "log_evidence": self.gain,
            "explained": [float(s) for s in self.share],
            "convincing": self.convincing,
        }

    @property
    def convincing(self) -> bool:
        """Whether it is better than a model without it, and matters."""
        return self.gain > POLICY.improvement and bool(np.any(self.share >= POLICY.relevance))


def systematic_force(likelihood: StageLikelihood, candidates: int) -> SystematicForce | None:
    """Return what a general function of motion and inputs explains beside a model; None where nothing can be asked.

    The function is linear in a few features with independent normal weights of one size, so that its evidence is that
    of a random force with a known shape.  A force that follows from the motion is first taken for noise: as candidates
    of the catalogue it is judged under smaller random forces too, and beside the best the noise is fitted again.

    Parameters
    ----------
    likelihood : StageLikelihood
    candidates : int
        Effects of the catalogue: this is one more that could have been chosen.
    """
    fitted, linearised = likelihood.noise, likelihood.linearised
    columns, std, offset = record_columns(linearised, fitted.records, likelihood.held)
    noises = [(fitted.model, 0.0)]
    noises += [(m, fitted.log_likelihood - likelihood.log_likelihood_of(m)) for m in smaller_noises(fitted.model)]
    blocks = list(feature_blocks(linearised, fitted.records))
    found: list[_Found] = []
    for block in blocks:
        own, names = with_columns(columns, block.columns), list(block.groups)
        best: dict[str, _Found] = {}
        for model, cost in noises:
            gains = gains_of_random_columns(own, model, std, offset, list(block.groups.values()), SIZES)
            for name, (gain, size, change) in zip(names, gains, strict=True):
                if name not in best or gain - cost > best[name].gain:
                    best[name] = _Found(block, name, gain - cost, size, change, model)
        found += best.values()
    if not found:
        return None
    price = math.log(2.0 * (candidates + len(found)) * len(SIZES))
    found.sort(key=lambda f: -f.gain)
    again = [_with_own_noise(likelihood, f) for f in found[:FITTED_AGAIN]]
    best_found = max([*again, found[0]], key=lambda f: f.gain)
    group = best_found.block.groups[best_found.on]
    together = with_columns(columns, [b[:, :, group] for b in best_found.block.columns])
    changed = np.concatenate([c.shared @ best_found.change for c in together])
    error = np.concatenate([c.residual for c in columns])
    share = np.sum(changed**2, axis=0) / np.maximum(np.sum(error**2, axis=0), 1e-300)
    return SystematicForce(where=best_found.block.where, on=best_found.on, gain=best_found.gain - price, share=share)


@dataclass(frozen=True, eq=False)
class _Found:
    block: FeatureBlock
    on: str
    gain: float
    size: float
    change: np.ndarray
    model: NoiseModel


def _with_own_noise(likelihood: StageLikelihood, found: _Found) -> _Found:
    """Return the same group with the noise fitted beside it."""
    fitted, linearised = likelihood.noise, likelihood.linearised
    columns, std, offset = record_columns(linearised, fitted.records, likelihood.held)
    group = found.block.groups[found.on]
    own = with_columns(columns, [b[:, :, group] for b in found.block.columns])
    floor, every = noise_floor(linearised), np.arange(group.size)
    for _ in range(ROUNDS):
        more = np.full(group.size, found.size)
        model, _ = fit_noise(
            own, np.append(std, more), np.append(offset, 0.0 * more), floor, [], start=found.model, grow=False
        )
        cost = fitted.log_likelihood - likelihood.log_likelihood_of(model)
        ((gain, size, change),) = gains_of_random_columns(own, model, std, offset, [every], SIZES)
        if gain - cost <= found.gain:
            break
        found = _Found(found.block, found.on, gain - cost, size, change, model)
    return found
