"""The noise model of a residual, by restricted marginal likelihood."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from discrepancy.innovations.linear_record import LinearRecord
from discrepancy.innovations.noise_model import NoiseModel, Process, innovation_weighting
from multibody.base.parallel import parallel_map

__all__ = ["RecordColumns", "fit_noise", "likeliest_change", "prior_precision", "restricted_log_likelihood"]

#: Nats by which a further process must raise the likelihood; it costs two parameters, of which one is at its bound
#: where there is no such process.
WORTH = 4.0
MOST_PROCESSES = 6
#: Processes of each kind that are tried again in the next round: those that raised the likelihood most.  The kinds are
#: forces, forces at a standstill, and errors of outputs: the first to be found must not crowd out the others.
PROMISING = 4
#: Standard deviations of a process that are tried first, in units of what moves an output by its noise.
FIRST_SIZES = (0.3, 3.0, 30.0)
#: Factors on the memory of a process that was added, of which each is tried: the memories offered are a coarse grid.
MEMORY_FACTORS = (0.4, 2.5)
#: Change of a log standard deviation over which derivatives are taken, most iterations, and how far it may move in all:
#: by a factor of 400.
STEP, ROUNDS, FURTHEST = 1e-3, 30, 6.0
#: Nats per factor e of a standard deviation below which the likelihood counts as level, and most points of a line
#: search: what they give away is far below `WORTH`.
STEEP, LINE_SEARCH = 0.3, 6
HOPELESS = 1e4  # nats below the start that a model counts as where its likelihood cannot be computed
#: Samples × outputs of the records, thinned out, on which it is decided which process to try next.
SCREENING_ROWS = 1500
#: Updates of the correlation of the outputs' white noise, and its least eigenvalue: a command that a sampled controller
#: makes of noisy measurements has their noise some time later, so no combination of outputs is nearly free of noise.
CORRELATION_ROUNDS, LEAST_EIGENVALUE = 3, 0.05
#: Root of the prior precision of a record's own unknowns, over that with which the record determines the best of them:
#: the prior is a thousand times as wide.  With dry friction the record soon no longer depends on the initial speed, and
#: the determinant of such an unknown, without a prior, is a matter of rounding.
OWN_PRIOR = 1e-3
LEAST_EIGENVALUE_OF_NORMAL = 1e-12  # of the scaled normal matrix: directions below are not known at all
CLOSE = 0.05  # nats that an iteration must gain, or it is the last: far below what two models are told apart by


@dataclass(frozen=True, eq=False, kw_only=True)
class WhitenedRecord:
    """One record as innovations, free of its own unknowns.

    Parameters
    ----------
    residual : ndarray, shape (n · n_c,)
    shared : ndarray, shape (n · n_c, k)
    log_root : ndarray, shape (n,)
        Log-determinant of every sample's whitening: minus half that of the covariance of its innovations; zero where it
        does not count.
    own_log_det : float
        Half the log-determinant of the own unknowns' normal matrix, priors included, in units of their columns.
    """

    residual: np.ndarray
    shared: np.ndarray
    log_root: np.ndarray
    own_log_det: float


@dataclass(frozen=True, eq=False, kw_only=True)
class RecordColumns:
    """One record's residual and what may explain it, before whitening.

    Parameters
    ----------
    record : LinearRecord
    residual : ndarray, shape (n, n_c)
    shared : ndarray, shape (n, n_c, k)
        Derivatives by parameters that all records share.
    own : ndarray, shape (n, n_c, q)
        Derivatives by the record's own unknowns.
    """

    record: LinearRecord
    residual: np.ndarray
    shared: np.ndarray
    own: np.ndarray

    def whitened(self, model: NoiseModel) -> WhitenedRecord:
        """Return residual and shared columns as innovations, free of the own unknowns.

        These have independent normal priors, so wide that they matter only for unknowns that the record hardly
        determines.
        """
        weighting = innovation_weighting(self.record, model)
        together = np.concatenate([self.residual[:, :, None], self.shared, self.own], axis=2)
        flat = weighting(together).reshape(-1, together.shape[2])
        k, own_log_det = self.shared.shape[2], 0.0
        if self.own.shape[2]:
            own = flat[:, 1 + k :]
            size = np.maximum(np.linalg.norm(self.own.reshape(-1, own.shape[1]), axis=0), 1e-300)
            u, singular, _ = np.linalg.svd(own / size, full_matrices=False)
            precision = (OWN_PRIOR * singular[0]) ** 2
            information = np.maximum(singular**2 + precision, 1e-300)
            left = np.sqrt(precision / information)
            flat = flat[:, : 1 + k] - u @ ((1.0 - left)[:, None] * (u.T @ flat[:, : 1 + k]))
            own_log_det = 0.5 * float(np.sum(np.log(information)))
        root = np.diagonal(weighting.root[self.record.observed], axis1=1, axis2=2)
        return WhitenedRecord(
            residual=flat[:, 0],
            shared=flat[:, 1 : 1 + k],
            log_root=np.log(np.where(self.record.used[:, None], root, 1.0)).sum(axis=1),
            own_log_det=own_log_det,
        )

    def every(self, count: int) -> RecordColumns:
        """Return the same on every so-manieth sample."""
        if count == 1:
            return self
        rows = np.cumsum(self.record.observed) - 1
        thinned = self.record.every(count)
        kept = rows[np.arange(0, self.record.time.size, count)][thinned.observed]
        return RecordColumns(record=thinned, residual=self.residual[kept], shared=self.shared[kept], own=self.own[kept])

    def innovations(self, model: NoiseModel) -> tuple[np.ndarray, np.ndarray]:
        """Return the standardised innovations of the samples that count, and their roots.

        Returns
        -------
        innovations : ndarray, shape (n_used, n_c)
            Free of the linear unknowns.
        root : ndarray, shape (n_used, n_c, n_c)
        """
        weighting = innovation_weighting(self.record, model)
        together = np.concatenate([self.residual[:, :, None], self.shared, self.own], axis=2)
        flat = weighting(together).reshape(-1, together.shape[2])
        basis = flat[:, 1:] / np.maximum(np.linalg.norm(flat[:, 1:], axis=0), 1e-300)
        left = flat[:, 0] - basis @ np.linalg.lstsq(basis, flat[:, 0], rcond=1e-10)[0]
        used = self.record.used
        return left.reshape(self.residual.shape)[used], weighting.root[self.record.counts]


def prior_precision(prior_std: np.ndarray) -> np.ndarray:
    """Return the inverse variances of normal priors; zero where there is none (an infinite deviation)."""
    return np.where(np.isfinite(prior_std), 1.0 / np.where(np.isfinite(prior_std), prior_std, 1.0) ** 2, 0.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Normal:
    """Normal equations of the shared parameters, and what the likelihood needs beside them."""

    matrix: np.ndarray
    right: np.ndarray
    constant: float

    @classmethod
    def of(
        cls, records: Sequence[RecordColumns], model: NoiseModel, prior_std: np.ndarray, prior_offset: np.ndarray
    ) -> _Normal:
        precision = prior_precision(prior_std)
        known = precision > 0.0
        matrix, right = np.diag(precision), precision * prior_offset
        constant = -0.5 * float(np.sum(precision * prior_offset**2)) + 0.5 * float(np.sum(np.log(precision[known])))
        for white in parallel_map(lambda r: r.whitened(model), records):
            e, f = white.residual, white.shared
            constant += float(np.sum(white.log_root)) - white.own_log_det - 0.5 * float(e @ e)
            matrix = matrix + f.T @ f
            right = right + f.T @ e
        return cls(matrix=matrix, right=right, constant=constant)

    @property
    def finite(self) -> bool:
        return bool(np.isfinite(self.constant) and np.all(np.isfinite(self.matrix)))

    def solved(self) -> tuple[np.ndarray, float, float]:
        """Return the parameters' change, half the decrease of the quadratic form, and half the log-determinant."""
        if not self.right.size:
            return self.right, 0.0, 0.0
        size = np.sqrt(np.maximum(np.diag(self.matrix), 1e-300))
        values, vectors = np.linalg.eigh(self.matrix / np.outer(size, size))
        kept = values > LEAST_EIGENVALUE_OF_NORMAL
        along = vectors.T @ (self.right / size)
        change = vectors[:, kept] @ (along[kept] / values[kept]) / size
        half_log_det = 0.5 * float(np.sum(np.log(values[kept]))) + float(np.sum(np.log(size)))
        return change, 0.5 * float(np.sum(along[kept] ** 2 / values[kept])), half_log_det


def restricted_log_likelihood(
    records: Sequence[RecordColumns], model: NoiseModel, prior_std: np.ndarray, prior_offset: np.ndarray
) -> float:
    """Return the log marginal likelihood of a noise model, every linear unknown integrated out.

    Parameters
    ----------
    records : sequence of RecordColumns
    model : NoiseModel
    prior_std, prior_offset : ndarray, shape (k,)
        Of the shared parameters: standard deviation (infinite: none), and mean minus the value of the linearisation.
    """
    try:
        normal = _Normal.of(records, model, prior_std, prior_offset)
        if not normal.finite:
            return -np.inf
        _, gain, half_log_det = normal.solved()
    except np.linalg.LinAlgError:
        return -np.inf
    total = normal.constant + gain - half_log_det
    return total if np.isfinite(total) else -np.inf


def likeliest_change(
    records: Sequence[RecordColumns], model: NoiseModel, prior_std: np.ndarray, prior_offset: np.ndarray
) -> np.ndarray:
    """Return by how much the shared parameters differ from the linearisation's at the largest likelihood, (k,)."""
    return _Normal.of(records, model, prior_std, prior_offset).solved()[0]


def fit_noise(
    records: Sequence[RecordColumns],
    prior_std: np.ndarray,
    prior_offset: np.ndarray,
    floor: np.ndarray,
    candidates: Sequence[Process],
    start: NoiseModel | None = None,
    *,
    grow: bool = True,
) -> tuple[NoiseModel, float]:
    """Return the noise model with the largest restricted likelihood, and that likelihood.

    Begins with white noise, or with ``start``; then processes are added one after another, the one that raises the
    likelihood most, as long as it does so by more than `WORTH`.

    Parameters
    ----------
    records : sequence of RecordColumns
    prior_std, prior_offset : ndarray, shape (k,)
    floor : ndarray, shape (n_c,)
        Least standard deviation of the white noise of each output, SI.
    candidates : sequence of Process
        With the standard deviation that moves some output by its noise.
    start : NoiseModel, optional
    grow : bool
        False: fit the standard deviations of ``start`` only.
    """

    def likelihood(model: NoiseModel) -> float:
        return restricted_log_likelihood(records, model, prior_std, prior_offset)

    if start is None:
        left = np.sqrt(np.mean(np.concatenate([r.residual[r.record.used] for r in records]) ** 2, axis=0))
        start = NoiseModel(noise=tuple(np.maximum(left, floor).tolist()))
    model, best = _climb(*_with_correlation(start, records, likelihood, floor), likelihood, floor)
    promising = list(candidates)
    rows = sum(r.residual.size for r in records)
    thinned = [r.every(max(1, min(rows // SCREENING_ROWS, len(r.residual) // 50))) for r in records]

    def screened(model: NoiseModel) -> float:
        return restricted_log_likelihood(thinned, model, prior_std, prior_offset)

    while grow and len(model.processes) < MOST_PROCESSES:
        tried = []
        for process in promising:
            if any(_same_process(q, process) for q in model.processes):
                continue
            sizes = (replace(process, std=size * process.std) for size in FIRST_SIZES)
            trials = [replace(model, processes=(*model.processes, q)) for q in sizes]
            tried.append((*max(((screened(t), t) for t in trials), key=lambda t: t[0]), process))
        if not tried:
            break
        tried.sort(key=lambda t: -t[0])
        kinds = {_kind(process): [t for t in tried if _kind(t[-1]) == _kind(process)] for *_, process in tried}
        promising = [process for of_kind in kinds.values() for *_, process in of_kind[:PROMISING]]
        # the best of each kind is fitted: which of them it is, a thinned record may not tell
        best_of = [of_kind[0][1] for of_kind in kinds.values()]
        climbed = [_climb(trial, likelihood(trial), likelihood, floor) for trial in best_of]
        fitted, value = max(climbed, key=lambda t: t[1])
        fitted, value = _with_memory(fitted, value, likelihood, floor)
        fitted, value = _climb(*_with_correlation(fitted, records, likelihood, floor), likelihood, floor)
        if value < best + WORTH:
            break
        model, best = fitted, value
    return model, best


def _kind(process: Process) -> tuple[bool, bool]:
    return process.channel >= 0, process.at_standstill


def _same_process(one: Process, other: Process) -> bool:
    return (one.source, one.channel, one.memory) == (other.source, other.channel, other.memory)


def _with_memory(
    model: NoiseModel, value: float, likelihood: Callable[[NoiseModel], float], floor: np.ndarray
) -> tuple[NoiseModel, float]:
    """Return the model with the memory of its last process changed, as long as that is likelier."""
    for factor in MEMORY_FACTORS:
        better = False
        while True:
            *others, last = model.processes
            # what drives the process keeps its size
            changed = replace(last, memory=factor * last.memory, std=float(np.sqrt(factor)) * last.std)
            trial = replace(model, processes=(*others, changed))
            fitted, reached = _climb(trial, likelihood(trial), likelihood, floor)
            if not reached > value + CLOSE:
                break
            model, value, better = fitted, reached, True
        if better:
            break
    return model, value


def _with_correlation(
    model: NoiseModel,
    records: Sequence[RecordColumns],
    likelihood: Callable[[NoiseModel], float],
    floor: np.ndarray,
) -> tuple[NoiseModel, float]:
    """Return the model with the covariance of the white noise that the innovations ask for, if that is likelier."""
    value = likelihood(model)
    n_c = len(model.noise)
    if n_c == 1 or not np.isfinite(value):
        return model, value
    for _ in range(CORRELATION_ROUNDS):
        excess, count = np.zeros((n_c, n_c)), 0
        for record in records:
            e, root = record.innovations(model)
            factor = np.linalg.inv(root)
            spread = np.einsum("ki,kj->kij", e, e) - np.eye(n_c)
            excess += np.sum(factor @ spread @ factor.transpose(0, 2, 1), axis=0)
            count += len(e)
        for share in (1.0, 0.3):
            covariance = model.noise_covariance() + share * excess / count
            trial = _noise_of(model, covariance, floor)
            reached = likelihood(trial)
            if reached > value:
                break
        if not reached > value + CLOSE:
            break
        model, value = trial, reached
    return model, value


def _noise_of(model: NoiseModel, covariance: np.ndarray, floor: np.ndarray) -> NoiseModel:
    std = np.maximum(np.sqrt(np.maximum(np.diag(covariance), 0.0)), floor)
    values, vectors = np.linalg.eigh(covariance / np.outer(std, std))
    covariance = (vectors * np.maximum(values, LEAST_EIGENVALUE)) @ vectors.T
    size = np.sqrt(np.diag(covariance))
    return replace(model, noise=tuple(std.tolist()), correlation=covariance / np.outer(size, size))


def _climb(
    model: NoiseModel, value: float, likelihood: Callable[[NoiseModel], float], floor: np.ndarray
) -> tuple[NoiseModel, float]:
    """Maximise over the logarithms of all standard deviations (L-BFGS-B), beginning at a model and its likelihood."""
    from scipy.optimize import Bounds, minimize

    n_c = len(model.noise)

    def at(x: np.ndarray) -> NoiseModel:
        std = np.exp(x)
        processes = tuple(replace(q, std=float(s)) for q, s in zip(model.processes, std[n_c:], strict=True))
        return replace(model, noise=tuple(std[:n_c].tolist()), processes=processes)

    begin = np.log([*model.noise, *(max(q.std, 1e-300) for q in model.processes)])
    least = np.concatenate([np.log(floor), begin[n_c:] - FURTHEST])
    begin = np.maximum(begin, least)

    def loss(x: np.ndarray) -> float:
        return -max(likelihood(at(x)), value - HOPELESS)

    bounds: Any = Bounds(least, begin + FURTHEST)
    result = minimize(
        loss,
        begin,
        method="L-BFGS-B",
        bounds=bounds,
        options={
            "eps": STEP,
            "maxiter": ROUNDS,
            "maxls": LINE_SEARCH,
            "gtol": STEEP,
            "ftol": CLOSE / max(abs(value), 1.0),
        },
    )
    reached = -float(result.fun)
    return (at(result.x), reached) if reached > value else (model, value)
