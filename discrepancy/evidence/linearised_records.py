"""A machine linearised along its records, for the likelihood: what may act on it, residual and sensitivities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from discrepancy.evidence.standstill import places_that_stick, standstill_at
from discrepancy.innovations.fewer_states import with_fewer_states
from discrepancy.innovations.linear_record import LinearRecord, linear_record
from discrepancy.innovations.noise_fit import RecordColumns
from discrepancy.sensitivities.linearised_problem import LinearisedProblem
from multibody.base.parallel import parallel_map

__all__ = [
    "linear_records",
    "lost_to_means",
    "noise_floor",
    "record_columns",
    "steady_reach",
    "what_may_act",
    "with_columns",
]

#: States of a linearised record from which it is asked whether fewer would do: below, the filter's time is not theirs.
MOST_STATES = 10
SHOWN = 3  # records from which it is worked out how far a force moves the outputs: an order of magnitude is enough


class Acting(NamedTuple):
    """What latent processes may be added to, in the order of a record's columns."""

    connections: list[str]
    inputs: list[str]
    states: list[str]


def what_may_act(linearised: LinearisedProblem) -> Acting:
    """Return the connections, the recorded inputs that the machine has, and the states whose rates may be disturbed.

    A machine without connections, such as one of heat and water written as equations, has no other place for what
    nobody recorded: a sensor whose reading is off does not remember, and a tank does.
    """
    recorded = [n for n in linearised.experiments[0].inputs if n in linearised.slim.input_names]
    connections = [place.name for place in linearised.system.places]
    return Acting(connections, recorded, [] if connections else _with_equations_of_their_own(linearised))


def _with_equations_of_their_own(linearised: LinearisedProblem) -> list[str]:
    """Return the states but those that are the integral of another, as a position is of a speed."""
    system, p = linearised.slim, linearised.p
    starts = [linearised.initial_state(i) for i in range(len(linearised.experiments))]
    jacobians = [system.jacobian("x", 0.0, x, None, p) for x in starts]
    names = [q.name for q in system.states]

    def is_integral(i: int) -> bool:
        j = int(np.argmax(jacobians[0][i]))
        row = np.eye(len(names))[j]
        return j != i and all(
            np.array_equal(jacobian[i], row) and system.rhs(0.0, x, None, p)[i] == x[j]
            for jacobian, x in zip(jacobians, starts, strict=True)
        )

    return [name for i, name in enumerate(names) if not is_integral(i)]


def linear_records(linearised: LinearisedProblem, left_out: Sequence[np.ndarray]) -> tuple[LinearRecord, ...]:
    """Return the machine linearised along every record, with the random forces that dry friction makes at a standstill.

    Parameters
    ----------
    linearised : LinearisedProblem
    left_out : sequence of ndarray of bool, shape (n,)
        Samples of every record that do not count.
    """
    acting = what_may_act(linearised)
    channels = [*(f"probe.{name}" for name in acting.connections), *acting.inputs]

    def of(i: int) -> LinearRecord:
        start = linearised.initial_state(i)
        return linear_record(linearised.experiments[i], linearised.slim, linearised.p, start, channels, acting.states)

    records = [r.without(mask) for r, mask in zip(parallel_map(of, range(len(left_out))), left_out, strict=True)]
    sticking = places_that_stick(linearised)
    times = [r.time for r in records]
    still = {place: standstill_at(linearised, place, times) for place in sticking}
    # one further input for every place, so that models with different frictions count their inputs alike
    places = range(len(linearised.system.places))

    def weights(i: int) -> list[np.ndarray]:
        return [still[p][i] if p in still else np.zeros(times[i].size) for p in places]

    whole = [r.with_modulated(places, weights(i)) for i, r in enumerate(records)]
    if whole[0].phi.shape[1] <= MOST_STATES:
        return tuple(whole)
    noise = noise_floor(linearised)
    return tuple(parallel_map(lambda r: with_fewer_states(r, noise), whole))


def record_columns(
    linearised: LinearisedProblem,
    records: Sequence[LinearRecord],
    without: Sequence[str] = (),
) -> tuple[list[RecordColumns], np.ndarray, np.ndarray]:
    """Return residual and sensitivities of every record, and the priors of the shared parameters.

    Parameters
    ----------
    linearised : LinearisedProblem
        Unweighted.
    records : sequence of LinearRecord
    without : sequence of str
        Parameters that stay at their values.

    Returns
    -------
    columns : list of RecordColumns
    prior_std, prior_offset : ndarray
    """
    residual, sens = linearised.residual(), linearised.sensitivities()
    moved = [k for k, n in enumerate(sens.names) if n not in without]
    spread = _spread(linearised)
    columns = []
    for i, record in enumerate(records):
        own = sens.nuisance[i]
        columns.append(
            RecordColumns(
                record=record,
                residual=residual.blocks[i],
                shared=sens.blocks[i][:, :, moved],
                own=np.zeros((*residual.blocks[i].shape, 0)) if own is None else own,
                spread=spread,
            )
        )
    return columns, sens.prior_std[moved], sens.prior_offset[moved]


def with_columns(columns: Sequence[RecordColumns], more: Sequence[np.ndarray]) -> list[RecordColumns]:
    """Return records with further shared columns."""
    return [replace(c, shared=np.concatenate([c.shared, m], axis=2)) for c, m in zip(columns, more, strict=True)]


def noise_floor(linearised: LinearisedProblem) -> np.ndarray:
    """Return the standard deviation of the noise of each prepared output, SI."""
    given = linearised.preparation
    count = given.average * given.decimate
    channels = linearised.residual().channels
    noise = np.array([linearised.noise.get(c, 0.0) for c in channels])
    return np.maximum(noise / np.sqrt(count), 1e-9 * _spread(linearised))


def lost_to_means(linearised: LinearisedProblem) -> np.ndarray:
    """Return the variance of white sensor noise that the means of several samples have lost, of each output, SI."""
    given = linearised.preparation
    lost: np.ndarray = noise_floor(linearised) ** 2 * (given.average * given.decimate - 1)
    return lost


def _spread(linearised: LinearisedProblem) -> np.ndarray:
    """Return the standard deviation of each prepared output over all records, SI."""
    return np.maximum(np.std(np.concatenate([e.measured for e in linearised.experiments]), axis=0), 1e-300)


def steady_reach(records: Sequence[LinearRecord], noise: np.ndarray) -> np.ndarray:
    """Return how far a steady unit of each source moves the output that it moves most, in noise.

    The median over the samples that it moves at all: where dry friction lets go, a small force moves the machine
    without bound in the linearised problem, for a moment.
    """
    moves = []
    for record in records[:SHOWN]:
        moved = record.response(np.ones((record.time.size, record.gamma0.shape[2])))
        moves.append(np.abs(moved[record.counts]) / noise[:, None])
    every = np.concatenate(moves)
    every[~np.isfinite(every) | (every == 0.0)] = np.nan
    reach = np.zeros(every.shape[1:])
    shown = ~np.all(np.isnan(every), axis=0)
    reach[shown] = np.nanmedian(every[:, shown], axis=0)
    largest: np.ndarray = np.max(reach, axis=0)
    return largest
