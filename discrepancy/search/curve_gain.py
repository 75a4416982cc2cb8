"""Which free curves could take more of the error away than the laws that were found: asked before any refit.

A curve in the place of a law takes away at most what it would take away beside that law.  What it takes away beside
it, in the machine's linearisation along the records, costs one projection; a refit in full simulation costs seconds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from discrepancy.search.model_comparison import above_floor
from discrepancy.search.step import scan_preparation
from discrepancy.sensitivities.disturbance import facts_of
from discrepancy.sensitivities.free_curve_scan import free_curve_candidates
from discrepancy.statistics.blocks import Array, Candidate
from discrepancy.statistics.projection import Projection
from discrepancy.statistics.whitened import plain_projection
from estimation.signals.correlation import correlation_time

if TYPE_CHECKING:
    from discrepancy.stages.stage import Stage

__all__ = ["promised"]

_KEY = "promised by curves"


def promised(before: Stage, last: Stage) -> dict[tuple[str, str], float]:
    """Return what every free curve would take away beside what a stage has, by place and regressor.

    Parameters
    ----------
    before : Stage
        Without the laws that the curve would replace.
    last : Stage
        With them.

    Returns
    -------
    dict of (str, str) to float
        Share of the mean square error that ``before`` has above the noise floor, of the output of which it is largest,
        beyond what luck gives.
    """
    start, now = above_floor(before), last.rmse("identify")
    found = {}
    for curve, drops in _drops(last).items():
        left = dict(zip(last.outputs, drops, strict=True))
        found[curve] = max((float(left[n]) * now[n] ** 2 / start[n] for n in start), default=0.0)
    return found


def _drops(last: Stage) -> dict[tuple[str, str], Array]:
    """Return the share of what is left of each output that every free curve would take away."""
    if _KEY not in last.worked_out:
        facts = facts_of(last, scan_preparation(last))
        residual = facts.residual()
        projection = plain_projection(residual, facts.sensitivities())
        e = projection.remove(projection.layout.stack(projection.whitener, residual.blocks))
        last.worked_out[_KEY] = {
            (c.where, str(c.info["over"])): _drop(projection, e, e - _fitted(c, projection, e), c.k)
            for c in free_curve_candidates(facts, last.system.places)
        }
    return last.worked_out[_KEY]


def _drop(projection: Projection, before: Array, after: Array, points: int) -> Array:
    """Return the share of each channel's energy that a fit takes away beyond what it takes of mere noise.

    Of noise that remembers as long as what is left does, a fit of k points takes k of the effective number of samples.
    """
    blocks = range(len(projection.layout.lengths))
    found = []
    for c in range(projection.layout.n_channels):
        b, a = ([projection.layout.view(e, k)[:, c] for k in blocks] for e in (before, after))
        left = sum(float(x @ x) for x in a) / max(sum(float(x @ x) for x in b), 1e-300)
        count = sum(x.size / correlation_time(x) for x in a)
        found.append(1.0 - left * (1.0 + points / count))
    return np.array(found)


def _fitted(candidate: Candidate, projection: Projection, e: Array) -> Array:
    """Return the part of a projected residual that a candidate's columns can follow, however dependent they are."""
    columns = projection.remove(projection.layout.stack(projection.whitener, candidate.columns[0]))
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 0.0] / size[size > 0.0]
    out: Array = columns @ np.linalg.lstsq(columns, e, rcond=1e-10)[0]
    return out
