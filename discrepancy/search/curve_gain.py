"""Which free curves could take more of the error away than the laws that were found: asked before any refit.

A curve in the place of a law takes away at most what it would take away beside that law.  What it takes away beside
it, in the machine's linearisation along the records, costs one projection; a refit in full simulation costs seconds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from discrepancy.search.model_comparison import above_floor

if TYPE_CHECKING:
    from discrepancy.stages.stage import Stage

__all__ = ["promised"]


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
    for curve, drops in last.free_curve_error_drops().items():
        left = dict(zip(last.outputs, drops, strict=True))
        found[curve] = max((float(left[n]) * now[n] ** 2 / start[n] for n in start), default=0.0)
    return found
