"""What is random in a machine and its records: white noise of each output, and processes that act as latent forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from discrepancy.innovations.kernel import covariance_pass, filter_columns, score_pass
from discrepancy.innovations.linear_record import LinearRecord

__all__ = ["InnovationWeighting", "NoiseModel", "Process", "innovation_weighting"]


SWINGS = 0.2  # cycles within the memory of a process, from which it is said to swing


@dataclass(frozen=True, kw_only=True)
class Process:
    """A random process with an exponential correlation (Ornstein-Uhlenbeck), or one that swings.

    Its covariance is std² · exp(−|τ| / memory) · cos(2π · frequency · τ): with a frequency, the real part of an
    Ornstein-Uhlenbeck process that turns in the complex plane.

    Parameters
    ----------
    where : str
        The connection that it acts on as a force, the recorded input or output that it is added to, or the state whose
        rate it is added to.
    source, channel : int
        Column of the record's latent forces, or -1; index of the output, or -1.
    memory : float, s
        Correlation time.
    std : float
        Stationary standard deviation, SI.
    at_standstill : bool
        Whether it acts only while the connection stands still: what dry friction holds it with then is not determined
        by its motion.
    in_rate : bool
        Whether it is added to the rate of a state.
    frequency : float, Hz
        In the middle of its band; zero: it does not swing.
    """

    where: str
    source: int
    channel: int
    memory: float
    std: float
    at_standstill: bool = False
    in_rate: bool = False
    frequency: float = 0.0

    @property
    def swings(self) -> bool:
        """Whether it completes a good part of a cycle before it forgets where it was."""
        return self.frequency * self.memory > SWINGS

    def outlasts(self, duration: float) -> bool:
        """Tell whether it remembers longer than records last, s.

        Chance shows by repetition.  What the records hold less than one memory of is drawn once, and may as well be
        what the model lacks.
        """
        return self.frequency == 0.0 and self.memory > duration


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
class Score:
    """Derivatives of a likelihood by logarithms.

    Parameters
    ----------
    noise : ndarray, shape (n_c,)
        By the standard deviations of the white noise, at a given correlation.
    std, memory, frequency : ndarray, shape (p,)
        By what each process is made of; zero by the frequency of one that does not swing.
    """

    noise: np.ndarray
    std: np.ndarray
    memory: np.ndarray
    frequency: np.ndarray

    @classmethod
    def total(cls, scores: Sequence[Score]) -> Score:
        """Return the sum over independent records."""
        return cls(**{name: np.sum([getattr(s, name) for s in scores], axis=0) for name in cls.__dataclass_fields__})


@dataclass(frozen=True, eq=False, kw_only=True)
class InnovationWeighting:
    """Whitening of one record's blocks by the Kalman filter along its trajectory: W with Wᵀ W = Σ⁻¹.

    Parameters
    ----------
    record : LinearRecord
    model : NoiseModel
    along, turn, gain, root, latent : ndarray
        As in `discrepancy.innovations.kernel.covariance_pass`.
    log_det : float
        Half the logarithm of the determinant of Σ.
    """

    record: LinearRecord
    model: NoiseModel
    along: np.ndarray
    turn: np.ndarray
    gain: np.ndarray
    root: np.ndarray
    latent: np.ndarray
    log_det: float

    def __call__(self, block: np.ndarray) -> np.ndarray:
        """Return a block, shape (n, n_channels) or (n, n_channels, k), as its standardised innovations."""
        return self._filtered(block, False)

    def inverse(self, block: np.ndarray) -> np.ndarray:
        """Return the block that has these standardised innovations."""
        return self._filtered(block, True)

    def score(self, white: np.ndarray) -> Score:
        """Return the derivatives of the likelihood by the logarithms of what a noise model consists of.

        Parameters
        ----------
        white : ndarray, shape (n, n_channels, q)
            Standardised innovations whose squares are added up: of the residual, and of what is uncertain in it.
        """
        processes, step = self.model.processes, np.diff(self.record.time)[:, None]
        owner, along, turn = _owners(processes), self.along, self.turn
        variance = _variances(processes)
        noise, first = np.zeros((white.shape[1], white.shape[1])), np.zeros(owner.size)
        driving, kept, gained = (np.zeros(along.shape) for _ in range(3))
        score_pass(
            *self._machine(),
            *_indices(processes),
            along,
            turn,
            variance,
            self.gain,
            self.root,
            self.latent,
            np.ascontiguousarray(white),
            noise,
            first,
            driving,
            kept,
            gained,
        )
        memory, frequency, sense = _shapes(processes)
        lost = 1.0 - along**2 - turn**2
        of_std = first + np.sum(driving * lost, axis=0)
        by_memory = kept * along + gained * turn - driving * variance * (1.0 - lost)
        by_frequency = sense * (gained * along - kept * turn)

        def of_processes(by_component: np.ndarray) -> np.ndarray:
            return np.bincount(owner, by_component, minlength=len(processes))

        return Score(
            noise=np.sum(noise * self.model.noise_covariance(), axis=1),
            std=of_processes(of_std * variance),
            memory=of_processes(np.sum(by_memory * step / memory, axis=0)),
            frequency=of_processes(np.sum(by_frequency * 2.0 * np.pi * frequency * step, axis=0)),
        )

    def _machine(self) -> tuple[np.ndarray, ...]:
        """Return what the compiled recursions take of the record."""
        r = self.record
        return r.phi, r.gamma0, r.gamma1, r.c, r.d, r.observed, r.counts

    def _filtered(self, block: np.ndarray, inverse: bool) -> np.ndarray:
        columns = np.ascontiguousarray(block.reshape(*block.shape[:2], -1), dtype=float)
        out = np.empty_like(columns)
        filter_columns(
            *self._machine(),
            *_indices(self.model.processes),
            self.along,
            self.turn,
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
    owner = _owners(model.processes)
    size = n + owner.size
    gain, root, latent = np.zeros((count, size, n_c)), np.zeros((count, n_c, n_c)), np.zeros((count, owner.size, size))
    along, turn = _transitions(record, model.processes)
    log_det = covariance_pass(
        record.phi,
        record.gamma0,
        record.gamma1,
        record.c,
        record.d,
        record.counts,
        *_indices(model.processes),
        along,
        turn,
        _variances(model.processes),
        model.noise_covariance(),
        gain,
        root,
        latent,
    )
    return InnovationWeighting(
        record=record,
        model=model,
        along=along,
        turn=turn,
        gain=gain,
        root=root,
        latent=latent,
        log_det=float(log_det),
    )


def _owners(processes: Sequence[Process]) -> np.ndarray:
    """Return the process that each component belongs to: one that swings has two, the second of which acts nowhere."""
    return np.array([k for k, q in enumerate(processes) for _ in range(2 if q.frequency > 0.0 else 1)], dtype=np.int64)


def _variances(processes: Sequence[Process]) -> np.ndarray:
    """Return the stationary variance of every component."""
    return np.array([processes[k].std ** 2 for k in _owners(processes)])


def _indices(processes: Sequence[Process]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return source, channel and partner of every component."""
    source: list[int] = []
    channel: list[int] = []
    partner: list[int] = []
    for q in processes:
        here = len(source)
        source.append(q.source)
        channel.append(q.channel)
        partner.append(here)
        if q.frequency > 0.0:
            source.append(-1)
            channel.append(-1)
            partner[here] = here + 1
            partner.append(here)
    as_index = [np.array(x, dtype=np.int64) for x in (source, channel, partner)]
    return as_index[0], as_index[1], as_index[2]


def _shapes(processes: Sequence[Process]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return memory and frequency of every component, and the sense in which it turns."""
    owner = _owners(processes)
    memory = np.array([processes[k].memory for k in owner])
    frequency = np.array([processes[k].frequency for k in owner])
    return memory, frequency, np.where(np.diff(owner, prepend=-1) == 0, 1.0, -1.0)


def _transitions(record: LinearRecord, processes: Sequence[Process]) -> tuple[np.ndarray, np.ndarray]:
    """Return what every component keeps of itself from sample to sample, and what it gains of its partner."""
    step = np.diff(record.time)[:, None]
    memory, frequency, sense = _shapes(processes)
    decay, angle = np.exp(-step / memory), 2.0 * np.pi * frequency * step
    return decay * np.cos(angle), sense * decay * np.sin(angle)
