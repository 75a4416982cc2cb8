"""Records that seem to start at rest, elsewhere than they say, and recorded positions that contradict each other there.

Positions come from encoders that were set to zero, from integrated speeds, from what somebody measured once.  Where a
stiff machine is at rest such positions must agree to a fraction of a millimetre: a rope that is half a millimetre too
long is slack.  If they do not, their zeros are not known, and what depends on the difference of two of them, such as a
stiffness, must not be fitted to it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.problem.problem import Problem, noise_floors
from discrepancy.problem.start_states import at_rest
from multibody.base.errors import SimulationError

if TYPE_CHECKING:
    from estimation.response.experiment import Experiment
    from multibody.machine.model import System

__all__ = ["StartAtRest", "contradicting_positions", "contradiction_text", "start_at_rest", "with_own_zeros"]

#: Error of an output, by its spread, from which the start is looked at, and the share of the mean squares that may be
#: left where the machine starts at rest in its place, both without what is constant, as a wrong zero is; chosen.
FAR_START, BETTER = 0.2, 0.25
#: Standard deviations of its noise by which a recorded position must differ from the one at rest, and the share of the
#: records in which one must, before the positions contradict each other: the first sample of one record may be off by
#: chance.  Chosen.
BEYOND_NOISE, MOST_RECORDS = 3.0, 0.5


@dataclass(frozen=True, eq=False, kw_only=True)
class StartAtRest:
    """A record that its model follows far better from rest than from the record's start values.

    Parameters
    ----------
    moved : dict of str to (float, float)
        Start values of every position as they are and at rest, SI.
    before, after : ndarray, shape (n_channels,)
        Root mean square errors from the start values and from rest, SI.
    """

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
            return StartAtRest(moved=moved, before=_size(before), after=_size(after))
    return None


def _size(error: np.ndarray) -> np.ndarray:
    """Return the root mean square of every output's error, (n_channels,)."""
    size: np.ndarray = np.sqrt(np.mean(error**2, axis=0))
    return size


def contradicting_positions(problem: Problem) -> tuple[str, ...]:
    """Return the recorded positions that contradict each other where the records start at rest.

    All whose start is estimated, if there are two or more, and if in most records for identification the machine rests
    farther from one of them than noise moves its first sample: which of them is off cannot be known.
    """
    system = problem.model.build(outputs=problem.identify[0].outputs)
    p = system.parameter_vector({q.name: q.value for q in problem.uncertain})
    places = {system.state_names[k] for k in system.rate_states}
    recorded = [n for n in problem.identify[0].outputs if n in places]
    recorded = [n for n in recorded if all(n in e.free and n not in e.offsets for e in problem.identify)]
    if len(recorded) < 2 or any(e.at_own_instants for e in problem.identify):
        return ()
    noise, contradict = noise_floors(problem.identify, problem.noise), 0
    for e in problem.identify:
        try:
            start = start_at_rest(e, system, p, e.simulate(system, p))
        except SimulationError:
            return ()
        if start is not None:
            contradict += any(abs(b - a) > BEYOND_NOISE * noise[n] for n in recorded for a, b in [start.moved[n]])
    return tuple(recorded) if contradict >= MOST_RECORDS * len(problem.identify) else ()


def with_own_zeros(problem: Problem, outputs: tuple[str, ...]) -> Problem:
    """Return a problem in which outputs have an offset of their own in every record."""
    identify, validate = (
        tuple(replace(e, offsets=(*e.offsets, *(n for n in outputs if n not in e.offsets))) for e in part)
        for part in (problem.identify, problem.validate)
    )
    return replace(problem, identify=identify, validate=validate)


def contradiction_text(outputs: tuple[str, ...]) -> str:
    """Return in two sentences that recorded positions contradict each other, and what is done about it."""
    return (
        f"The recorded positions {', '.join(map(repr, outputs))} contradict each other where the records start at "
        "rest: the machine would be far from its equilibrium there. So the zero of each is estimated in every record, "
        "as if [offsets] named them."
    )
