"""Where a machine was at any instant of a record, as far as its sensors tell: a first guess of start states."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from estimation.response.experiment import Experiment

if TYPE_CHECKING:
    from multibody.machine.model import System

__all__ = ["Followed", "follow", "signal_bandwidth"]

_POSITIONS = ("m", "rad")
_ROUNDS = 4
_LEAN = 1e-3  # pull towards the simulated state, against what one reading tells of the best seen state of its unit


@dataclass(frozen=True, eq=False)
class Followed:
    """States along a record: simulated piece by piece, set right by the sensors at the beginning of each piece.

    Parameters
    ----------
    states : ndarray, shape (nt, n)
        At every sample.
    experiment : Experiment
    system : System
    p : ndarray, shape (n_p,)
    """

    states: np.ndarray
    experiment: Experiment
    system: System
    p: np.ndarray
    reading: Reading

    @property
    def input_noise(self) -> list[float]:
        """Noise of each recorded input, SI."""
        from estimation.signals.metrics import noise_floor

        return [float(noise_floor(self.experiment.record.signals[n].values).std) for n in self.experiment.inputs]

    def at(self, sample: int) -> np.ndarray:
        """Return the guess of the state at a sample, shape (n,)."""
        return self.reading.state(sample, self.states[sample])


@dataclass(frozen=True, eq=False)
class Reading:
    """What the sensors say at an instant: values, and rates of positions and angles, by local parabolas."""

    experiment: Experiment
    system: System
    p: np.ndarray
    inputs: np.ndarray
    values: np.ndarray
    half: tuple[int, ...]
    noise: np.ndarray
    positions: np.ndarray

    @classmethod
    def of(cls, experiment: Experiment, system: System, p: np.ndarray) -> Reading:
        """Return the reading of an experiment by a system that has its outputs."""
        from estimation.signals.metrics import noise_floor

        time = np.array(experiment.record.time)
        values = experiment.record.values(*experiment.outputs)
        half = []
        for c in range(values.shape[1]):
            width = int(experiment.record.rate / (6.0 * signal_bandwidth(time, values[:, c])))
            half.append(int(np.clip(width, 3, max(3, time.size // 10))))
        noise = np.array([noise_floor(v).std for v in values.T])
        size = np.max(np.abs(values), axis=0)  # a channel that stands still has no spread to go by
        noise = np.maximum(noise, np.maximum(1e-4 * np.ptp(values, axis=0), 1e-9 * np.where(size > 0.0, size, 1.0)))
        units = [system.unit(n) for n in experiment.outputs]
        inputs = np.ascontiguousarray(experiment.table(system)(time, p).reshape(time.size, -1))
        return cls(
            experiment, system, p, inputs, values, tuple(half), noise, np.array([u in _POSITIONS for u in units])
        )

    def state(self, sample: int, prior: np.ndarray) -> np.ndarray:
        """Return the state nearest to a prior that agrees with the sensors at a sample, by a few Gauss–Newton steps."""
        system, t = self.system, float(self.experiment.record.time[sample])
        u = self.inputs[sample]
        reading = self._local(sample)
        kinds = [[q.unit == r.unit for q in system.states] for r in system.states]
        x, (jacobian, error) = prior.copy(), self._missed(t, prior, u, reading)
        for _ in range(_ROUNDS):
            if not (np.all(np.isfinite(jacobian)) and np.all(np.isfinite(error))):
                return prior
            size = np.linalg.norm(jacobian, axis=0)
            seen = size > 0.0
            if not np.any(seen):
                return prior
            # A state that hardly shows would be thrown anywhere by what the others leave of the error.
            lean = _LEAN * np.array([size[kind].max() for kind in kinds])
            size = np.hypot(size, lean)
            stacked = np.vstack([jacobian[:, seen], np.diag(lean[seen])]) / size[seen]
            towards = (lean * (prior - x))[seen]
            step = np.zeros(x.size)
            step[seen] = np.linalg.lstsq(stacked, np.concatenate([error, towards]), rcond=None)[0] / size[seen]
            x, jacobian, error = x + step, *self._missed(t, x + step, u, reading)
        return x if np.all(np.isfinite(x)) else prior

    def _missed(
        self, t: float, x: np.ndarray, u: np.ndarray, reading: tuple[np.ndarray, ...]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return by how many standard deviations a state misses the sensors, and what moves with the state."""
        y, rate, y_std, rate_std = reading
        system, p = self.system, self.p
        pick = [system.index("output", n) for n in self.experiment.outputs]
        with np.errstate(all="ignore"):
            c = system.jacobian("x", t, x, u, p, of="outputs")[pick]
            f = system.rhs(t, x, u, p)
            a = system.jacobian("x", t, x, u, p)
            rows = [c / y_std[:, None], (c @ a)[self.positions] / rate_std[self.positions, None]]
            miss = [
                (y - system.outputs_at(t, x, u, p)[pick]) / y_std,
                (rate - c @ f)[self.positions] / rate_std[self.positions],
            ]
        return np.vstack(rows), np.concatenate(miss)

    def _local(self, sample: int) -> tuple[np.ndarray, ...]:
        time = self.experiment.record.time
        found = []
        for c, half in enumerate(self.half):
            a, b = max(0, sample - half), min(time.size, sample + half + 1)
            if b - a < 2 * half + 1:  # at an end the parabola looks one way only
                a, b = (0, min(time.size, 2 * half + 1)) if a == 0 else (max(0, time.size - 2 * half - 1), time.size)
            s = (np.array(time[a:b]) - time[sample]) / max(time[b - 1] - time[a], 1e-300)
            basis = np.column_stack([np.ones_like(s), s, s**2])
            inverse = np.linalg.pinv(basis)
            parts = inverse @ self.values[a:b, c]
            spread = np.sqrt(np.sum(inverse**2, axis=1)) * self.noise[c]
            width = float(time[b - 1] - time[a])
            found.append((parts[0], parts[1] / width, spread[0], spread[1] / width))
        return tuple(np.array(part) for part in zip(*found, strict=True))


def follow(experiment: Experiment, system: System, p: np.ndarray, pieces: int = 64) -> Followed:
    """Return the states along a record: each piece is simulated from what the sensors say at its beginning.

    Parameters
    ----------
    experiment : Experiment
        Cropped to what is used.
    system : System
        With the measured outputs.
    p : ndarray, shape (n_p,)
    pieces : int
        Into how many pieces the record is cut, where each has ten samples at least.
    """
    from multibody.base.errors import SimulationError
    from multibody.system.simulate import simulate

    reading = Reading.of(experiment, system, p)
    time = np.array(experiment.record.time)
    n = time.size
    step = max(10, -(-n // pieces))
    states = np.empty((n, len(system.states)))
    prior = experiment.start_vector(system)
    for first in range(0, n, step):
        x = reading.state(first, prior)
        last = min(first + step, n - 1)
        states[first : last + 1] = x
        if last == first:
            break
        try:
            run = simulate(
                system,
                (float(time[first]), float(time[last])),
                inputs=experiment.table(system),
                parameters=p,
                initial=x,
                times=time[first : last + 1],
                rtol=1e-5,
            )
            states[first : last + 1] = run.states
        except SimulationError:
            pass  # the piece keeps its beginning; the next is set right by the sensors again
        prior = states[last]
    return Followed(states, experiment, system, p, reading)


def signal_bandwidth(time: np.ndarray, values: np.ndarray) -> float:
    """Return the highest frequency at which a signal stands out of its noise, Hz, at most a tenth of the sampling rate.

    The noise is taken as white with the median density of the upper quarter of the spectrum; the signal stands out
    where the density, smoothed over neighbours, is ten times that.
    """
    values = np.asarray(values, dtype=float)
    n = values.size
    rate = (n - 1) / float(time[-1] - time[0])
    line = values[0] + (values[-1] - values[0]) * np.arange(n) / max(n - 1, 1)
    density = np.abs(np.fft.rfft((values - line) * np.hanning(n))) ** 2
    frequency = np.arange(density.size) * rate / n
    neighbours = max(3, density.size // 200)
    smooth = np.convolve(density, np.ones(neighbours) / neighbours, mode="same")
    noise = float(np.median(density[3 * density.size // 4 :])) / np.log(
        2.0
    )  # a periodogram's median is ln 2 of its mean
    out = np.flatnonzero(smooth > 10.0 * noise)
    low, high = 4.0 * rate / n, 0.1 * rate
    return float(np.clip(frequency[out[-1]] if out.size else low, min(low, high), high))
