"""The latest model of a study with other values of its parameters, simulated on one record."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from discrepancy.stages.stage import Stage
from multibody.base.spelling import nearest

__all__ = ["simulate_with"]


def simulate_with(stage: Stage, values: Mapping[str, float], record: str) -> np.ndarray:
    """Return the outputs of a stage's model on a record with other values of parameters, shape (n, n_outputs).

    Nothing is fitted: the record's own initial state and offsets stay as they were fitted.

    Parameters
    ----------
    stage : Stage
    values : mapping of str to float
        Parameters of the model by full name, SI.
    record : str

    Raises
    ------
    KeyError
        If there is no such record or parameter.
    SimulationError
        If the machine cannot be simulated with them.
    """
    fits = {f.experiment.name: f for part in ("identify", "validate") for f in stage.fits(part)}
    if record not in fits:
        raise KeyError(f"there is no record '{record}' in this study: take one of {', '.join(fits)}")
    fit, system, p = fits[record], stage.slim, stage.p.copy()
    for name, value in values.items():
        if name not in system.parameter_names:
            raise KeyError(f"the model has no parameter '{name}'{nearest(name, list(system.parameter_names))}")
        p[system.index("parameter", name)] = value
    x0 = fit.experiment.start_vector(system)
    for name in fit.experiment.free:
        x0[system.index("state", name)] = fit.own[name]
    y = fit.experiment.simulate(system, p, x0, stage.sensors)
    for column, name in enumerate(fit.experiment.outputs):
        y[:, column] += fit.own.get(f"offset of {name}", 0.0)
    return y
