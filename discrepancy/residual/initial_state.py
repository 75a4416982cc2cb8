"""The state of a machine along a record, estimated from its sensors: where fits of initial states begin."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.residual.signal_bandwidth import signal_bandwidth
from estimation.response.experiment import Experiment
from estimation.signals.metrics import noise_floor
from multibody.base.errors import SimulationError, Stop
from multibody.solvers.limits import cause_of_small_steps, most_evaluations, too_many
from multibody.system.simulate import simulate

if TYPE_CHECKING:
    from multibody.machine.model import System

__all__ = ["DIVERGED_ERROR", "StateEstimate", "estimate_states"]

DIVERGED_ERROR = 0.3
"""Error of a simulation, over an output's spread, from which it counts as diverged from its records.
A scan, which is linear in the error, then says nothing about it."""

_POSITIONS = ("m", "rad")
_ROUNDS = 4
_LEAN = 1e-3  # weight of the simulated state, relative to one reading of the best observed state of its unit


@dataclass(frozen=True, eq=False)
class StateEstimate:
    """States along a record: simulated, and led back to what the sensors show where the simulation departs from it.

    Parameters
    ----------
    states : ndarray, shape (nt, n)
        At every sample.
    reading : SensorReading
    """

    states: np.ndarray
    reading: SensorReading

    @property
    def experiment(self) -> Experiment:
        """The record's experiment, cropped to what is used."""
        return self.reading.experiment

    @property
    def system(self) -> System:
        """The system with the measured outputs."""
        return self.reading.system

    @property
    def p(self) -> np.ndarray:
        """Its parameter vector."""
        return self.reading.p

    @cached_property
    def input_noise(self) -> list[float]:
        """Noise of each recorded input, SI."""
        return [float(noise_floor(self.experiment.record.signals[n].values).std) for n in self.experiment.inputs]

    def at(self, sample: int) -> np.ndarray:
        """Return the estimate of the state at a sample, shape (n,)."""
        return self.reading.state(sample, self.states[sample])


@dataclass(frozen=True, eq=False, kw_only=True)
class SensorReading:
    """What the sensors show at an instant: values, and rates of positions and angles, by local parabolas."""

    experiment: Experiment
    system: System
    p: np.ndarray
    inputs: np.ndarray
    values: np.ndarray
    half_widths: tuple[int, ...]
    noise: np.ndarray
    positions: np.ndarray

    @classmethod
    def of(cls, experiment: Experiment, system: System, p: np.ndarray) -> SensorReading:
        """Return the reading of an experiment by a system that has its outputs."""
        time = np.array(experiment.record.time)
        values = experiment.record.values(*experiment.outputs)
        half_widths = []
        for c in range(values.shape[1]):
            width = int(experiment.record.rate / (6.0 * signal_bandwidth(time, values[:, c])))
            half_widths.append(int(np.clip(width, 3, max(3, time.size // 10))))
        noise = np.array([noise_floor(v).std for v in values.T])
        size = np.max(np.abs(values), axis=0)  # the spread of a channel that stands still is zero
        noise = np.maximum(noise, np.maximum(1e-4 * np.ptp(values, axis=0), 1e-9 * np.where(size > 0.0, size, 1.0)))
        units = [system.unit(n) for n in experiment.outputs]
        return cls(
            experiment=experiment,
            system=system,
            p=p,
            inputs=np.ascontiguousarray(experiment.table(system)(time, p).reshape(time.size, -1)),
            values=values,
            half_widths=tuple(half_widths),
            noise=noise,
            positions=np.array([u in _POSITIONS for u in units]),
        )

    def state(self, sample: int, prior: np.ndarray) -> np.ndarray:
        """Return the state nearest to a prior that agrees with the sensors at a sample, by a few Gauss–Newton steps."""
        system, t = self.system, float(self.experiment.record.time[sample])
        u = self.inputs[sample]
        reading = self._local(sample)
        same_unit = [[q.unit == r.unit for q in system.states] for r in system.states]
        x, (jacobian, error) = prior.copy(), self._errors(t, prior, u, reading)
        for _ in range(_ROUNDS):
            if not (np.all(np.isfinite(jacobian)) and np.all(np.isfinite(error))):
                return prior
            size = np.linalg.norm(jacobian, axis=0)
            observed = size > 0.0
            if not np.any(observed):
                return prior
            # A state that is hardly observed would follow the error that the others leave anywhere.
            lean = _LEAN * np.array([size[kind].max() for kind in same_unit])
            size = np.hypot(size, lean)
            stacked = np.vstack([jacobian[:, observed], np.diag(lean[observed])]) / size[observed]
            towards = (lean * (prior - x))[observed]
            step = np.zeros(x.size)
            step[observed] = np.linalg.lstsq(stacked, np.concatenate([error, towards]), rcond=None)[0] / size[observed]
            x, jacobian, error = x + step, *self._errors(t, x + step, u, reading)
        return x if np.all(np.isfinite(x)) else prior

    def _errors(
        self, t: float, x: np.ndarray, u: np.ndarray, reading: tuple[np.ndarray, ...]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the Jacobian and the errors of a state against the sensors, in standard deviations."""
        y, rate, y_std, rate_std = reading
        system, p = self.system, self.p
        pick = [system.index("output", n) for n in self.experiment.outputs]
        with np.errstate(all="ignore"):
            c = system.jacobian("x", t, x, u, p, of="outputs")[pick]
            f = system.rhs(t, x, u, p)
            a = system.jacobian("x", t, x, u, p)
            rows = [c / y_std[:, None], (c @ a)[self.positions] / rate_std[self.positions, None]]
            errors = [
                (y - system.outputs_at(t, x, u, p)[pick]) / y_std,
                (rate - c @ f)[self.positions] / rate_std[self.positions],
            ]
        return np.vstack(rows), np.concatenate(errors)

    def _local(self, sample: int) -> tuple[np.ndarray, ...]:
        """Return values, rates and their standard deviations at a sample."""
        time = self.experiment.record.time
        estimates = []
        for c, half in enumerate(self.half_widths):
            a, b = max(0, sample - half), min(time.size, sample + half + 1)
            if b - a < 2 * half + 1:  # at an end the parabola looks one way only
                a, b = (0, min(time.size, 2 * half + 1)) if a == 0 else (max(0, time.size - 2 * half - 1), time.size)
            s = (np.array(time[a:b]) - time[sample]) / max(time[b - 1] - time[a], 1e-300)
            basis = np.column_stack([np.ones_like(s), s, s**2])
            inverse = np.linalg.pinv(basis)
            parts = inverse @ self.values[a:b, c]
            spread = np.sqrt(np.sum(inverse**2, axis=1)) * self.noise[c]
            width = float(time[b - 1] - time[a])
            estimates.append((parts[0], parts[1] / width, spread[0], spread[1] / width))
        return tuple(np.array(part) for part in zip(*estimates, strict=True))


def estimate_states(experiment: Experiment, system: System, p: np.ndarray, pieces: int = 64) -> StateEstimate:
    """Return the states along a record: simulated, and led back to the sensors where the simulation departs from them.

    The simulation goes on from piece to piece.  Where it departs from an output by more than `DIVERGED_ERROR` of its
    spread, the piece is simulated anew from the state that the sensors show at its beginning, and that is taken if it
    follows the outputs better: states that no sensor sees are not corrected without need, since a model with a missing
    effect would otherwise be led ever farther astray by its own errors.

    Parameters
    ----------
    experiment : Experiment
        Cropped to what is used.
    system : System
        With the measured outputs.
    p : ndarray, shape (n_p,)
    pieces : int
        Number of pieces, where each has ten samples at least.

    Raises
    ------
    SimulationError
        If the pieces together take more evaluations than the simulation of the whole record may.
    """
    reading = SensorReading.of(experiment, system, p)
    time = np.array(experiment.record.time)
    n = time.size
    step = max(10, -(-n // pieces))
    states = np.empty((n, len(system.states)))
    start = experiment.start_vector(system)
    allowed, used = 2 * most_evaluations(time, (float(time[0]), float(time[-1])), n), 0  # each piece has two starts
    for first in range(0, n, step):
        last = min(first + step, n - 1)
        piece = _simulated_piece(reading, first, last, start)
        used += piece.evaluations
        if piece.error > DIVERGED_ERROR:
            shown = _simulated_piece(reading, first, last, reading.state(first, start))
            used += shown.evaluations
            piece = min(piece, shown, key=lambda of: of.error)
        if used > allowed:
            raise _too_many(reading, last, piece.states[-1], used, allowed)
        states[first : last + 1] = piece.states
        start = states[last]
    return StateEstimate(states, reading)


def _too_many(reading: SensorReading, sample: int, x: np.ndarray, used: int, allowed: int) -> SimulationError:
    """Return the error that the pieces up to a sample took more evaluations than the whole record may."""
    system, time = reading.system, reading.experiment.record.time
    t = float(time[sample])
    cause = cause_of_small_steps(
        lambda state: system.rhs(t, state, reading.inputs[sample], reading.p),
        x,
        float(time[-1] - time[0]),
        lambda k: f"state '{system.state_names[k]}'",
    )
    text = too_many(used, allowed, t, cause)
    return SimulationError(f"record '{reading.experiment.name}': {text}", Stop.TOO_MANY_EVALUATIONS, used)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Piece:
    """A piece of a record that was simulated.

    Parameters
    ----------
    states : ndarray, shape (nt, n)
    error : float
        Largest error of an output over its spread in the record; infinite where the simulation failed.
    evaluations : int
    """

    states: np.ndarray
    error: float
    evaluations: int = 0


def _simulated_piece(reading: SensorReading, first: int, last: int, start: np.ndarray) -> _Piece:
    """Return the states from sample to sample; a piece that cannot be simulated keeps its beginning."""
    experiment, system = reading.experiment, reading.system
    if last == first:
        return _Piece(states=start[None, :], error=0.0)
    time = np.array(experiment.record.time[first : last + 1])
    try:
        run = simulate(
            system,
            (float(time[0]), float(time[-1])),
            inputs=experiment.table(system),
            parameters=reading.p,
            initial=start,
            times=time,
            rtol=1e-5,
        )
    except SimulationError as error:
        return _Piece(states=np.tile(start, (time.size, 1)), error=float("inf"), evaluations=error.evaluations)
    outputs = np.column_stack([run[n] for n in experiment.outputs])
    with np.errstate(over="ignore"):  # what runs away is infinitely far
        errors = np.sqrt(np.mean((outputs - reading.values[first : last + 1]) ** 2, axis=0))
    spread = np.maximum(np.std(reading.values, axis=0), reading.noise)
    return _Piece(
        states=run.states, error=float(np.max(errors / spread)), evaluations=int(run.statistics.get("nfev", 0))
    )
