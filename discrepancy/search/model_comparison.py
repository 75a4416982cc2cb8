"""What one stage is worth against another: evidence, the share of the error taken away, and whether that matters."""

from __future__ import annotations

import numpy as np

from discrepancy.stages.prior_conflict import prior_penalty
from discrepancy.stages.stage import Stage, comparable_residuals
from estimation.signals.correlation import correlation_time

__all__ = ["CLEARLY", "above_floor", "bic_difference", "loud", "matters", "taken"]

CLEARLY = 10.0  # difference of BIC that counts as strong evidence (Kass and Raftery 1995)
LOUD = 2.0  # times its noise floor from which what is left of an output asks for an answer; chosen, not measured


def bic_difference(richer: Stage, poorer: Stage) -> float:
    """Return the BIC of one stage minus that of another on the identification records.

    Residuals are coloured, so the number of samples of an output is divided by how long the richer model's residual
    remembers: BIC = Σ_c N_c·ln(SSE_c) + k·ln(Σ_c N_c) + Σ (θ − θ₀)²/s² with N_c the effective number and the last sum
    what the stated uncertainty says about the parameters (`discrepancy.stages.prior_conflict.prior_penalty`).  Where a
    disturbance adds up
    along the records, the residuals are those that `discrepancy.sensitivities.disturbance` weighs down.
    """
    total, samples = 0.0, 0.0
    all_a, all_b = comparable_residuals(richer, poorer)
    for c, name in enumerate(richer.outputs):
        a, b = [e[:, c] for e in all_a], [e[:, c] for e in all_b]
        n = sum(e.size / correlation_time(e) for e in a)
        floor = sum(e.size for e in a) * (1e-3 * richer.noise.get(name, 0.0)) ** 2
        sse_a, sse_b = (sum(float(e @ e) for e in group) + floor for group in (a, b))
        total += n * (np.log(max(sse_a, 1e-300)) - np.log(max(sse_b, 1e-300)))
        samples += n
    more = len(richer.identify.parameters) - len(poorer.identify.parameters)
    stated = prior_penalty(richer.identify, poorer.identify) - prior_penalty(poorer.identify, richer.identify)
    return float(total + more * np.log(max(samples, 2.0)) + stated)


def taken(richer: Stage, poorer: Stage) -> float:
    """Return the share of the mean square error that an effect takes away, averaged over the outputs."""
    before, after = poorer.rmse("identify"), richer.rmse("identify")
    shares = [1.0 - (after[n] / before[n]) ** 2 for n in richer.outputs if before[n] > 0.0]
    return float(np.mean(shares)) if shares else 0.0


def above_floor(stage: Stage) -> dict[str, float]:
    """Return by how much the mean square error of each output is above its noise floor; others are left out.

    What is above it by less than the floor itself counts as much as the floor: of next to nothing, luck is a large
    share.
    """
    error = stage.rmse("identify")
    found = {}
    for name in stage.outputs:
        floor = stage.noise.get(name, 0.0) ** 2
        if error[name] ** 2 > floor:
            found[name] = max(error[name] ** 2 - floor, floor)
    return found


def matters(richer: Stage, poorer: Stage) -> bool:
    """Tell whether what an effect takes away reaches the noise floor of at least one output.

    With enough samples anything is significant; an effect that calibration could all but replace is not worth a name.
    By its root mean square, where the scan says what could hide by the peak: that claim is the cautious one there, and
    this one here.  By the peak, two more of sixteen correct 1D lifts got a dry friction.
    """
    before, after = poorer.rmse("identify"), richer.rmse("identify")
    gained = {n: max(before[n] ** 2 - after[n] ** 2, 0.0) ** 0.5 for n in richer.outputs}
    return any(gained[n] >= richer.noise.get(n, 0.0) for n in richer.outputs)


def loud(stage: Stage) -> bool:
    """Tell whether the error of at least one output stands well above its noise floor."""
    error = stage.rmse("identify")
    return any(error[n] > LOUD * stage.noise.get(n, 0.0) for n in stage.outputs)
