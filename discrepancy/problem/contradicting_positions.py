"""Recorded positions that contradict each other where a machine is at rest.

Positions come from encoders that were set to zero, from integrated speeds, from what somebody measured once.  Where a
stiff machine is at rest such positions must agree to a fraction of a millimetre: a rope that is half a millimetre too
long is slack.  If they do not, their zeros are not known, and what depends on the difference of two of them, such as a
stiffness, must not be fitted to it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.problem.problem import Problem, noise_floors
from discrepancy.problem.start_at_rest import start_at_rest
from multibody.base.errors import SimulationError

if TYPE_CHECKING:
    from estimation.response.experiment import Experiment
    from multibody.machine.model import System

__all__ = ["contradicting_positions", "contradiction_text", "with_own_zeros"]

#: Probability with which recorded positions that agree are said to contradict each other, by the noise of their first
#: samples.  Chosen: no more than one study in ten thousand.
LEVEL = 1e-4
#: Steps of Newton's method, which begins at rest and has hardly any way to go, and the least singular value, relative,
#: that is more than rounding; chosen.
STEPS, LEAST_SHARE = 3, 1e-10


def contradicting_positions(problem: Problem) -> tuple[str, ...]:
    """Return the recorded positions that contradict each other where the records start at rest.

    All whose start is estimated, if there are two or more, and if the records that start at rest, judged by the motion
    that follows, could not do so within the noise of these positions: which of them is off cannot be known.
    """
    from scipy.stats import chi2

    system = problem.model.build(outputs=problem.identify[0].outputs)
    p = system.parameter_vector({q.name: q.value for q in problem.uncertain})
    places = {system.state_names[k] for k in system.rate_states}
    recorded = [n for n in problem.identify[0].outputs if n in places]
    recorded = [n for n in recorded if all(n in e.free and n not in e.offsets for e in problem.identify)]
    if len(recorded) < 2 or any(e.at_own_instants for e in problem.identify):
        return ()
    floors = noise_floors(problem.identify, problem.noise)
    noise = {n: floors[n] for n in recorded}
    known = {q.name: q.std for q in problem.uncertain if np.isfinite(q.std) and q.name in system.parameter_names}

    squares = []
    for e in problem.identify:
        try:
            start = start_at_rest(e, system, p, e.simulate(system, p))
            if start is not None:
                squares.append(_distance_from_rest(e, start.rest, system, p, noise, known) ** 2)
        except (SimulationError, np.linalg.LinAlgError):
            return ()
    # of the changes no more than one for each position is free to be what it is
    return tuple(recorded) if sum(squares) > chi2.isf(LEVEL, max(len(squares) * len(recorded), 1)) else ()


def _distance_from_rest(
    e: Experiment,
    rest: Experiment,
    system: System,
    p: np.ndarray,
    noise: Mapping[str, float],
    known: Mapping[str, float],
) -> float:
    """Return the least change of recorded positions and stated parameters with which a record starts at rest.

    In standard deviations, the root of the sum of squares.  Positions that were not recorded, and what else is
    estimated of the start, may be anything.  By Newton's method, which begins where the machine is at rest: from where
    it was recorded a rope may be slack, which feels nothing.

    Parameters
    ----------
    e, rest : Experiment
        As recorded, and starting at rest.
    system : System
    p : ndarray, shape (n_p,)
    noise : mapping of str to float
        Standard deviation of every recorded position, SI.
    known : mapping of str to float
        The same of what is stated of parameters.
    """
    recorded, x, p = e.start_vector(system), rest.start_vector(system), p.copy()
    u = e.table(system)(float(e.record.time[0]), p).ravel()
    speeds = list(system.rate_states.values())
    positions = [system.index("state", n) for n in noise]
    parameters = [system.index("parameter", n) for n in known]
    size = np.array([*noise.values(), *known.values()])
    free = [k for k in system.rate_states if k not in positions]
    free += [k for n in e.free if (k := system.index("state", n)) not in (*system.rate_states, *speeds)]
    stated = np.concatenate([recorded[positions], p[parameters]])
    moved = (np.concatenate([x[positions], p[parameters]]) - stated) / size
    for _ in range(STEPS):
        rates = system.rhs(0.0, x, u, p)[speeds]
        by_state = system.jacobian("x", 0.0, x, u, p)[speeds]
        by_parameter = system.jacobian("p", 0.0, x, u, p)[speeds][:, parameters]
        slopes = np.concatenate([by_state[:, positions], by_parameter], axis=1) * size
        moved, change = _least_change(slopes, by_state[:, free], slopes @ moved - rates)
        x[free] += change
        x[positions], p[parameters] = np.split(stated + size * moved, [len(positions)])
    return float(np.linalg.norm(moved))


def _least_change(slopes: np.ndarray, free: np.ndarray, left: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the smallest y, and any z, for which ``slopes @ y + free @ z`` is what is left."""
    scale = np.maximum(np.linalg.norm(free, axis=0), 1e-300)
    basis, singular, turned = np.linalg.svd(free / scale, full_matrices=False)
    kept = singular > LEAST_SHARE * singular.max(initial=1e-300)
    basis, singular, turned = basis[:, kept], singular[kept], turned[kept]

    def beside(columns: np.ndarray) -> np.ndarray:
        out: np.ndarray = columns - basis @ (basis.T @ columns)
        return out

    y = np.linalg.lstsq(beside(slopes), beside(left), rcond=LEAST_SHARE)[0]
    z = turned.T @ ((basis.T @ (left - slopes @ y)) / singular) / scale
    return y, z


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
