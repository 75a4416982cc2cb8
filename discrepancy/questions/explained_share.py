"""How much of the error that recalibration left is gone."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.stages.stage import Stage

if TYPE_CHECKING:
    from discrepancy.report.conclusion import Conclusion

__all__ = ["explained", "explained_by_output"]


def explained(conclusion: Conclusion) -> tuple[float, float]:
    """Return the share of the recalibrated baseline's error above the noise floor that is gone.

    Outputs are added in units of their noise floor, because a newton cannot be added to a metre.  So an
    output that stood far above its noise counts for more than one that was near it.

    Returns
    -------
    energy, rms : float
        As share of the mean square (the figure ``explained``), and of its root.  Zero where the baseline has
        no error above noise; negative where the error has grown.
    """
    before, after = (
        sum(_excess(s, conclusion.judged_on).values()) for s in (conclusion.baseline, conclusion.final)
    )
    if before <= 0.0:
        return 0.0, 0.0
    return 1.0 - after / before, 1.0 - math.sqrt(after / before)


def explained_by_output(conclusion: Conclusion) -> dict[str, float | None]:
    """Return that share of the mean square for each output alone; None where nothing was to explain."""
    before, after = (_excess(s, conclusion.judged_on) for s in (conclusion.baseline, conclusion.final))
    return {n: 1.0 - after[n] / before[n] if before[n] > 0.0 else None for n in before}


def _excess(stage: Stage, part: str) -> dict[str, float]:
    """Mean square above the noise floor, in units of the floor (of the signal, where none is known)."""
    found = {}
    fits = stage.fits(part)
    for column, (name, rmse) in enumerate(stage.rmse(part).items()):
        noise = stage.noise.get(name, 0.0)
        spread = float(np.std(np.concatenate([f.experiment.measured[:, column] for f in fits])))
        unit = noise if noise > 0.0 else spread or 1.0
        found[name] = max(0.0, rmse**2 - noise**2) / unit**2
    return found
