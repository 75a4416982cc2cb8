"""How visible a hidden effect is, in nats: the gain of the log-likelihood by the truth, after recalibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from discrepancy.validation.machines.disturbances import Disturbance, modes
from discrepancy.validation.machines.machine import Machine
from discrepancy.validation.machines.simulate import simulate

__all__ = ["Information", "information", "repeated", "white_noise"]

Array = NDArray[np.float64]

DIFFERENCE = 0.3  # of a standard deviation: far above rounding, and small beside what bends the outputs


@dataclass(frozen=True)
class Information:
    """The weight S⁻¹ of recordings whose noise is white per channel, plus a part of low rank.

    S = N + U Uᵀ; N is the variance of the sensors' noise, and the columns of U are the modes of the disturbance and the
    sensitivities to uncertain parameters and start values, each times its standard deviation.  By that last part the
    gain ½ dᵀ S⁻¹ d is the one that is left after the best recalibration within the priors:

        ½ dᵀ (N + W Wᵀ + J P Jᵀ)⁻¹ d = min_δ ½ (d − J δ)ᵀ (N + W Wᵀ)⁻¹ (d − J δ) + ½ δᵀ P⁻¹ δ

    Parameters
    ----------
    deviation : ndarray, shape (samples,)
        Square root of the diagonal of N.
    columns : ndarray, shape (samples, rank)
        U.
    """

    deviation: Array
    columns: Array

    @cached_property
    def _whitened(self) -> tuple[Array, Any]:
        """N^-½ U and the factor of I + Uᵀ N⁻¹ U (Woodbury's identity)."""
        u = self.columns / self.deviation[:, None]
        return u, cho_factor(np.eye(u.shape[1]) + u.T @ u)

    def inner(self, a: Array, b: Array) -> Array:
        """Return aᵀ S⁻¹ b for columns of differences (samples, …)."""
        u, factor = self._whitened
        a, b = (np.asarray(v).T / self.deviation for v in (a, b))
        return np.asarray(a @ b.T - (a @ u) @ cho_solve(factor, u.T @ b.T))

    def nats(self, difference: Array) -> float:
        """Return ½ dᵀ S⁻¹ d.

        Examples
        --------
        An offset of one deviation in 50 samples, and a free offset of prior deviation one beside it:

        >>> white = Information(np.ones(50), np.zeros((50, 0)))
        >>> calibrated = Information(np.ones(50), np.ones((50, 1)))
        >>> white.nats(np.ones(50)), round(calibrated.nats(np.ones(50)), 4)
        (25.0, 0.4902)
        """
        return float(0.5 * self.inner(difference, difference))


def repeated(signals: Mapping[str, Array], times: int) -> dict[str, Array]:
    """Return the records of each signal, all of them ``times`` times one after the other."""
    return {name: np.tile(value, (1, times)) for name, value in signals.items()}


def white_noise(machine: Machine, rng: np.random.Generator, rows: int, runs: int) -> dict[str, Array]:
    """Draw the noise of every channel."""
    return {c.name: c.noise * rng.standard_normal((rows, runs)) for c in machine.channels}


def stacked(machine: Machine, recorded: Mapping[str, Array]) -> Array:
    """Return recordings (rows, runs) of all channels as one array (channels, rows, runs)."""
    return np.stack([recorded[c.name] for c in machine.channels])


def information(
    machine: Machine,
    values: Mapping[str, Any],
    drives: Mapping[str, Array],
    disturbance: Disturbance,
    rng: np.random.Generator,
) -> Information:
    """Return the weight of a machine's records, around its true values without hidden effects.

    Parameters
    ----------
    machine : Machine
    values : mapping of str to float or ndarray, shape (records,)
    drives : mapping of str to ndarray, shape (rows, records)
    disturbance : Disturbance
    rng : Generator
        For the noise with which the variance of each channel is found: a sampled controller answers to the noise of
        its sensors, and what it gives is a channel too.
    """
    rows, records = next(iter(drives.values())).shape
    knobs = [(p.name, p.std) for p in machine.parameters]
    knobs += [(s.name, s.std) for s in machine.starts]
    own = len(machine.parameters)
    waves = (
        modes(disturbance, np.asarray(machine.dt * np.arange(rows), dtype=np.float64))
        if disturbance.rms
        else np.zeros((0, rows))
    )
    count = 2 * len(knobs) + len(waves) + 1
    full = {k: np.tile(np.broadcast_to(v, records).astype(float), count) for k, v in values.items()}
    for k, (name, std) in enumerate(knobs):
        base = full.setdefault(name, np.zeros(count * records))
        base[2 * k * records : (2 * k + 1) * records] += DIFFERENCE * std
        base[(2 * k + 1) * records : (2 * k + 2) * records] -= DIFFERENCE * std
    acting = np.zeros((rows, count * records))
    first = 2 * len(knobs)
    for k, wave in enumerate(waves):
        acting[:, (first + k) * records : (first + k + 1) * records] = wave[:, None]
    forces = {disturbance.place: acting} if len(waves) else None
    runs = stacked(machine, simulate(machine, full, repeated(drives, count), forces))
    runs = runs.reshape(len(machine.channels), rows, count, records)
    quiet = runs[:, :, -1]
    columns = []
    for k in range(len(knobs)):
        slope = (runs[:, :, 2 * k] - runs[:, :, 2 * k + 1]) / (2.0 * DIFFERENCE)
        columns += [slope] if k < own else _by_record(slope)
    for k in range(len(waves)):
        columns += _by_record(runs[:, :, first + k] - quiet)
    noisy = stacked(machine, simulate(machine, values, drives, noise=white_noise(machine, rng, rows, records)))
    deviation = np.sqrt(((noisy - quiet) ** 2).mean(axis=(1, 2)))
    samples = quiet.size
    matrix = np.stack(columns, axis=-1).reshape(samples, -1) if columns else np.zeros((samples, 0))
    return Information(np.repeat(deviation, samples // deviation.size), matrix)


def _by_record(column: Array) -> list[Array]:
    """Return a column for each record: what acts in one of them leaves the others alone."""
    parts = []
    for record in range(column.shape[-1]):
        part = np.zeros_like(column)
        part[:, :, record] = column[:, :, record]
        parts.append(part)
    return parts
