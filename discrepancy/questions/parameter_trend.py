"""Parameters that change along the records: wear, warming, another tool, which no effect in the machine explains.

A calibrated value is that of all records together.  Where the true value was smaller in the first and larger in the
last, the residuals of both are proportional to the parameter's own sensitivity, with opposite signs.  So the candidates
are these sensitivities times the position of the record, or of a window of it, in the order of the study.  They are
scored by the same scan as effects, against the same null distribution, and reported; nothing is added to the model.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.statistics.blocks import Candidate
from discrepancy.statistics.thresholds import LEVEL_SHARES
from discrepancy.statistics.verdicts import Verdict
from multibody.base.quantity_text import quantity_text

if TYPE_CHECKING:
    from discrepancy.stages.stage import Stage

__all__ = ["Trend", "parameter_trends"]

MIN_RECORDS = 3  # of two, a trend and a difference are the same


@dataclass(frozen=True, kw_only=True)
class Trend:
    """A parameter that changes along the records.

    Parameters
    ----------
    parameter, unit : str
    change, std : float
        From the first record to the last, and its standard deviation.
    p : float
        Family-wise over all parameters.
    share : float
        Of the residual's energy that it explains.
    """

    parameter: str
    unit: str
    change: float
    std: float
    p: float
    share: float

    @property
    def sentence(self) -> str:
        """What changes, and what to do."""
        return (
            f"{self.parameter} changes along the records, by {quantity_text(self.change, self.unit, 2)} ± "
            f"{quantity_text(self.std, self.unit, 1)} from the first to the last (p = {self.p:.1g}): something may "
            "wear, warm up or have been changed. Fit the first and the last records apart to see it."
        )

    def to_dict(self) -> dict[str, Any]:
        """Return it as it stands in diagnosis.json."""
        return asdict(self)


def parameter_trends(stage: Stage, level: float, seed: int) -> tuple[Trend, ...]:
    """Return the parameters whose change along the records explains the residual of a stage, the largest share first.

    Parameters
    ----------
    stage : Stage
        With its parameters fitted.
    level : float
        Family-wise significance level of the study; trends are tested at one of its shares.
    seed : int
    """
    from discrepancy.statistics.scan import scan

    problem = stage.weighted_problem()
    residual, sens = problem.residual(), problem.sensitivities()
    count = len(residual.blocks)
    if count < MIN_RECORDS or not sens.names:
        return ()
    along = np.linspace(-0.5, 0.5, count)
    candidates = [
        Candidate(
            kind="trend",
            where=name,
            sensitivities=(tuple(t * F[:, :, k : k + 1] for t, F in zip(along, sens.blocks, strict=True)),),
        )
        for k, name in enumerate(sens.names)
    ]
    floor = [stage.noise[c] for c in residual.channels]
    trends = scan(residual, sens, candidates, level=level / LEVEL_SHARES, seed=seed, whiten=False, noise_floor=floor)
    units = {q.name: q.unit for q in stage.identify.parameters}
    return tuple(
        Trend(
            parameter=r.where,
            unit=units[r.where],
            change=float(np.ravel(r.expected_strength)[0]),
            std=float(np.ravel(r.standard_error)[0]),
            p=min(1.0, LEVEL_SHARES * float(r.p_value)),
            share=float(r.error_reduction),
        )
        for r in sorted(trends.rows, key=lambda r: -r.error_reduction)
        if r.verdict is Verdict.MISSING
    )
