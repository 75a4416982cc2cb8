"""What a fitted model says of a record that was left out of its fit, without fitting again.

A model with many free values can follow a disturbance that is slow, and no criterion that counts samples sees it.  What
it then says of a record that it was not fitted to is worse than what a law says.  Around the fit the outputs are
linear in the parameters, so each record's residual without its part in the fit follows from normal equations alone.
Each record's own unknowns (its start, its offsets) are fitted to that record all the same, as they are when a record
is held out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discrepancy.statistics.blocks import Sensitivities
from discrepancy.statistics.projection import Layout, project
from discrepancy.statistics.whitening import identity
from estimation.signals.correlation import correlation_time

if TYPE_CHECKING:
    from discrepancy.stages.stage import Stage
    from estimation.signals.preparation import Preparation

__all__ = ["left_out_difference", "left_out_residuals"]


def left_out_residuals(stage: Stage, preparation: Preparation, weights: dict[str, float]) -> np.ndarray:
    """Return the residual of every record with the parameters fitted to the others, shape (n, n_channels).

    A strength that only the record itself determines, as that of a curve's point where no other record comes, is not
    known from the others: it is held near zero, by a normal prior of the spread of all strengths of its effect.

    Parameters
    ----------
    stage : Stage
        With parameters fitted to several records.
    preparation : Preparation
        Of the residuals.
    weights : dict of str to float
        What the residual of each output is divided by in the fit.
    """
    facts = stage.linearised_problem(preparation)
    residual, sens = facts.residual(), facts.sensitivities()
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
    own = project(whitener, Sensitivities(sens.names, sens.blocks, nuisance=sens.nuisance), layout)
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
    """Return twice the log-likelihood by which one model says less of records left out than another; below zero: more.

    Samples are counted as in `discrepancy.search.model_comparison.bic_difference`; nothing is charged for parameters,
    because none was
    fitted to what is looked at.
    """
    rmse = other.rmse("identify")
    weights = {n: max(rmse[n], other.noise.get(n, 0.0), 1e-300) for n in other.outputs}
    a, b = (left_out_residuals(s, preparation, weights) for s in (one, other))
    total = 0.0
    for c in range(a.shape[1]):
        count = len(a) / correlation_time(a[:, c])
        total += count * float(np.log(np.sum(a[:, c] ** 2) / np.sum(b[:, c] ** 2)))
    return total
