"""What is random in a machine and its records: white noise of each output, and processes that act as latent forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from discrepancy.innovations.kernel import covariance_pass, filter_columns, score_pass
from discrepancy.innovations.linear_record import LinearRecord

__all__ = ["InnovationWeighting", "NoiseModel", "Process", "innovation_weighting"]


SWINGS = 0.2  # cycles within the memory of a process, from which it is said to swing


@dataclass(frozen=True, kw_only=True)
class Process:
    """A random process with an exponential correlation (Ornstein-Uhlenbeck), one that swings, or a smooth one.

    Its covariance is std² · exp(−|τ| / memory) · cos(2π · frequency · τ): with a frequency, the real part of an
    Ornstein-Uhlenbeck process that turns in the complex plane.  That of a smooth one, which has a rate of change
    (Matérn 3/2), is std² · (1 + |τ| / memory) · exp(−|τ| / memory).

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
    smooth : bool
        Whether it has a rate of change, as the push of a gust has; one that swings has none.
    """

    where: str
    source: int
    channel: int
    memory: float
    std: float
    at_standstill: bool = False
    in_rate: bool = False
    frequency: float = 0.0
    smooth: bool = False

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


class Components(NamedTuple):
    """What the compiled recursions take of processes: one that swings has two components, the second acts nowhere.

    So has a smooth one: the second is minus its rate of change times its memory.

    Parameters
    ----------
    owner : ndarray of int, shape (c,)
        Process that each belongs to.
    source, channel, partner : ndarray of int, shape (c,)
        As in `discrepancy.innovations.kernel.covariance_pass`.
    sense : ndarray, shape (c,)
        In which each turns into its partner, ±1.
    variance, memory, frequency : ndarray, shape (c,)
    smooth : ndarray of bool, shape (c,)
    """

    owner: np.ndarray
    source: np.ndarray
    channel: np.ndarray
    partner: np.ndarray
    sense: np.ndarray
    variance: np.ndarray
    memory: np.ndarray
    frequency: np.ndarray
    smooth: np.ndarray

    def transitions(self, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what each keeps of itself over every step, s, and what it gains of its partner, (N - 1, c) each."""
        aged = step[:, None] / self.memory
        decay, angle = np.exp(-aged), (2.0 * np.pi * self.frequency) * step[:, None]
        along = np.where(self.smooth, 1.0 - self.sense * aged, np.cos(angle))
        return decay * along, self.sense * decay * np.where(self.smooth, aged, np.sin(angle))

    def slopes_by_memory(self, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives of the same by the logarithms of the memories."""
        aged = step[:, None] / self.memory
        along, turn = self.transitions(step)
        growing = aged * np.exp(-aged)  # of a smooth one, the part that grows with its age falls with its memory
        return along * aged + self.smooth * self.sense * growing, turn * aged - self.smooth * self.sense * growing


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

    @cached_property
    def components(self) -> Components:
        """What the recursions take of the processes."""
        count = [2 if q.frequency > 0.0 or q.smooth else 1 for q in self.processes]
        owner = np.repeat(np.arange(len(count)), count)
        begins = np.concatenate([[0], np.cumsum(count, dtype=np.int64)])[owner]
        second = np.arange(owner.size) > begins

        def of(values: Sequence[float]) -> np.ndarray:
            return np.array(values, dtype=float)[owner]

        def first_only(values: Sequence[int]) -> np.ndarray:
            return np.where(second, -1, np.array(values, dtype=np.int64)[owner])

        return Components(
            owner=owner,
            source=first_only([q.source for q in self.processes]),
            channel=first_only([q.channel for q in self.processes]),
            partner=2 * begins + np.array(count, dtype=np.int64)[owner] - 1 - np.arange(owner.size),
            sense=np.where(second, 1.0, -1.0),
            variance=of([q.std**2 for q in self.processes]),
            memory=of([q.memory for q in self.processes]),
            frequency=of([q.frequency for q in self.processes]),
            smooth=np.array([q.smooth for q in self.processes], dtype=bool)[owner],
        )

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
        parts, step = self.model.components, np.diff(self.record.time)
        along, turn = self.along, self.turn
        noise, first, driving, together, kept, gained, _ = self._smoothed(white)
        # what drives a process to the next sample has the variance 1 - a² - t² over that of the process, and with what
        # drives its partner the covariance -(a t' + t a'), a' and t' those of the partner
        along_other, turn_other = along[:, parts.partner], turn[:, parts.partner]
        new, new_together = 1.0 - along**2 - turn**2, -(along * turn_other + turn * along_other)
        of_std = first + np.sum(driving * new + together * new_together, axis=0)
        d_along, d_turn = parts.slopes_by_memory(step)
        d_new = -2.0 * (along * d_along + turn * d_turn)
        d_together = -(d_along * turn_other + along * d_turn[:, parts.partner])
        d_together -= d_turn * along_other + turn * d_along[:, parts.partner]
        by_driving = 0.5 * parts.variance * (driving * d_new + together * d_together)
        of_memory = np.sum(kept * d_along + gained * d_turn + by_driving, axis=0)
        of_frequency = step @ (gained * along - kept * turn)

        def of_processes(by_component: np.ndarray) -> np.ndarray:
            return np.bincount(parts.owner, by_component, minlength=len(self.model.processes))

        return Score(
            noise=np.sum(noise * self.model.noise_covariance(), axis=1),
            std=of_processes(of_std * parts.variance),
            memory=of_processes(of_memory),
            frequency=of_processes(parts.sense * of_frequency * 2.0 * np.pi * parts.frequency),
        )

    def courses(self, white: np.ndarray) -> np.ndarray:
        """Return the likeliest course of every process, (N, p): its smoothed mean.

        Parameters
        ----------
        white : ndarray, shape (n, n_channels)
            Standardised innovations of the residual.
        """
        courses, owner = self._smoothed(white[:, :, None])[-1], self.model.components.owner
        first = np.flatnonzero(np.diff(owner, prepend=-1))  # of one that swings the second component acts nowhere
        return courses[:, first]

    def _smoothed(self, white: np.ndarray) -> tuple[np.ndarray, ...]:
        """Run the smoother; return what `discrepancy.innovations.kernel.score_pass` writes."""
        parts = self.model.components
        noise, first = np.zeros((white.shape[1], white.shape[1])), np.zeros(parts.owner.size)
        written = (noise, first, *(np.zeros(self.along.shape) for _ in range(4)), np.zeros(self.latent.shape[:2]))
        white = np.ascontiguousarray(white)
        score_pass(*self._filter(), parts.variance, self.gain, self.root, self.latent, white, *written)
        return written

    def _filter(self) -> tuple[np.ndarray, ...]:
        """Return what the compiled recursions take of the record and of the processes."""
        r, parts = self.record, self.model.components
        machine = (r.phi, r.gamma0, r.gamma1, r.c, r.d, r.observed, r.counts)
        return (*machine, parts.source, parts.channel, parts.partner, self.along, self.turn)

    def _filtered(self, block: np.ndarray, inverse: bool) -> np.ndarray:
        columns = np.ascontiguousarray(block.reshape(*block.shape[:2], -1), dtype=float)
        out = np.empty_like(columns)
        filter_columns(
            *self._filter(),
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
    parts = model.components
    size = n + parts.owner.size
    gain, root, latent = (
        np.zeros((count, size, n_c)),
        np.zeros((count, n_c, n_c)),
        np.zeros((count, parts.owner.size, size)),
    )
    along, turn = parts.transitions(np.diff(record.time))
    log_det = covariance_pass(
        record.phi,
        record.gamma0,
        record.gamma1,
        record.c,
        record.d,
        record.counts,
        parts.source,
        parts.channel,
        parts.partner,
        along,
        turn,
        parts.variance,
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
