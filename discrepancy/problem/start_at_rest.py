"""Records that seem to start at rest, elsewhere than their start values say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.problem.start_states import at_rest
from multibody.base.errors import SimulationError

if TYPE_CHECKING:
    from estimation.response.experiment import Experiment
    from multibody.machine.model import System

__all__ = ["start_at_rest"]

#: Error of an output, by its spread, from which the start is looked at, and the share of the mean squares that may be
#: left where the machine starts at rest in its place, both without what is constant, as a wrong zero is; chosen.
FAR_START, BETTER = 0.2, 0.25


@dataclass(frozen=True, eq=False, kw_only=True)
class StartAtRest:
    """A record that its model follows far better from rest than from the record's start values.

    Parameters
    ----------
    rest : Experiment
        The record, starting at rest.
    moved : dict of str to (float, float)
        Start values of every position as they are and at rest, SI.
    before, after : ndarray, shape (n_channels,)
        Root mean square errors from the start values and from rest, SI.
    """

    rest: Experiment
    moved: dict[str, tuple[float, float]]
    before: np.ndarray
    after: np.ndarray


def start_at_rest(e: Experiment, system: System, p: np.ndarray, modelled: np.ndarray) -> StartAtRest | None:
    """Return where a record starts at rest if the model follows it far better from there; None where it does not.

    Positions that were not recorded move first, then all, then everything else with them.

    Parameters
    ----------
    e : Experiment
    system : System
    p : ndarray, shape (n_p,)
    modelled : ndarray, shape (n, n_channels)
        Its outputs from the start values as they are.
    """
    size = np.maximum(e.measured.std(axis=0), 1e-300)
    before = modelled - e.measured
    if not np.any(before.std(axis=0) > FAR_START * size):
        return None
    places = [system.state_names[k] for k in system.rate_states]
    guessed = [n for n in places if n not in e.outputs]
    for states, whole in ((guessed, False), (places, False), (places, True)):
        try:
            rest = at_rest(e, system, states, p, whole=whole)
            after = rest.simulate(system, p) - e.measured
        except SimulationError:
            continue
        if np.sum((after.std(axis=0) / size) ** 2) < BETTER * np.sum((before.std(axis=0) / size) ** 2):
            begun, resting = e.start_vector(system), rest.start_vector(system)
            at = {n: system.index("state", n) for n in places}
            moved = {n: (float(begun[k]), float(resting[k])) for n, k in at.items()}
            return StartAtRest(rest=rest, moved=moved, before=_size(before), after=_size(after))
    return None


def _size(error: np.ndarray) -> np.ndarray:
    """Return the root mean square of every output's error, (n_channels,)."""
    size: np.ndarray = np.sqrt(np.mean(error**2, axis=0))
    return size
