"""The restricted marginal likelihood of a noise model: every linear unknown is integrated out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from discrepancy.innovations.linear_record import LinearRecord
from discrepancy.innovations.noise_model import NoiseModel, innovation_weighting
from multibody.base.parallel import parallel_map

__all__ = [
    "RecordColumns",
    "RestrictedLikelihood",
    "gains_of_random_columns",
    "likeliest_change",
    "prior_precision",
    "restricted_log_likelihood",
]

LEAST_EIGENVALUE_OF_NORMAL = 1e-12  # of the scaled normal matrix: directions below are not known at all


@dataclass(frozen=True, eq=False, kw_only=True)
class WhitenedRecord:
    """One record as innovations, free of its own unknowns.

    Parameters
    ----------
    residual : ndarray, shape (n · n_c,)
    shared : ndarray, shape (n · n_c, k)
    root : ndarray, shape (n_used, n_c, n_c)
        Whitening of every sample that counts: inverse of the lower Cholesky factor of its innovations' covariance.
    log_root : ndarray, shape (n,)
        Its log-determinant: minus half that of the covariance of its innovations; zero where it does not count.
    own_log_det : float
        Half the log-determinant of the own unknowns' normal matrix, in units of their columns.
    """

    residual: np.ndarray
    shared: np.ndarray
    root: np.ndarray
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
        """Return residual and shared columns as innovations, free of the own unknowns."""
        weighting = innovation_weighting(self.record, model)
        together = np.concatenate([self.residual[:, :, None], self.shared, self.own], axis=2)
        flat = weighting(together).reshape(-1, together.shape[2])
        k, own_log_det = self.shared.shape[2], 0.0
        if self.own.shape[2]:
            own = flat[:, 1 + k :]
            size = np.maximum(np.linalg.norm(self.own.reshape(-1, own.shape[1]), axis=0), 1e-300)
            q, r = np.linalg.qr(own / size)
            kept = np.abs(np.diag(r)) > 1e-12 * np.max(np.abs(np.diag(r)), initial=0.0)
            q = q[:, kept]
            flat = flat[:, : 1 + k] - q @ (q.T @ flat[:, : 1 + k])
            own_log_det = float(np.sum(np.log(np.abs(np.diag(r)[kept]))))
        root = np.diagonal(weighting.root[self.record.observed], axis1=1, axis2=2)
        return WhitenedRecord(
            residual=flat[:, 0],
            shared=flat[:, 1 : 1 + k],
            root=weighting.root[self.record.counts],
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
    whitened: tuple[WhitenedRecord, ...]

    @classmethod
    def of(
        cls, records: Sequence[RecordColumns], model: NoiseModel, prior_std: np.ndarray, prior_offset: np.ndarray
    ) -> _Normal:
        precision = prior_precision(prior_std)
        known = precision > 0.0
        matrix, right = np.diag(precision), precision * prior_offset
        constant = -0.5 * float(np.sum(precision * prior_offset**2)) + 0.5 * float(np.sum(np.log(precision[known])))
        whitened = tuple(parallel_map(lambda r: r.whitened(model), records))
        for white in whitened:
            e, f = white.residual, white.shared
            constant += float(np.sum(white.log_root)) - white.own_log_det - 0.5 * float(e @ e)
            matrix = matrix + f.T @ f
            right = right + f.T @ e
        return cls(matrix=matrix, right=right, constant=constant, whitened=whitened)

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


def gains_of_random_columns(
    records: Sequence[RecordColumns],
    model: NoiseModel,
    prior_std: np.ndarray,
    prior_offset: np.ndarray,
    groups: Sequence[np.ndarray],
    sizes: Sequence[float],
) -> list[tuple[float, float, np.ndarray]]:
    """Return by how much the likelihood rises with each of some groups of random columns.

    Parameters
    ----------
    records : sequence of RecordColumns
        The shared columns that ``prior_std`` does not have are the random ones.
    model : NoiseModel
    prior_std, prior_offset : ndarray, shape (k,)
        Of the other shared columns.
    groups : sequence of ndarray of int
        The random columns of each group, counted from the first of them.
    sizes : sequence of float
        Standard deviations of the weights that are tried.

    Returns
    -------
    list of (float, float, ndarray)
        For each group the gain in nats at the likeliest size, that size, and by how much all shared columns' factors
        are likelier to differ with the group than without it: first the others', then those of the group.
    """
    known = prior_std.size
    count = records[0].shared.shape[2] - known
    free = np.full(count, np.inf)
    normal = _Normal.of(records, model, np.append(prior_std, free), np.append(prior_offset, np.zeros(count)))
    if not normal.finite:
        return [(-np.inf, 0.0, np.zeros(known + g.size)) for g in groups]

    def solved(columns: np.ndarray, precision: float) -> tuple[np.ndarray, float]:
        more = np.concatenate([np.zeros(known), np.full(columns.size - known, precision)])
        matrix = normal.matrix[np.ix_(columns, columns)] + np.diag(more)
        change, quadratic, half_log_det = replace(normal, matrix=matrix, right=normal.right[columns]).solved()
        return change, quadratic - half_log_det

    own = np.arange(known)
    before, without = solved(own, 0.0)
    out = []
    for group in groups:
        best = -np.inf, 0.0, np.zeros(known + group.size)
        for size in sizes:
            change, value = solved(np.concatenate([own, known + group]), size**-2.0)
            gain = value - group.size * np.log(size) - without
            if gain > best[0]:
                change[:known] -= before
                best = float(gain), size, change
        out.append(best)
    return out


@dataclass(frozen=True, eq=False, kw_only=True)
class RestrictedLikelihood:
    """The restricted likelihood of some records, of noise models and of their derivatives.

    Parameters
    ----------
    records : sequence of RecordColumns
    prior_std, prior_offset : ndarray, shape (k,)
        Of the shared parameters: standard deviation (infinite: none), and mean minus the value of the linearisation.
    """

    records: Sequence[RecordColumns]
    prior_std: np.ndarray
    prior_offset: np.ndarray

    def __call__(self, model: NoiseModel) -> float:
        """Return the log likelihood of a noise model."""
        return restricted_log_likelihood(self.records, model, self.prior_std, self.prior_offset)

    def slopes(self, models: Sequence[NoiseModel], base: NoiseModel, step: float) -> tuple[np.ndarray, np.ndarray]:
        """Return gradient and Fisher information along the ways from one noise model to others.

        Parameters
        ----------
        models : sequence of NoiseModel
            Each one step away from ``base``.
        base : NoiseModel
        step : float

        Returns
        -------
        gradient : ndarray, shape (d,)
        information : ndarray, shape (d, d)
            Of Gaussian innovations e with whitening W: Σ ½ tr(Mᵢ Mⱼ) + ∂ᵢe·∂ⱼe, with M = ∂W W⁻¹ + (∂W W⁻¹)ᵀ.

        Raises
        ------
        numpy.linalg.LinAlgError
            If one of the models has no likelihood.
        """
        at = _Normal.of(self.records, base, self.prior_std, self.prior_offset)
        change, gain, half_log_det = at.solved()
        value, innovations = at.constant + gain - half_log_det, [w.residual - w.shared @ change for w in at.whitened]
        inverse = [np.linalg.inv(w.root) for w in at.whitened]
        gradient, moved = np.zeros(len(models)), []
        for j, model in enumerate(models):
            normal = _Normal.of(self.records, model, self.prior_std, self.prior_offset)
            _, gain, half_log_det = normal.solved()
            gradient[j] = (normal.constant + gain - half_log_det - value) / step
            columns = []
            for w, e, w0, inv in zip(normal.whitened, innovations, at.whitened, inverse, strict=True):
                turned = (w.root - w0.root) @ inv / step
                spread = turned + turned.transpose(0, 2, 1)
                columns += [(w.residual - w.shared @ change - e) / step, spread.ravel() / np.sqrt(2.0)]
            moved.append(np.concatenate(columns))
        stacked = np.array(moved)
        if not np.all(np.isfinite(stacked)):
            raise np.linalg.LinAlgError("the likelihood has no derivative")
        return gradient, stacked @ stacked.T
