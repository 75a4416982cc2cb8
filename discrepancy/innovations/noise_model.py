"""What is random in a machine and its records: white noise of each output, and processes that act as latent forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.innovations.kernel import covariance_pass, filter_columns, score_pass
from discrepancy.innovations.linear_record import LinearRecord

__all__ = ["InnovationWeighting", "NoiseModel", "Process", "innovation_weighting"]


@dataclass(frozen=True, kw_only=True)
class Process:
    """A random process with an exponential correlation (Ornstein-Uhlenbeck).

    Parameters
    ----------
    where : str
        The connection that it acts on as a force, or the output that it is added to.
    source, channel : int
        Column of the record's latent forces, or -1; index of the output, or -1.
    memory : float, s
        Correlation time.
    std : float
        Stationary standard deviation, SI.
    at_standstill : bool
        Whether it acts only while the connection stands still: what dry friction holds it with then is not determined
        by its motion.
    """

    where: str
    source: int
    channel: int
    memory: float
    std: float
    at_standstill: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class NoiseModel:
    """White noise of the outputs, and latent processes: all independent of each other.

    Several processes at one place add up to a spectrum that is richer than one of first order.

    Parameters
    ----------
    noise : tuple of float
        Standard deviation of the white noise of each output, SI.
    processes : tuple of Process
    correlation : ndarray, shape (n_c, n_c), optional
        Of the white noise: a controller that acts on noisy measurements puts their noise into its command as well.
        Default: none.
    """

    noise: tuple[float, ...]
    processes: tuple[Process, ...] = ()
    correlation: np.ndarray | None = None

    def noise_covariance(self) -> np.ndarray:
        """Return the covariance of the white noise, shape (n_c, n_c)."""
        std = np.array(self.noise)
        correlation = np.eye(std.size) if self.correlation is None else self.correlation
        covariance: np.ndarray = correlation * np.outer(std, std)
        return covariance


@dataclass(frozen=True, eq=False, kw_only=True)
class InnovationWeighting:
    """Whitening of one record's blocks by the Kalman filter along its trajectory: W with Wᵀ W = Σ⁻¹.

    Parameters
    ----------
    record : LinearRecord
    model : NoiseModel
    gain, root : ndarray
        As in `discrepancy.innovations.kernel.covariance_pass`.
    log_det : float
        Half the logarithm of the determinant of Σ.
    """

    record: LinearRecord
    model: NoiseModel
    gain: np.ndarray
    root: np.ndarray
    log_det: float

    def __call__(self, block: np.ndarray) -> np.ndarray:
        """Return a block, shape (n, n_channels) or (n, n_channels, k), as its standardised innovations."""
        return self._filtered(block, False)

    def inverse(self, block: np.ndarray) -> np.ndarray:
        """Return the block that has these standardised innovations."""
        return self._filtered(block, True)

    def score(self, white: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives of the likelihood by the logarithms of the standard deviations.

        Parameters
        ----------
        white : ndarray, shape (n, n_channels, q)
            Standardised innovations whose squares are added up: of the residual, and of what is uncertain in it.

        Returns
        -------
        noise : ndarray, shape (n_c,)
            By those of the white noise, at a given correlation.
        processes : ndarray, shape (p,)
        """
        model = self.model
        driving, noise = np.zeros(len(model.processes)), np.zeros((white.shape[1], white.shape[1]))
        score_pass(
            *self._filter(),
            np.ascontiguousarray(white),
            driving,
            noise,
        )
        return np.sum(noise * model.noise_covariance(), axis=1), driving * np.array([q.std**2 for q in model.processes])

    def _filter(self) -> tuple[np.ndarray, ...]:
        """Return what the compiled recursions take of the record and of its filter."""
        r, processes = self.record, self.model.processes
        transitions = (r.phi, r.gamma0, r.gamma1, r.c, r.d, r.observed, r.counts)
        return (*transitions, *_indices(processes), _decay(r, processes), self.gain, self.root)

    def _filtered(self, block: np.ndarray, inverse: bool) -> np.ndarray:
        columns = np.ascontiguousarray(block.reshape(*block.shape[:2], -1), dtype=float)
        out = np.empty_like(columns)
        filter_columns(
            *self._filter(),
            columns,
            out,
            inverse,
        )
        return out.reshape(block.shape)


def innovation_weighting(record: LinearRecord, model: NoiseModel) -> InnovationWeighting:
    """Return the whitening of a record under a noise model."""
    count, n_c, n = record.c.shape
    size = n + len(model.processes)
    gain, root = np.zeros((count, size, n_c)), np.zeros((count, n_c, n_c))
    log_det = covariance_pass(
        record.phi,
        record.gamma0,
        record.gamma1,
        record.c,
        record.d,
        record.counts,
        *_indices(model.processes),
        _decay(record, model.processes),
        np.array([q.std**2 for q in model.processes]),
        model.noise_covariance(),
        gain,
        root,
    )
    return InnovationWeighting(record=record, model=model, gain=gain, root=root, log_det=float(log_det))


def _indices(processes: Sequence[Process]) -> tuple[np.ndarray, np.ndarray]:
    return (
        np.array([q.source for q in processes], dtype=np.int64),
        np.array([q.channel for q in processes], dtype=np.int64),
    )


def _decay(record: LinearRecord, processes: Sequence[Process]) -> np.ndarray:
    step = np.diff(record.time)
    memory = np.array([q.memory for q in processes])
    return np.exp(-step[:, None] / memory) if memory.size else np.zeros((step.size, 0))
