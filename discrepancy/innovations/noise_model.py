"""What is random in a machine and its records: white noise of each output, and processes that act as latent forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.innovations.kernel import covariance_pass, filter_columns
from discrepancy.innovations.linear_record import LinearRecord

__all__ = ["InnovationWeighting", "NoiseModel", "Process", "innovation_weighting"]

EIGENVALUES_APART = 1e-4  # half their least distance: the error is of its square


@dataclass(frozen=True, kw_only=True)
class Process:
    """A random process of first order (Ornstein-Uhlenbeck) or of second order.

    One of second order is an oscillator driven by white noise, f'' + 2 ζ f' / T + f / T² = w: smooth where its damping
    ζ is about one (Matérn 3/2 at one), narrow in frequency where it is far below.

    Parameters
    ----------
    where : str
        The connection that it acts on as a force, or the output that it is added to.
    source, channel : int
        Column of the record's latent forces, or -1; index of the output, or -1.
    memory : float, s
        Correlation time of a process of first order; T of one of second order.
    std : float
        Stationary standard deviation, SI.
    damping : float, optional
        Of second order: ζ.
    at_standstill : bool
        Whether it acts only while the connection stands still: what dry friction holds it with then is not determined
        by its motion.
    """

    where: str
    source: int
    channel: int
    memory: float
    std: float
    damping: float | None = None
    at_standstill: bool = False

    @property
    def order(self) -> int:
        """Number of its states."""
        return 1 if self.damping is None else 2

    def stationary(self) -> np.ndarray:
        """Return the stationary covariance of its states, its value and of second order its rate, shape (2, 2)."""
        rate = 0.0 if self.damping is None else self.std / self.memory
        covariance: np.ndarray = np.diag([self.std**2, rate**2])
        return covariance

    def transitions(self, steps: np.ndarray) -> np.ndarray:
        """Return how its states go on over some steps of time, shape (n, 2, 2)."""
        out = np.zeros((steps.size, 2, 2))
        if self.damping is None:
            out[:, 0, 0] = np.exp(-steps / self.memory)
            return out
        # exp(A t) of A = [[0, 1], [-1/T², -2 ζ/T]] by its eigenvalues -ζ/T ± s; near s = 0 they are moved apart
        t, zeta = steps / self.memory, self.damping
        s = np.sqrt(complex(zeta**2 - 1.0))
        s = s if abs(s) > EIGENVALUES_APART else complex(EIGENVALUES_APART)
        slow, fast = np.exp((s - zeta) * t), np.exp(-(s + zeta) * t)
        even, odd = (0.5 * (slow + fast)).real, (0.5 * (slow - fast) / s).real
        out[:, 0, 0], out[:, 0, 1] = even + zeta * odd, self.memory * odd
        out[:, 1, 0], out[:, 1, 1] = -odd / self.memory, even - zeta * odd
        return out


@dataclass(frozen=True, eq=False, kw_only=True)
class NoiseModel:
    """White noise of the outputs, and latent processes: all independent of each other.

    Several processes at one place add up to a richer spectrum.

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

    def _filtered(self, block: np.ndarray, inverse: bool) -> np.ndarray:
        columns = np.ascontiguousarray(block.reshape(*block.shape[:2], -1), dtype=float)
        out = np.empty_like(columns)
        r, model = self.record, self.model
        filter_columns(
            r.phi,
            r.gamma0,
            r.gamma1,
            r.c,
            r.d,
            r.observed,
            r.counts,
            *_indices(model.processes),
            _transitions(r, model.processes),
            self.gain,
            self.root,
            columns,
            out,
            inverse,
        )
        return out.reshape(block.shape)


def innovation_weighting(record: LinearRecord, model: NoiseModel) -> InnovationWeighting:
    """Return the whitening of a record under a noise model."""
    count, n_c, n = record.c.shape
    size = n + sum(q.order for q in model.processes)
    gain, root = np.zeros((count, size, n_c)), np.zeros((count, n_c, n_c))
    log_det = covariance_pass(
        record.phi,
        record.gamma0,
        record.gamma1,
        record.c,
        record.d,
        record.counts,
        *_indices(model.processes),
        _transitions(record, model.processes),
        np.array([q.stationary() for q in model.processes]).reshape(-1, 2, 2),
        model.noise_covariance(),
        gain,
        root,
    )
    return InnovationWeighting(record=record, model=model, gain=gain, root=root, log_det=float(log_det))


def _indices(processes: Sequence[Process]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    order = np.array([q.order for q in processes], dtype=np.int64)
    return (
        np.array([q.source for q in processes], dtype=np.int64),
        np.array([q.channel for q in processes], dtype=np.int64),
        np.cumsum(order) - order,
        order,
    )


def _transitions(record: LinearRecord, processes: Sequence[Process]) -> np.ndarray:
    steps, which = np.unique(np.diff(record.time), return_inverse=True)
    if not processes:
        return np.zeros((which.size, 0, 2, 2))
    return np.ascontiguousarray(np.stack([q.transitions(steps)[which] for q in processes], axis=1))
