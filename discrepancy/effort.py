"""How long a simulation of a trial may take: an explanation that brings the machine to a standstill is a bad one."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from discrepancy.setup import Setup

__all__ = ["TIMES", "bounded_effort"]

TIMES = 100  # what the model as given takes, before a simulation is given up
LEAST = 100_000  # evaluations that are always allowed: a model at rest takes next to none


def bounded_effort(setup: Setup) -> Setup:
    """Return a setup whose experiments give up a simulation that takes a hundred times the model as given.

    Friction that locks a drive against its own load, or a spring a million times too stiff, can make a simulation take
    hours.  A model that cannot be simulated as given gets no bound: what is wrong with it is told where it is used.

    Parameters
    ----------
    setup : Setup
    """
    from multibody.errors import SimulationError

    records = [*setup.identify, *setup.validate]
    system = setup.model.build(probes=True, outputs=records[0].outputs)
    p = system.parameter_vector({q.name: q.value for q in setup.uncertain})
    bounded = []
    for experiment in records:
        try:
            taken = experiment.respond(system, p).evaluations
        except SimulationError:
            return setup
        bounded.append(replace(experiment, max_evaluations=TIMES * taken + LEAST))
    count = len(setup.identify)
    return replace(setup, identify=tuple(bounded[:count]), validate=tuple(bounded[count:]))
