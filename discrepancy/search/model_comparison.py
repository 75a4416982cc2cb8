"""Comparison of two fitted models: BIC, share of the error removed, records left out, and what a curve could gain."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discrepancy.search.policy import POLICY
from discrepancy.stages.prior_conflict import prior_penalty
from discrepancy.stages.stage import Stage, comparable_residuals
from discrepancy.statistics.blocks import Sensitivities
from discrepancy.statistics.projection import Layout, project
from discrepancy.statistics.whitening import identity
from estimation.signals.correlation import correlation_time

if TYPE_CHECKING:
    from estimation.signals.preparation import Preparation

__all__ = [
    "bic_difference",
    "error_reduction",
    "exceeds_noise",
    "excess_error",
    "expected_curve_reductions",
    "is_relevant",
    "left_out_difference",
    "left_out_residuals",
]


# ---------------------------------------------------------------- on the records of the fit


def bic_difference(richer: Stage, poorer: Stage) -> float:
    """Return the BIC of one stage minus that of another on the identification records.

    Residuals are coloured, so the number of samples of an output is divided by the correlation time of the richer
    model's residual: BIC = Σ_c N_c·ln(SSE_c) + k·ln(Σ_c N_c) + Σ (θ − θ₀)²/s² with N_c the effective number and the
    last sum the contribution of the priors (`discrepancy.stages.prior_conflict.prior_penalty`).  Where a
    disturbance adds up along the records, the residuals are those that `discrepancy.sensitivities.disturbance` weighs
    down.
    """
    total, samples = 0.0, 0.0
    all_a, all_b = comparable_residuals(richer, poorer)
    for c, name in enumerate(richer.outputs):
        a, b = [e[:, c] for e in all_a], [e[:, c] for e in all_b]
        n = sum(e.size / correlation_time(e) for e in a)
        floor = sum(e.size for e in a) * (POLICY.noise_share * richer.noise.get(name, 0.0)) ** 2
        sse_a, sse_b = (sum(float(e @ e) for e in group) + floor for group in (a, b))
        total += n * (np.log(max(sse_a, 1e-300)) - np.log(max(sse_b, 1e-300)))
        samples += n
    more = len(richer.identify.parameters) - len(poorer.identify.parameters)
    stated = prior_penalty(richer.identify, poorer.identify) - prior_penalty(poorer.identify, richer.identify)
    return float(total + more * np.log(max(samples, 2.0)) + stated)


def error_reduction(richer: Stage, poorer: Stage) -> float:
    """Return the share of the mean square error that an effect removes, averaged over the outputs."""
    before, after = poorer.rmse("identify"), richer.rmse("identify")
    shares = [1.0 - (after[n] / before[n]) ** 2 for n in richer.outputs if before[n] > 0.0]
    return float(np.mean(shares)) if shares else 0.0


def excess_error(stage: Stage) -> dict[str, float]:
    """Return the mean square error of each output above its noise floor; outputs at the floor are left out.

    An excess below the floor itself counts as the floor: chance is a large share of a very small excess.
    """
    error = stage.rmse("identify")
    excess = {}
    for name in stage.outputs:
        floor = stage.noise.get(name, 0.0) ** 2
        if error[name] ** 2 > floor:
            excess[name] = max(error[name] ** 2 - floor, floor)
    return excess


def is_relevant(richer: Stage, poorer: Stage) -> bool:
    """Tell whether the error that an effect removes reaches the noise floor of at least one output.

    With enough samples anything is significant; an effect that calibration could almost replace is not worth naming.
    The root mean square decides here, where the scan states what could hide by the peak: each is the cautious choice
    for its statement.  By the peak, two more of sixteen correct 1D lifts got a dry friction.
    """
    before, after = poorer.rmse("identify"), richer.rmse("identify")
    gained = {n: max(before[n] ** 2 - after[n] ** 2, 0.0) ** 0.5 for n in richer.outputs}
    return any(gained[n] >= richer.noise.get(n, 0.0) for n in richer.outputs)


def exceeds_noise(stage: Stage) -> bool:
    """Tell whether the error of at least one output is well above its noise floor."""
    error = stage.rmse("identify")
    return any(error[n] > POLICY.above_noise * stage.noise.get(n, 0.0) for n in stage.outputs)


# ---------------------------------------------------------------- on records left out


def left_out_residuals(stage: Stage, preparation: Preparation, weights: dict[str, float]) -> np.ndarray:
    """Return the residual of every record with the parameters fitted to the others, shape (n, n_channels).

    A model with many free values can follow a slow disturbance, and no criterion that counts samples detects it.  Its
    prediction of a record that it was not fitted to is then worse than that of a law.  Around the fit the outputs are
    linear in the parameters, so each record's residual without its part in the fit follows from the normal equations,
    without another fit.  Each record's own unknowns (its initial state, its offsets) are fitted to that record, as they
    are when a record is held out.

    A strength that only the record itself determines, such as that of a curve's point where no other record comes, is
    not known from the others: a normal prior with the spread of all strengths of its effect keeps it near zero.

    Parameters
    ----------
    stage : Stage
        With parameters fitted to several records.
    preparation : Preparation
        Of the residuals.
    weights : dict of str to float
        Divisor of each output's residual in the fit.
    """
    problem = stage.linearised_problem(preparation)
    residual, sens = problem.residual(), problem.sensitivities()
    prior, offset = sens.prior_std.copy(), sens.prior_offset.copy()
    for effect in stage.effects:
        names = [effect.parameter_name(k) for k in effect.strengths]
        spread = float(np.sqrt(np.mean(np.square(list(effect.strengths.values())))))
        for name, value in zip(names, effect.strengths.values(), strict=True):
            if name in sens.names and spread > 0.0 and not effect.definition.stated:
                k = sens.names.index(name)
                prior[k], offset[k] = spread, -value
    known = np.isfinite(prior)
    layout = Layout(tuple(len(b) for b in residual.blocks), len(residual.channels), 0)
    whitener = identity([weights[c] for c in residual.channels], residual.channels, residual.dt)
    own = project(whitener, Sensitivities(names=sens.names, blocks=sens.blocks, nuisance=sens.nuisance), layout)
    e = own.remove_local(layout.stack(whitener, residual.blocks))
    F = own.remove_local(layout.stack(whitener, sens.blocks)) if sens.names else np.zeros((layout.n_rows, 0))
    scale = np.maximum(np.linalg.norm(F, axis=0), 1e-300)
    F /= scale
    held = np.where(known, 1.0 / (prior * scale), 0.0)
    normal, right = F.T @ F + np.diag(held**2), F.T @ e + held**2 * offset * scale
    out = e.copy()
    for rows in layout.left_out():
        without = normal - F[rows].T @ F[rows]
        change = np.linalg.lstsq(without, right - F[rows].T @ e[rows], rcond=1e-10)[0]
        out[rows] = e[rows] - F[rows] @ change
    return np.asarray(out.reshape(-1, layout.n_channels))


def left_out_difference(one: Stage, other: Stage, preparation: Preparation) -> float:
    """Return minus twice the log-likelihood of records left out, one model's minus another's; below zero: better.

    Samples are counted as in `bic_difference`; there is no penalty for parameters, because none was fitted to the
    record in question.
    """
    rmse = other.rmse("identify")
    weights = {n: max(rmse[n], other.noise.get(n, 0.0), 1e-300) for n in other.outputs}
    a, b = (left_out_residuals(s, preparation, weights) for s in (one, other))
    total = 0.0
    for c in range(a.shape[1]):
        count = len(a) / correlation_time(a[:, c])
        total += count * float(np.log(np.sum(a[:, c] ** 2) / np.sum(b[:, c] ** 2)))
    return total


# ---------------------------------------------------------------- before a refit with a free curve


def expected_curve_reductions(before: Stage, last: Stage) -> dict[tuple[str, str], float]:
    """Return the error that every free curve would remove beside the effects of a stage, by place and regressor.

    A curve in place of a law removes at most what it would remove beside that law.  In the linearisation along the
    records that costs one projection; a refit in full simulation costs seconds.

    Parameters
    ----------
    before : Stage
        Without the laws that the curve would replace.
    last : Stage
        With them.

    Returns
    -------
    dict of (str, str) to float
        Share of the mean square error of ``before`` above the noise floor, of the output with the largest share,
        beyond what is expected by chance.
    """
    start, now = excess_error(before), last.rmse("identify")
    expected = {}
    for curve, reductions in last.free_curve_error_drops().items():
        left = dict(zip(last.outputs, reductions, strict=True))
        expected[curve] = max((float(left[n]) * now[n] ** 2 / start[n] for n in start), default=0.0)
    return expected
