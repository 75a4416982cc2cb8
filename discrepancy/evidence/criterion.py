"""The criterion of the search: the log marginal likelihood of one model, by Laplace's approximation.

One function of one model, so that differences are antisymmetric and add up.  Parameters of calibration and effects are
integrated out around the fit; variances of noise and latent forces maximise the restricted likelihood.  So a latent
process pays what it had to earn to become part of the noise: an explanation by chance is not free beside an effect.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.effects.effect import Effect
from discrepancy.evidence.fitted_noise import log_price
from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.evidence.linearised_records import noise_floor

ROUNDING = 1e-6  # share of an effect's largest strength below zero that counts as zero

__all__ = ["Evidence", "ModelPrior", "log_evidence", "log_prior_of_strengths", "strength_scale"]


@dataclass(frozen=True, kw_only=True)
class ModelPrior:
    """What is known of models before the records are seen.

    Parameters
    ----------
    candidates : int
        Effects of the catalogue that these records can ask for.
    shapes : mapping of str to int
        Points of the shape grid of each candidate, by ``kind@where``; all equally probable.
    stated : mapping of str to float
        Values of the machine's own parameters as stated, by full name.
    """

    candidates: int
    shapes: Mapping[str, int]
    stated: Mapping[str, float]

    def log_probability(self, effects: Sequence[Effect]) -> float:
        """Return the log prior probability of a model with some effects.

        Half of the mass is on a model that lacks nothing, half of the rest on one that lacks one effect, and so on; the
        effects of the catalogue are equally probable, and so are their shapes.
        """
        shapes = sum(math.log(max(self.shapes.get(str(e), 1), 1)) for e in effects)
        return self.log_probability_of_names(len(effects)) - shapes

    def log_probability_of_names(self, count: int) -> float:
        """Return the log prior probability of a model with so many effects, their shapes not counted."""
        return -(count + 1) * math.log(2.0) - math.log(math.comb(max(self.candidates, count), count))


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """The log evidence of a model and its parts, nats.

    Parameters
    ----------
    log_likelihood : float
        Restricted: calibration, own unknowns and strengths integrated out around the fit.
    log_prior : float
        Density of the strengths at the fit, with (2π)^½ for each strength that was integrated out.
    log_odds : float
        Log prior probability of the model.
    log_noise : float
        What the latent processes of the noise cost, whose sizes and memories are maximised over and not integrated out:
        negative, or zero without any.
    """

    log_likelihood: float
    log_prior: float
    log_odds: float
    log_noise: float = 0.0

    @property
    def total(self) -> float:
        """Their sum."""
        return self.log_likelihood + self.log_prior + self.log_odds + self.log_noise


def strength_scale(blocks: Sequence[np.ndarray], noise: np.ndarray) -> np.ndarray:
    """Return the strength that moves some output by its noise at its peak, for every column of (n, n_c, k) blocks."""
    peak = np.max([np.max(np.abs(b), axis=0, initial=0.0) for b in blocks], axis=0)
    return 1.0 / np.maximum(np.max(peak / noise[:, None], axis=0), 1e-300)


def log_prior_of_strengths(values: np.ndarray, scale: np.ndarray, one_sided: bool) -> float:
    """Return the log density of Cauchy priors at some strengths; half of it lies above zero where they are one-sided.

    A normal prior would charge an effect thirty times the size that matters 450 nats; the Cauchy prior charges 7.
    """
    density = -np.log(np.pi * scale) - np.log1p((values / scale) ** 2)
    return float(np.sum(density + (np.log(2.0) if one_sided else 0.0)))


def log_evidence(likelihood: StageLikelihood, prior: ModelPrior) -> Evidence:
    """Return the log evidence of a fitted model.

    Parameters
    ----------
    likelihood : StageLikelihood
    prior : ModelPrior
    """
    stage, fitted, linearised = likelihood.stage, likelihood.noise, likelihood.linearised
    sens = linearised.sensitivities()
    noise = noise_floor(linearised)
    log_prior = 0.0
    held = set(likelihood.held)
    changes = dict(zip([n for n in sens.names if n not in held], fitted.change.tolist(), strict=True))
    for effect in stage.effects:
        names = [effect.parameter_name(k) for k in effect.strengths]
        values = np.array([v + changes.get(n, 0.0) for n, v in zip(names, effect.strengths.values(), strict=True)])
        if effect.definition.one_sided and np.any(values < -ROUNDING * np.max(np.abs(values), initial=0.0)):
            return Evidence(log_likelihood=-math.inf, log_prior=0.0, log_odds=0.0)
        if effect.definition.stated:
            values = values - np.array([prior.stated.get(n, 0.0) for n in names])
        moved = [k for k, n in enumerate(names) if n in changes]
        if not moved:
            continue
        columns = [sens.names.index(names[k]) for k in moved]
        if effect.definition.free_form:
            spread = max(float(np.sqrt(np.mean(values[moved] ** 2))), 1e-300)
            log_prior += -0.5 * len(moved) * (math.log(2.0 * math.pi * spread**2) + 1.0)
        else:
            scale = strength_scale([b[:, :, columns] for b in sens.blocks], noise)
            log_prior += log_prior_of_strengths(values[moved], scale, effect.definition.one_sided)
        log_prior += 0.5 * len(moved) * math.log(2.0 * math.pi)
    rise = likelihood.rise_to_likeliest if likelihood.as_it_stands else 0.0
    return Evidence(
        log_likelihood=fitted.log_likelihood - rise,
        log_prior=log_prior,
        log_odds=prior.log_probability(stage.effects),
        log_noise=log_price(linearised, fitted.model),
    )
