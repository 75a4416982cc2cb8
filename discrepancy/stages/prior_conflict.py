"""Prior conflict: how far calibrated parameters are from their stated values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from multibody.base.quantity_text import quantity_text

if TYPE_CHECKING:
    from estimation.fit.calibration import Calibration, UncertainParameter

__all__ = ["conflict_text", "needs_prior_conflict", "prior_conflicts", "prior_penalty"]

CONFLICT_STD = 3.0  # deviations from its stated value at which a parameter counts as outside


def prior_penalty(calibration: Calibration, other: Calibration | None = None) -> float:
    """Return the penalty of the fitted values by their priors: Σ (θ − θ₀)²/(s² + σ²), one term for each parameter.

    s is the stated standard deviation and σ that of the fit: a value that the records hardly determine is not in
    conflict.  Parameters without a stated deviation and those at a bound do not count.

    Parameters
    ----------
    calibration : Calibration
    other : Calibration, optional
        Source of the deviations of the fit where the calibration has none, as that of a trial fit.
    """
    known = _deviations(other) if other is not None else {}
    total = 0.0
    for q, value, own in zip(calibration.parameters, calibration.values, calibration.std, strict=True):
        sigma = known.get(q.name, 0.0) if np.isnan(own) else float(own)
        total += (float(value) - q.value) ** 2 / (q.std**2 + sigma**2)
    return total


def _deviations(calibration: Calibration) -> Mapping[str, float]:
    return {q.name: float(s) for q, s in zip(calibration.parameters, calibration.std, strict=True) if not np.isnan(s)}


def prior_conflicts(
    calibration: Calibration, stated: Mapping[str, UncertainParameter] | None = None
) -> tuple[tuple[UncertainParameter, float], ...]:
    """Return the parameters fitted further from their stated value than `CONFLICT_STD` deviations, with their fits.

    Parameters
    ----------
    calibration : Calibration
    stated : mapping of str to UncertainParameter, optional
        The priors, where the calibration itself was given other deviations.
    """
    conflicts = []
    for q, value in zip(calibration.parameters, calibration.values, strict=True):
        prior = (stated or {}).get(q.name, q)
        if abs(float(value) - prior.value) > CONFLICT_STD * prior.std:
            conflicts.append((prior, float(value)))
    return tuple(conflicts)


def needs_prior_conflict(richer: Calibration, poorer: Calibration) -> bool:
    """Tell whether a poorer model replaces an effect only with parameters in conflict with their priors."""
    return bool({q.name for q, _ in prior_conflicts(poorer)} - {q.name for q, _ in prior_conflicts(richer)})


def conflict_text(parameter: UncertainParameter, value: float) -> str:
    """Return a parameter's value with its prior, for a sentence."""
    stated, deviation = quantity_text(parameter.value, parameter.unit), quantity_text(parameter.std, parameter.unit)
    return f"{parameter.name} = {quantity_text(value, parameter.unit)} (stated: {stated} ± {deviation})"
