"""What the machines of a fleet say about each other: priors, thresholds, and who lies outside."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from operation.follow.watch import MachineState
from operation.statistics.fleet_level import FleetPrior, fleet_prior, outliers, share_level

__all__ = ["FleetQuantity", "fleet_priors", "fleet_view"]

#: Machines from which a fleet says something.
FEWEST = 5


@dataclass(frozen=True, kw_only=True)
class FleetQuantity:
    """A quantity over the fleet.

    Parameters
    ----------
    name, unit : str
    prior : FleetPrior
    level : float
        That a share of the machines does not exceed (Fig. 10's rule), with its 95 % interval.
    interval : (float, float)
    share : float
    outside : tuple of (str, float)
        Machines that lie outside of the rest, with their distance in standard deviations.
    """

    name: str
    unit: str
    prior: FleetPrior
    level: float
    interval: tuple[float, float]
    share: float
    outside: tuple[tuple[str, float], ...]


def fleet_view(states: Mapping[str, MachineState], share: float = 0.7) -> dict[str, FleetQuantity]:
    """Return what the fleet says of every parameter and feature that at least five machines have.

    Parameters
    ----------
    states : mapping of str to MachineState
        By machine.
    share : float
        Of the machines that the threshold covers; the paper takes 0.7.
    """
    names = dict.fromkeys(n for s in states.values() for n, t in s.traces.items() if t.level is not None)
    quantities = {}
    for name in names:
        own = {m: s.traces[name] for m, s in states.items() if name in s.traces}
        now = {m: t.now for m, t in own.items() if math.isfinite(t.now[1])}
        if len(now) < FEWEST:
            continue
        machines = list(now)
        values, stds = (np.array([now[m][k] for m in machines]) for k in (0, 1))
        level, interval = share_level(values, share)
        quantities[name] = FleetQuantity(
            name=name,
            unit=next(iter(own.values())).unit,
            prior=fleet_prior(values, stds),
            level=level,
            interval=interval,
            share=share,
            outside=tuple((machines[k], away) for k, away in outliers(values, stds)),
        )
    return quantities


def fleet_priors(states: Mapping[str, MachineState]) -> dict[str, tuple[float, float]]:
    """Return the prior of the next machine's parameters: mean over the fleet and spread with the error of the mean."""
    return {n: (q.prior.mean, q.prior.std) for n, q in fleet_view(states).items()}
