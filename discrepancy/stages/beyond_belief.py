"""Errors so large that no comparison with the records means anything: such a model is refused."""

from __future__ import annotations

import numpy as np

from discrepancy.stages.stage import Stage
from multibody.base.quantity_text import unit_text

__all__ = ["beyond_belief"]

_LARGEST = 1e5
"""Of the largest value that was recorded in the same unit: more than a logger with 16 bits tells apart."""


def beyond_belief(stage: Stage) -> str:
    """Return in a sentence which output of a fitted stage is off by orders of magnitude; empty where none is."""
    experiments = [fit.experiment for fit in stage.fits("identify")]
    unit = {n: stage.system.unit(n) for n in stage.outputs}
    largest: dict[str, float] = {}
    for e in experiments:
        for c, name in enumerate(e.outputs):
            largest[unit[name]] = max(largest.get(unit[name], 0.0), float(np.max(np.abs(e.measured[:, c]))))
        for name in e.inputs:
            signal = e.record.signals[name]
            largest[signal.unit] = max(largest.get(signal.unit, 0.0), float(np.max(np.abs(signal.values))))
    errors = stage.rmse("identify")
    for name in stage.outputs:
        size = largest[unit[name]]
        if size > 0.0 and not errors[name] < _LARGEST * size:
            of = unit_text(unit[name])
            return (
                f"'{name}': the error after calibration is {errors[name]:.3g} {of}, and the largest value recorded in "
                f"this unit is {size:.3g} {of}: no comparison with these records can be believed. A parameter, a unit "
                "or a sign of the model is wrong by orders of magnitude, or the model is unstable: correct it there; "
                "vtsdt check shows a record beside its simulation"
            )
    return ""
