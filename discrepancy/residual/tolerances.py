"""The tolerance and the largest number of evaluations of simulations, from the noise of the outputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.problem.problem import Problem, noise_floors
from multibody.base.errors import SimulationError

if TYPE_CHECKING:
    from estimation.response.experiment import Experiment
    from multibody.machine.model import System

__all__ = ["LEAST_EVALUATIONS", "tolerance", "with_tolerances"]

MOST_TIMES = 100  # evaluations of a simulation, over those of the model as given, before it is given up
LEAST_EVALUATIONS = 100_000  # that are always allowed: a model at rest takes next to none
LOOSER = (1e-4, 1e-5)  # relative tolerances that are tried instead of an experiment's own
NEGLIGIBLE = 1e-3  # share of an output's noise below which an error of integration does not matter


def with_tolerances(problem: Problem) -> Problem:
    """Return a problem whose experiments have the tolerance that their noise allows and a limit on evaluations.

    A simulation that takes a hundred times the evaluations of the model as given is given up: friction that locks a
    drive against its own load, or a spring a million times too stiff, can take hours.  A model that cannot be simulated
    as given gets no limit: its error is raised where it is used.

    Parameters
    ----------
    problem : Problem
    """
    records = [*problem.identify, *problem.validate]
    system = problem.model.build(probes=True, outputs=records[0].outputs)
    p = system.parameter_vector({q.name: q.value for q in problem.uncertain})
    try:
        runs = [e.respond(system, p) for e in records]
        rtol = tolerance(records, system, p, [r.outputs for r in runs], noise_floors(problem.identify, problem.noise))
    except SimulationError:
        return problem
    bounded = [
        replace(e, max_evaluations=MOST_TIMES * r.evaluations + LEAST_EVALUATIONS, rtol=max(rtol, e.rtol))
        for e, r in zip(records, runs, strict=True)
    ]
    count = len(problem.identify)
    return replace(problem, identify=tuple(bounded[:count]), validate=tuple(bounded[count:]))


def tolerance(
    records: Sequence[Experiment],
    system: System,
    p: np.ndarray,
    exact: Sequence[np.ndarray],
    noise: Mapping[str, float],
) -> float:
    """Return the loosest relative tolerance that changes no output by more than a thousandth of its noise.

    Parameters
    ----------
    records : sequence of Experiment
    system : System
    p : ndarray, shape (n_p,)
    exact : sequence of ndarray, shape (n, n_channels)
        Outputs of each record at its own tolerance.
    noise : mapping of str to float
        Noise floor of each output, SI; where it is zero the experiments' own tolerance stays.

    Returns
    -------
    float
        One of `LOOSER`, or 0.
    """
    allowed = NEGLIGIBLE * np.array([noise.get(n, 0.0) for n in records[0].outputs])
    for rtol in LOOSER:
        for e, y in zip(records, exact, strict=True):
            try:
                change = replace(e, rtol=rtol).simulate(system, p) - y
            except SimulationError:
                break
            if not np.all(np.sqrt(np.mean(change**2, axis=0)) <= allowed):
                break
        else:
            return rtol
    return 0.0
