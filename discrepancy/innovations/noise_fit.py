"""The noise model of a residual, by restricted marginal likelihood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from discrepancy.innovations.linear_record import LinearRecord
from discrepancy.innovations.noise_model import InnovationWeighting, NoiseModel, Process, Score, innovation_weighting

__all__ = [
    "FilteredRecord",
    "RecordColumns",
    "fit_noise",
    "likeliest_change",
    "likeliest_rise",
    "prior_precision",
    "restricted_log_likelihood",
    "restricted_log_likelihoods",
    "restricted_score",
]

#: Nats that the size and the memory of a process cost, which are maximised over: two parameters, of which one is at
#: its bound where there is no such process.
PROCESS_PRICE = 4.0
#: Nats by which the likelihood may fall without a process, before the others are fitted anew, so that it is tried
#: without; chosen, several times `PROCESS_PRICE`.
NEARLY = 40.0
MOST_PROCESSES = 6
#: Processes of each place that are fitted to the records thinned out, the most of all places, and those that are then
#: fitted to all samples.  The likelihood has many maxima, and what promises most at the sizes, memories and frequencies
#: that are offered is often not what is worth most when these are fitted.  When the best of each kind was fitted to all
#: samples at once, four of six noise models ended 49 to 596 nats lower.  With two instead of four that are fitted to
#: all samples, 9 of 53 noise models ended more than 10 nats below the best of all ways that were tried, with four 7.
PER_PLACE, THINNED_FITS, FITS = 2, 8, 4
#: Standard deviations of a process that are tried first, in units of what moves an output by its noise.
FIRST_SIZES = (0.3, 3.0, 30.0)
#: Most iterations, and how far the logarithms of a standard deviation and of a memory may move in all: by a factor of
#: 400; of a frequency by an octave, to the next that is offered.
ROUNDS, FURTHEST, FURTHEST_FREQUENCY = 30, 6.0, 0.7
#: Slope, over coordinates in which the likelihood is about as curved as a unit normal distribution, below which it
#: counts as level, and most points of a line search: what they give away is far below `PROCESS_PRICE`.
STEEP, LINE_SEARCH = 0.3, 6
HOPELESS = 1e4  # nats below the start that a model counts as where its likelihood cannot be computed
#: Samples × outputs of the records, thinned out, on which it is decided which process to try next.
SCREENING_ROWS = 1500
#: Samples that every record keeps there, at least; chosen.
FEWEST_SCREENED = 50
#: Updates of the correlation of the outputs' white noise, and its least eigenvalue: a command that a sampled controller
#: makes of noisy measurements has their noise some time later, so no combination of outputs is nearly free of noise.
CORRELATION_ROUNDS, LEAST_EIGENVALUE = 3, 0.05
LEAST_EIGENVALUE_OF_NORMAL = 1e-12  # of the scaled normal matrix: directions below are not known at all
CLOSE = 0.05  # nats that an iteration must gain, or it is the last: far below what decides between two models


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
        Half the log-determinant of the own unknowns' normal matrix, priors included, in units of the priors.
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
    spread : ndarray, shape (n_c,)
        Standard deviation of each measured output, SI.
    """

    record: LinearRecord
    residual: np.ndarray
    shared: np.ndarray
    own: np.ndarray
    spread: np.ndarray

    @cached_property
    def _together(self) -> np.ndarray:
        """Residual, shared columns and own unknowns in units of their priors side by side, (n, n_c, 1 + k + q)."""
        moved = np.mean(np.sum((self.own / self.spread[:, None]) ** 2, axis=1), axis=0)
        own = self.own / np.maximum(np.sqrt(moved), 1e-300)
        return np.concatenate([self.residual[:, :, None], self.shared, own], axis=2)

    def whitened(self, model: NoiseModel) -> WhitenedRecord:
        """Return residual and shared columns as innovations, free of the own unknowns."""
        return self.filtered(model).whitened()

    def filtered(self, model: NoiseModel) -> FilteredRecord:
        """Return residual, shared columns and own unknowns as innovations.

        The own unknowns have independent normal priors with a standard deviation of what moves the outputs by their
        spread, in the mean over the record.  That is far more than a record leaves open, so it matters only for
        unknowns that the record hardly determines: with dry friction it soon no longer depends on the initial speed,
        and the determinant of such an unknown, without a prior, is a matter of rounding.
        """
        weighting = innovation_weighting(self.record, model)
        flat = weighting(self._together).reshape(-1, self._together.shape[2])
        k = self.shared.shape[2]
        basis, singular, _ = np.linalg.svd(flat[:, 1 + k :], full_matrices=False)
        return FilteredRecord(
            columns=self,
            weighting=weighting,
            white=np.ascontiguousarray(flat[:, : 1 + k]),
            basis=basis,
            information=singular**2,
        )

    def every(self, count: int) -> RecordColumns:
        """Return the same on every so-manieth sample."""
        if count == 1:
            return self
        rows = np.cumsum(self.record.observed) - 1
        thinned = self.record.every(count)
        kept = rows[np.arange(0, self.record.time.size, count)][thinned.observed]
        return replace(self, record=thinned, residual=self.residual[kept], shared=self.shared[kept], own=self.own[kept])

    def innovations(self, model: NoiseModel) -> tuple[np.ndarray, np.ndarray]:
        """Return the standardised innovations of the samples that count, and their roots.

        Returns
        -------
        innovations : ndarray, shape (n_used, n_c)
            Free of the linear unknowns.
        root : ndarray, shape (n_used, n_c, n_c)
        """
        weighting = innovation_weighting(self.record, model)
        flat = weighting(self._together).reshape(-1, self._together.shape[2])
        basis = flat[:, 1:] / np.maximum(np.linalg.norm(flat[:, 1:], axis=0), 1e-300)
        left = flat[:, 0] - basis @ np.linalg.lstsq(basis, flat[:, 0], rcond=1e-10)[0]
        used = self.record.used
        return left.reshape(self.residual.shape)[used], weighting.root[self.record.counts]


@dataclass(frozen=True, eq=False, kw_only=True)
class FilteredRecord:
    """One record as innovations, and the directions of its own unknowns among them.

    Parameters
    ----------
    columns : RecordColumns
    weighting : InnovationWeighting
    white : ndarray, shape (n · n_c, 1 + k)
        Residual and shared columns.
    basis : ndarray, shape (n · n_c, q)
        Orthonormal, of the own unknowns.
    information : ndarray, shape (q,)
        Of each of these directions, in units of its prior's.
    """

    columns: RecordColumns
    weighting: InnovationWeighting
    white: np.ndarray
    basis: np.ndarray
    information: np.ndarray

    def with_columns(self, more: np.ndarray) -> FilteredRecord:
        """Return the same with further shared columns, shape (n, n_c, m) before whitening."""
        white = self.weighting(more).reshape(-1, more.shape[2])
        return replace(self, white=np.concatenate([self.white, white], axis=1))

    def with_residual(self, residual: np.ndarray) -> FilteredRecord:
        """Return the same with another residual, shape (n, n_c) before whitening."""
        white = self.weighting(residual[:, :, None]).reshape(-1, 1)
        return replace(self, white=np.concatenate([white, self.white[:, 1:]], axis=1))

    def without_own(self, power: float) -> np.ndarray:
        """Return the white columns without what the own unknowns explain of them.

        Parameters
        ----------
        power : float
            1 for what is left beside their likeliest values; 0.5 for columns whose products are those of the marginal
            likelihood.
        """
        left = (1.0 + self.information) ** -power
        free: np.ndarray = self.white - self.basis @ ((1.0 - left)[:, None] * (self.basis.T @ self.white))
        return free

    def whitened(self) -> WhitenedRecord:
        """Return residual and shared columns free of the own unknowns."""
        record, flat = self.columns.record, self.without_own(0.5)
        root = np.diagonal(self.weighting.root[record.observed], axis1=1, axis2=2)
        return WhitenedRecord(
            residual=flat[:, 0],
            shared=flat[:, 1:],
            log_root=np.log(np.where(record.used[:, None], root, 1.0)).sum(axis=1),
            own_log_det=0.5 * float(np.sum(np.log1p(self.information))),
        )

    def courses(self, change: np.ndarray) -> np.ndarray:
        """Return the likeliest course of every process at a change of the shared parameters, (N, p)."""
        free = self.without_own(1.0)
        left = free[:, 0] - free[:, 1:] @ change
        return self.weighting.courses(left.reshape(self.columns.residual.shape))

    def score(self, change: np.ndarray, shared_root: np.ndarray) -> Score:
        """Return the derivatives of the marginal likelihood.

        Parameters
        ----------
        change : ndarray, shape (k,)
            Of the shared parameters, at the largest likelihood.
        shared_root : ndarray, shape (k, r)
            Root of their covariance.
        """
        free = self.without_own(1.0)
        left = free[:, :1] - free[:, 1:] @ change[:, None]
        own = self.basis * np.sqrt(self.information / (1.0 + self.information))
        together = np.concatenate([left, free[:, 1:] @ shared_root, own], axis=1)
        return self.weighting.score(together.reshape(*self.columns.residual.shape, -1))


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
    def of(cls, records: Sequence[FilteredRecord], count: int) -> _Normal:
        """Return what the records say of so many shared parameters."""
        matrix, right, constant = np.zeros((count, count)), np.zeros(count), 0.0
        for record in records:
            white = record.whitened()
            e, f = white.residual, white.shared
            constant += float(np.sum(white.log_root)) - white.own_log_det - 0.5 * float(e @ e)
            matrix = matrix + f.T @ f
            right = right + f.T @ e
        return cls(matrix=matrix, right=right, constant=constant)

    def with_prior(self, std: np.ndarray, offset: np.ndarray) -> _Normal:
        """Return the same with normal priors of the parameters."""
        precision = prior_precision(std)
        known = precision > 0.0
        constant = -0.5 * float(np.sum(precision * offset**2)) + 0.5 * float(np.sum(np.log(precision[known])))
        return _Normal(
            matrix=self.matrix + np.diag(precision),
            right=self.right + precision * offset,
            constant=self.constant + constant,
        )

    @property
    def finite(self) -> bool:
        return bool(np.isfinite(self.constant) and np.all(np.isfinite(self.matrix)))

    def solved(self) -> Solved:
        """Return the parameters' likeliest change, and the likelihood."""
        if not self.right.size:
            return Solved(change=self.right, rise=0.0, root=np.zeros((0, 0)), log_likelihood=self.constant)
        size = np.sqrt(np.maximum(np.diag(self.matrix), 1e-300))
        values, vectors = np.linalg.eigh(self.matrix / np.outer(size, size))
        kept = values > LEAST_EIGENVALUE_OF_NORMAL
        along = vectors.T @ (self.right / size)
        half_log_det = 0.5 * float(np.sum(np.log(values[kept]))) + float(np.sum(np.log(size)))
        return Solved(
            change=vectors[:, kept] @ (along[kept] / values[kept]) / size,
            rise=0.5 * float(np.sum(along[kept] ** 2 / values[kept])),
            root=vectors[:, kept] / np.sqrt(values[kept]) / size[:, None],
            log_likelihood=self.constant + 0.5 * float(np.sum(along[kept] ** 2 / values[kept])) - half_log_det,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Solved:
    """The shared parameters under a noise model.

    Parameters
    ----------
    change : ndarray, shape (k,)
        From the linearisation's values, at the largest likelihood.
    rise : float
        Nats by which the likelihood is larger there than without a change.
    root : ndarray, shape (k, r)
        Root of their covariance.
    log_likelihood : float
        Marginal: every linear unknown is integrated out.
    """

    change: np.ndarray
    rise: float
    root: np.ndarray
    log_likelihood: float


def _solved(
    records: Sequence[RecordColumns], model: NoiseModel, prior_std: np.ndarray, prior_offset: np.ndarray
) -> tuple[list[FilteredRecord], Solved] | None:
    """Return the records as innovations and what follows for the parameters; None where it cannot be computed."""
    try:
        filtered = [r.filtered(model) for r in records]  # too short for threads
        normal = _Normal.of(filtered, prior_std.size).with_prior(prior_std, prior_offset)
        solved = normal.solved() if normal.finite else None
    except np.linalg.LinAlgError:
        return None
    return (filtered, solved) if solved is not None and np.isfinite(solved.log_likelihood) else None


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
    done = _solved(records, model, prior_std, prior_offset)
    return -np.inf if done is None else done[1].log_likelihood


def restricted_log_likelihoods(
    records: Sequence[FilteredRecord], priors: Sequence[tuple[np.ndarray, np.ndarray]]
) -> list[float]:
    """Return the log marginal likelihood under several priors, which costs hardly more than under one.

    Parameters
    ----------
    records : sequence of FilteredRecord
        Under a noise model.
    priors : sequence of (prior_std, prior_offset)
        Of the same shared parameters, as in `restricted_log_likelihood`.
    """
    try:
        normal = _Normal.of(records, priors[0][0].size)
        each = [normal.with_prior(*prior) for prior in priors]
        values = [n.solved().log_likelihood if n.finite else -np.inf for n in each]
    except np.linalg.LinAlgError:
        return [-np.inf] * len(priors)
    return [value if np.isfinite(value) else -np.inf for value in values]


def restricted_score(
    records: Sequence[RecordColumns], model: NoiseModel, prior_std: np.ndarray, prior_offset: np.ndarray
) -> tuple[float, Score]:
    """Return the log marginal likelihood of a noise model and its derivatives.

    Parameters
    ----------
    records, model, prior_std, prior_offset
        As in `restricted_log_likelihood`.

    Returns
    -------
    value : float
    score : Score
        Zero where the likelihood cannot be computed.
    """
    done = _solved(records, model, prior_std, prior_offset)
    if done is None:
        none = np.zeros(len(model.processes))
        return -np.inf, Score(noise=np.zeros(len(model.noise)), std=none, memory=none, frequency=none)
    filtered, solved = done
    return solved.log_likelihood, Score.total([r.score(solved.change, solved.root) for r in filtered])


def likeliest_change(
    records: Sequence[RecordColumns], model: NoiseModel, prior_std: np.ndarray, prior_offset: np.ndarray
) -> np.ndarray:
    """Return by how much the shared parameters differ from the linearisation's at the largest likelihood, (k,)."""
    done = _solved(records, model, prior_std, prior_offset)
    return np.zeros(prior_std.size) if done is None else done[1].change


def likeliest_rise(
    records: Sequence[RecordColumns], model: NoiseModel, prior_std: np.ndarray, prior_offset: np.ndarray
) -> float:
    """Return the nats by which the likelihood is larger at that change than without one."""
    done = _solved(records, model, prior_std, prior_offset)
    return 0.0 if done is None else done[1].rise


@dataclass(frozen=True, eq=False, kw_only=True)
class _Objective:
    """The likelihood of noise models for some records.

    Parameters
    ----------
    records : sequence of RecordColumns
    prior_std, prior_offset : ndarray, shape (k,)
    floor : ndarray, shape (n_c,)
    """

    records: Sequence[RecordColumns]
    prior_std: np.ndarray
    prior_offset: np.ndarray
    floor: np.ndarray

    def value(self, model: NoiseModel) -> float:
        """Return the log marginal likelihood."""
        return restricted_log_likelihood(self.records, model, self.prior_std, self.prior_offset)

    @property
    def count(self) -> int:
        """Samples of all records."""
        return sum(len(r.residual) for r in self.records)

    def climbed_from(
        self, reached: tuple[NoiseModel, float], other: _Objective, kept: NoiseModel
    ) -> tuple[NoiseModel, float]:
        """Return a model that was fitted to another objective, with its value there, fitted to this one.

        It begins as it was fitted there, or, where that is likelier, with the noise and the first processes of
        ``kept``, which were fitted to this one: on records thinned out the others may come to stand for what is fast.
        """
        if other is self:
            return reached
        starts = [reached[0], replace(kept, processes=(*kept.processes, *reached[0].processes[len(kept.processes) :]))]
        return self.climbed(*max(((start, self.value(start)) for start in starts), key=lambda t: t[1]))

    def curvature(self, model: NoiseModel) -> np.ndarray:
        """Return about how curved the likelihood is over the logarithm of every standard deviation, shape (n_c + p,).

        Twice the number of values that are drawn independently: of a process, one in every memory.
        """
        durations = [float(np.ptp(r.record.time)) for r in self.records]
        drawn = [min(sum(1.0 + t / q.memory for t in durations), self.count) for q in model.processes]
        return 2.0 * np.array([*(self.count for _ in model.noise), *drawn])

    def climbed(self, model: NoiseModel, value: float) -> tuple[NoiseModel, float]:
        """Maximise over all standard deviations, memories and frequencies, beginning at a model and its likelihood.

        By L-BFGS-B over their logarithms.
        """
        from scipy.optimize import Bounds, minimize

        n_c, processes = len(model.noise), model.processes
        p = len(processes)
        swinging = [k for k, q in enumerate(processes) if q.frequency > 0.0]
        parts = np.cumsum([n_c, p, p])

        def at(x: np.ndarray) -> NoiseModel:
            noise, std, memory, frequency = (part.tolist() for part in np.split(np.exp(x), parts))
            moved = [replace(q, std=s, memory=m) for q, s, m in zip(processes, std, memory, strict=True)]
            for k, f in zip(swinging, frequency, strict=True):
                moved[k] = replace(moved[k], frequency=f)
            return replace(model, noise=tuple(noise), processes=tuple(moved))

        of_processes = [*(max(q.std, 1e-300) for q in processes), *(q.memory for q in processes)]
        begin = np.log([*model.noise, *of_processes, *(processes[k].frequency for k in swinging)])
        reach = np.repeat([FURTHEST, FURTHEST_FREQUENCY], [n_c + 2 * p, len(swinging)])
        least = begin - reach
        least[:n_c] = np.log(self.floor)
        begin = np.maximum(begin, least)
        curved = self.curvature(model)
        unit = 1.0 / np.sqrt(np.concatenate([curved, curved[n_c:], curved[n_c:][swinging]]))

        def loss(scaled: np.ndarray) -> tuple[float, np.ndarray]:
            x = scaled * unit
            reached, score = restricted_score(self.records, at(x), self.prior_std, self.prior_offset)
            if not reached > value - HOPELESS:
                return HOPELESS - value, np.zeros(x.size)
            slopes = np.concatenate([score.noise, score.std, score.memory, score.frequency[swinging]])
            return -reached, -slopes * unit

        bounds: Any = Bounds(least / unit, (begin + reach) / unit)
        result = minimize(
            loss,
            begin / unit,
            method="L-BFGS-B",
            jac=True,
            bounds=bounds,
            options={
                "maxiter": ROUNDS,
                "maxls": LINE_SEARCH,
                "gtol": STEEP,
                "ftol": CLOSE / max(abs(value), 1.0),
            },
        )
        reached = -float(result.fun)
        return (at(result.x * unit), reached) if reached > value else (model, value)


def fit_noise(
    records: Sequence[RecordColumns],
    prior_std: np.ndarray,
    prior_offset: np.ndarray,
    floor: np.ndarray,
    candidates: Sequence[Process],
    start: NoiseModel | None = None,
    *,
    price: float = PROCESS_PRICE,
    grow: bool = True,
    reduce: bool = True,
) -> tuple[NoiseModel, float]:
    """Return the noise model with the largest restricted likelihood, and that likelihood.

    Begins with white noise, or with ``start``; then processes are added one after another, the one that raises the
    likelihood most, as long as it does so by more than its price.

    Parameters
    ----------
    records : sequence of RecordColumns
    prior_std, prior_offset : ndarray, shape (k,)
    floor : ndarray, shape (n_c,)
        Least standard deviation of the white noise of each output, SI.
    candidates : sequence of Process
        With the standard deviation that moves some output by its noise.
    start : NoiseModel, optional
    price : float
        Nats by which a process must raise the likelihood.
    grow : bool
        False: add no process to those of ``start``.
    reduce : bool
        False: keep all of them, whether they earn their price or not.
    """
    whole = _Objective(records=records, prior_std=prior_std, prior_offset=prior_offset, floor=floor)
    rows = sum(r.residual.size for r in records)
    count = max(1, min(rows // SCREENING_ROWS, min(len(r.residual) for r in records) // FEWEST_SCREENED))
    thinned = whole if count == 1 else replace(whole, records=[r.every(count) for r in records])
    if start is None:
        left = np.sqrt(np.mean(np.concatenate([r.residual[r.record.used] for r in records]) ** 2, axis=0))
        start = NoiseModel(noise=tuple(np.maximum(left, floor).tolist()))
    model, best = whole.climbed(*_with_correlation(start, whole))
    if reduce:
        model, best = _without_needless(model, best, price, whole)
    while grow and len(model.processes) < MOST_PROCESSES:
        fitted, value = _with_another(model, best, candidates, thinned, whole)
        fitted, value = whole.climbed(*_with_correlation(fitted, whole))
        if value < best + price and len(model.processes) + 1 < MOST_PROCESSES:
            fitted, value = _with_two_for_one(model, best, candidates, thinned, whole)
        if value < best + price:
            break
        model, best = fitted, value
        if reduce:
            model, best = _without_needless(model, best, price, whole)
    return model, best


def _with_another(
    model: NoiseModel, value: float, candidates: Sequence[Process], thinned: _Objective, whole: _Objective
) -> tuple[NoiseModel, float]:
    """Return a noise model with the process that raises its likelihood most, as far as a few trials show.

    What promises most on the thinned records is fitted to all samples even where it promises little: a process that
    is faster than these hardly shows there.
    """
    there = thinned.climbed(model, thinned.value(model))
    fitted = [whole.climbed_from(trial, thinned, model) for trial in _promising(*there, candidates, thinned)[:FITS]]
    return max(fitted, key=lambda t: t[1], default=(model, value))


def _with_two_for_one(
    model: NoiseModel, value: float, candidates: Sequence[Process], thinned: _Objective, whole: _Objective
) -> tuple[NoiseModel, float]:
    """Return a noise model with two processes in the place of one, if that is likelier.

    One process stands for two at one place, a slow and a swinging force, by a short memory: then neither of the two
    adds anything beside it.
    """
    best, (_, reference) = (model, value), thinned.climbed(model, thinned.value(model))
    for k, process in enumerate(model.processes):
        others = replace(model, processes=(*model.processes[:k], *model.processes[k + 1 :]))
        without = thinned.climbed(others, thinned.value(others))
        there = [q for q in candidates if _place(q)[:2] == _place(process)[:2]]
        first = _promising(*without, [q for q in there if _place(q) != _place(process)], thinned, 1)[:1]
        second = [two for one in first for two in _promising(*one, there, thinned, 1)[:1]]
        fitted = [whole.climbed_from(two, thinned, others) for two in second if two[1] > reference]
        best = max([best, *fitted], key=lambda t: t[1])
    return best


def _promising(
    model: NoiseModel,
    value: float,
    candidates: Sequence[Process],
    thinned: _Objective,
    per_place: int = PER_PLACE,
) -> list[tuple[NoiseModel, float]]:
    """Return a noise model with one process more, fitted to the thinned records, and its likelihood, largest first.

    Of every place so many processes are fitted.  ``value`` is the likelihood of the model on the thinned records.
    """
    screened: dict[tuple[int, int, bool, bool], list[tuple[float, NoiseModel]]] = {}
    for process in candidates:
        screened.setdefault(_place(process), []).append(_likeliest_size(model, value, process, thinned))
    first = [t for at in screened.values() for t in sorted(at, key=lambda t: -t[0])[:per_place]]
    first = sorted(first, key=lambda t: -t[0])[:THINNED_FITS]
    return sorted((thinned.climbed(trial, reached) for reached, trial in first), key=lambda t: -t[1])


def _likeliest_size(model: NoiseModel, value: float, process: Process, thinned: _Objective) -> tuple[float, NoiseModel]:
    """Return a noise model with a process of the likeliest of the first sizes, and before it its likelihood.

    The smallest first, and a larger one as long as the likelihood rises: over the size it has one maximum as a rule, at
    zero for most processes.
    """
    best: tuple[float, NoiseModel] | None = None
    for size in FIRST_SIZES:
        trial = replace(model, processes=(*model.processes, replace(process, std=size * process.std)))
        reached = thinned.value(trial)
        if best is None or reached > best[0]:
            best = reached, trial
        if reached < max(value, best[0]):
            break
    assert best is not None
    return best


def _without_needless(model: NoiseModel, value: float, price: float, whole: _Objective) -> tuple[NoiseModel, float]:
    """Return the model without the processes that do not earn their price, one after another.

    A process that stood for an effect is of no use once that effect is part of the model, and yet the fit, which begins
    at its size, need not find the way to none: the likelihood often has a maximum at either.
    """
    while model.processes:
        fewer = []
        for k in range(len(model.processes)):
            trial = replace(model, processes=(*model.processes[:k], *model.processes[k + 1 :]))
            reached = whole.value(trial)
            if reached > value - NEARLY:
                fewer.append(whole.climbed(trial, reached))
        best = max(fewer, key=lambda t: t[1], default=None)
        if best is None or best[1] < value - price:
            break
        model, value = best
    return model, value


def _place(process: Process) -> tuple[int, int, bool, bool]:
    """Return where a process acts, and how it changes: forces at a standstill have columns of their own."""
    return process.source, process.channel, process.frequency > 0.0, process.smooth


def _with_correlation(model: NoiseModel, whole: _Objective) -> tuple[NoiseModel, float]:
    """Return the model with the covariance of the white noise that the innovations ask for, if that is likelier."""
    value = whole.value(model)
    n_c = len(model.noise)
    if n_c == 1 or not np.isfinite(value):
        return model, value
    for _ in range(CORRELATION_ROUNDS):
        excess, count = np.zeros((n_c, n_c)), 0
        for record in whole.records:
            e, root = record.innovations(model)
            factor = np.linalg.inv(root)
            spread = np.einsum("ki,kj->kij", e, e) - np.eye(n_c)
            excess += np.sum(factor @ spread @ factor.transpose(0, 2, 1), axis=0)
            count += len(e)
        for share in (1.0, 0.3):
            covariance = model.noise_covariance() + share * excess / count
            trial = _noise_of(model, covariance, whole.floor)
            reached = whole.value(trial)
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
