"""Where a machine is linearised: along its motion under the likeliest course of the forces that nobody recorded.

The marginal likelihood is that of a linearised machine, and Laplace's approximation asks for the linearisation where
everything uncertain is likeliest, the random forces among it.  Along the motion without them dry friction holds a
part that really moved, and a play is open that was closed: what the likelihood then says of an effect depends by
hundreds of nats on the parameters.  So the forces are smoothed, the machine is simulated with them and linearised
there, until they no longer change: the iterated Kalman smoother, a Gauss-Newton method for the likeliest motion.

Source: Bell (1994), SIAM Journal on Optimization 4, 626 (the iterated Kalman smoother as a Gauss-Newton method).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from discrepancy.evidence.linearised_records import linear_records, what_may_act
from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.standstill import standstill_at
from discrepancy.innovations.linear_record import LinearRecord
from discrepancy.innovations.noise_model import InnovationWeighting, NoiseModel, innovation_weighting
from discrepancy.sensitivities.linearised_problem import LinearisedProblem
from multibody.base.errors import SimulationError

__all__ = ["Forces", "along_forces", "linearisation_error", "settled"]

#: What acted on inputs of the model along a record and was not recorded: name of the input to (nt,).
Forces = Mapping[str, np.ndarray]
#: Linearisations that are tried, at most, and by how much each full step must bring that down: where friction sticks
#: and lets go from sample to sample no linearisation holds, and what converges takes two or three.
ROUNDS, SLOW = 6, 0.5
#: Shares of the way to the likeliest forces that are tried, and the share of its own size by which the change of the
#: outputs along it may be off; chosen, a step that is half wrong still leads nearer.
SHARES, TRUST = (1.0, 0.5, 0.25, 0.125), 0.5


def along_forces(linearised: LinearisedProblem, forces: Sequence[Forces]) -> LinearisedProblem:
    """Return a problem linearised along the motion under some forces, one mapping for each record; none: as it is."""
    if not forces:
        return linearised
    fits = linearised.calibration.fits
    pushed = tuple(replace(f, experiment=f.experiment.with_forces(own)) for f, own in zip(fits, forces, strict=True))
    return linearised.with_calibration(replace(linearised.calibration, fits=pushed))


def linearisation_error(linearised: LinearisedProblem, records: Sequence[LinearRecord], model: NoiseModel) -> float:
    """Return the nats by which the linearised outputs are off along the likeliest forces."""
    return _Linearisation(linearised, tuple(records), model).error


def settled(
    linearised: LinearisedProblem, records: Sequence[LinearRecord], model: NoiseModel, left_out: Sequence[np.ndarray]
) -> tuple[LinearisedProblem, tuple[LinearRecord, ...]] | None:
    """Return a machine linearised along its likeliest motion under a noise model; None where it is so already.

    Parameters
    ----------
    linearised : LinearisedProblem
    records : sequence of LinearRecord
        Of it.
    model : NoiseModel
    left_out : sequence of ndarray of bool, shape (n,)
        Samples of every record that do not count.
    """
    here = best = _Linearisation(linearised, tuple(records), model)
    share = 1.0
    for tried in range(1, ROUNDS + 1):
        slow = here is not best and share == 1.0 and not here.error <= SLOW * best.error
        if here.error < best.error:
            best = here
        if best.error <= POLICY.improvement or slow or tried == ROUNDS:
            break
        step = here.step()
        if step is None:
            break
        share, there = step
        try:
            here = _Linearisation(there, linear_records(there, left_out), model)
        except SimulationError:
            break
    return None if best.linearised is linearised else (best.linearised, best.records)


@dataclass(frozen=True, eq=False)
class _Linearisation:
    """A linearised machine, its records and a noise model."""

    linearised: LinearisedProblem
    records: tuple[LinearRecord, ...]
    model: NoiseModel

    @cached_property
    def error(self) -> float:
        """Nats by which the linearised outputs are off along the likeliest forces."""
        return self._off(1.0, self._at(1.0)) if self._columns else 0.0

    def step(self) -> tuple[float, LinearisedProblem] | None:
        """Return the problem along the forces the largest share of the way on that holds, and that share."""
        size = self._size(self._change)
        for share in SHARES:
            there = self._at(share)
            if self._off(share, there) <= (TRUST * share) ** 2 * size:
                return share, there
        return None

    @cached_property
    def _weighting(self) -> list[InnovationWeighting]:
        return [innovation_weighting(record, self.model) for record in self.records]

    @cached_property
    def _columns(self) -> dict[int, int]:
        """For each process that is a force at a connection, which connection."""
        acting = what_may_act(self.linearised)
        connections, at_standstill = len(acting.connections), sum(map(len, acting))
        columns = {}
        for k, process in enumerate(self.model.processes):
            if 0 <= process.source < connections:
                columns[k] = process.source
            elif process.source >= at_standstill:
                columns[k] = process.source - at_standstill
        return columns

    @cached_property
    def _now(self) -> list[np.ndarray]:
        """The forces along which the machine is linearised, (N, n_connections) for each record."""
        raw = [e.record.time for e in self.linearised.experiments]
        return [
            np.column_stack(
                [np.interp(r.time, t, e.forces[n]) if n in e.forces else np.zeros(r.time.size) for n in self._names]
            )
            for r, t, e in zip(self.records, raw, self.linearised.experiments, strict=True)
        ]

    @property
    def _names(self) -> list[str]:
        return [f"probe.{name}" for name in what_may_act(self.linearised).connections]

    @cached_property
    def _likeliest(self) -> list[np.ndarray]:
        """The likeliest forces, every parameter as it is, (N, n_connections) for each record."""
        times = [r.time for r in self.records]
        still = {
            j: standstill_at(self.linearised, j, times)
            for k, j in self._columns.items()
            if self.model.processes[k].at_standstill
        }
        forces = []
        for i, (record, weighting) in enumerate(zip(self.records, self._weighting, strict=True)):
            courses = weighting.courses(weighting(self.linearised.residual().blocks[i]))
            force = np.zeros((record.time.size, len(self._names)))
            for k, j in self._columns.items():
                force[:, j] += courses[:, k] * (still[j][i] if self.model.processes[k].at_standstill else 1.0)
            forces.append(force)
        return forces

    @cached_property
    def _change(self) -> list[np.ndarray]:
        """What the whole step changes in the outputs of each record, to first order, (n, n_channels)."""
        columns = np.arange(len(self._names))
        return [
            np.sum(record.response(new - old, columns), axis=2)[record.observed]
            for record, old, new in zip(self.records, self._now, self._likeliest, strict=True)
        ]

    def _at(self, share: float) -> LinearisedProblem:
        """Return the problem some share of the way on to the likeliest forces."""
        forces = []
        for i, (record, old, new) in enumerate(zip(self.records, self._now, self._likeliest, strict=True)):
            raw, values = np.asarray(self.linearised.experiments[i].record.time), old + share * (new - old)
            forces.append(
                {n: np.interp(raw, record.time, v) for n, v in zip(self._names, values.T, strict=True) if np.any(v)}
            )
        return along_forces(self.linearised, forces)

    def _off(self, share: float, there: LinearisedProblem) -> float:
        """Return the nats by which what the step changes to first order is off."""
        try:
            moved = [there.simulated(i) - self.linearised.simulated(i) for i in range(len(self.records))]
        except SimulationError:
            return np.inf
        return self._size([m - share * change for m, change in zip(moved, self._change, strict=True)])

    def _size(self, blocks: Sequence[np.ndarray]) -> float:
        """Return the nats that changes of the outputs, (n, n_channels) for each record, amount to."""
        white = (weighting(block) for weighting, block in zip(self._weighting, blocks, strict=True))
        return 0.5 * sum(float(np.sum(w**2)) for w in white)
