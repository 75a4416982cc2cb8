"""Share of the error after recalibration that the effects remove."""

from __future__ import annotations

import math

import numpy as np

from discrepancy.stages.stage import Stage

__all__ = ["explained_by_output", "explained_share"]


def explained_share(baseline: Stage, final: Stage, part: str) -> tuple[float, float]:
    """Return the share of the baseline's error above the noise floor that the final stage has no more.

    Outputs are added in units of their noise floor, because a newton cannot be added to a metre.  So an output that was
    far above its noise counts for more than one that was near it.

    Parameters
    ----------
    baseline : Stage
        Recalibrated, without effects.
    final : Stage
    part : {"identify", "validate"}
        Records on which the errors are compared.

    Returns
    -------
    energy, rms : float
        As share of the mean square (the figure ``explained``), and of its root.  Zero where the baseline has no error
        above noise; negative where the error has grown.
    """
    before, after = (sum(_excess(s, part).values()) for s in (baseline, final))
    if before <= 0.0:
        return 0.0, 0.0
    return 1.0 - after / before, 1.0 - math.sqrt(after / before)


def explained_by_output(baseline: Stage, final: Stage, part: str) -> dict[str, float | None]:
    """Return that share of the mean square for each output alone; None where nothing was to explain."""
    before, after = (_excess(s, part) for s in (baseline, final))
    return {n: 1.0 - after[n] / before[n] if before[n] > 0.0 else None for n in before}


def _excess(stage: Stage, part: str) -> dict[str, float]:
    """Mean square above the noise floor, in units of the floor (of the signal, where none is known)."""
    excess = {}
    fits = stage.fits(part)
    for c, (name, rmse) in enumerate(stage.rmse(part).items()):
        noise = stage.noise.get(name, 0.0)
        spread = float(np.std(np.concatenate([f.experiment.measured[:, c] for f in fits])))
        unit = noise if noise > 0.0 else spread or 1.0
        excess[name] = max(0.0, rmse**2 - noise**2) / unit**2
    return excess
