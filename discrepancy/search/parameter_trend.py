"""Parameters that change along the records: wear, warming, another tool, which no effect in the machine explains.

A calibrated value is that of all records together.  Where it was smaller in the first and larger in the last, what is
left of both has the same fingerprint with opposite signs: the parameter's own sensitivity, times the place of the
record, or of the window of one, in the order of the study.  It is judged by the same scan as effects, against the same
luck, and told, not added.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.search.step import LOOKS
from discrepancy.statistics.blocks import Candidate
from discrepancy.statistics.verdicts import Verdict
from multibody.base.quantity_text import quantity_text

if TYPE_CHECKING:
    from discrepancy.stages.stage import Stage

__all__ = ["Trend", "parameter_trends"]

FEWEST = 3  # records: of two, a change and a difference are the same


@dataclass(frozen=True)
class Trend:
    """A parameter that changes along the records.

    Parameters
    ----------
    parameter, unit : str
    change, std : float
        From the first record to the last, and its deviation.
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
    """Return the parameters whose change along the records explains what a stage leaves, the surest first.

    Parameters
    ----------
    stage : Stage
        With its parameters fitted.
    level : float
        Family-wise level of what a study names; trends are told at the share of one look, beside it.
    seed : int
    """
    from discrepancy.statistics.scan import scan

    facts = stage.weighted_problem()
    residual, sens = facts.residual(), facts.sensitivities()
    count = len(residual.blocks)
    if count < FEWEST or not sens.names:
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
    found = scan(residual, sens, candidates, level=level / LOOKS, seed=seed, whiten=False, noise_floor=floor)
    units = {q.name: q.unit for q in stage.identify.parameters}
    return tuple(
        Trend(
            r.where, units[r.where], float(np.ravel(r.expected_strength)[0]), float(np.ravel(r.standard_error)[0]),
            min(1.0, LOOKS * float(r.p_value)), float(r.error_reduction),
        )
        for r in sorted(found.rows, key=lambda r: -r.error_reduction)
        if r.verdict is Verdict.MISSING
    )  # fmt: skip
