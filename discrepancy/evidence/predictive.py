"""What a model predicts of records that it was not fitted to: the log predictive score, block by block."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from discrepancy.evidence.likelihood import StageLikelihood, noise_floor, record_columns
from discrepancy.innovations.noise_model import innovation_weighting
from discrepancy.stages.stage import Stage

__all__ = [
    "PredictiveGain",
    "gain_of_errors",
    "held_out_errors",
    "predictive_gain",
    "simulation_gain",
]

#: Blocks that are left out in turn, at least: records, cut in parts where there are fewer.
BLOCKS = 8
LEAST_BLOCKS = 4  # of a simulation that is left out


@dataclass(frozen=True, kw_only=True)
class PredictiveGain:
    """By how much one model predicts blocks left out better than another, nats.

    Parameters
    ----------
    gain : float
        Sum over the blocks.
    standard_error : float
        Of that sum, from its spread over the blocks.
    blocks : int
    """

    gain: float
    standard_error: float
    blocks: int

    def exceeds(self, errors: float) -> bool:
        """Tell whether the gain is above zero by more than so many standard errors."""
        return self.gain > errors * self.standard_error


def predictive_gain(one: StageLikelihood, other: StageLikelihood) -> PredictiveGain:
    """Return by how much ``one`` predicts blocks of the identification records left out better than ``other``."""
    difference = predictive_scores(one) - predictive_scores(other)
    n = difference.size
    error = float(np.sqrt(n * np.var(difference, ddof=1))) if n > 1 else np.inf
    return PredictiveGain(gain=float(np.sum(difference)), standard_error=error, blocks=n)


@dataclass(frozen=True, kw_only=True)
class SimulationGain:
    """By how much one model simulates records left out better than another, output by output.

    Parameters
    ----------
    outputs : tuple of str
    share : ndarray, shape (n_c,)
        Of the mean square error of the other model that is gone; negative where the error has grown.
    standard_error : ndarray, shape (n_c,)
        Of that share, from its spread over the blocks.
    """

    outputs: tuple[str, ...]
    share: np.ndarray
    standard_error: np.ndarray

    def __str__(self) -> str:
        parts = zip(self.outputs, self.share, self.standard_error, strict=True)
        return ", ".join(f"{n} {100 * s:+.2g} ± {100 * e:.2g} %" for n, s, e in parts)

    def helps(self, least: float, errors: float) -> bool:
        """Tell whether some output is simulated better by at least so large a share and so many standard errors."""
        return bool(np.any((self.share >= least) & (self.share > errors * self.standard_error)))

    def harms(self, least: float, errors: float) -> bool:
        """Tell whether some output is simulated worse by at least so large a share and so many standard errors."""
        return bool(np.any((-self.share >= least) & (-self.share > errors * self.standard_error)))


def simulation_gain(one: StageLikelihood, other: StageLikelihood) -> SimulationGain:
    """Return by how much ``one`` simulates blocks of the identification records left out better than ``other``."""
    return gain_of_errors(one.stage.outputs, simulation_errors(one), simulation_errors(other))


def held_out_errors(stage: Stage) -> np.ndarray:
    """Return the sum of squared errors of each record held out, (n_records, n_c)."""
    return np.array([np.sum(f.residual**2, axis=0) for f in stage.fits("validate")])


def gain_of_errors(outputs: tuple[str, ...], one: np.ndarray, other: np.ndarray) -> SimulationGain:
    """Return by how much the first squared errors, (n_blocks, n_c), are smaller than the second.

    Blocks count alike, whatever their size: the mean over the blocks of the logarithm of the ratio.
    """
    ratios = np.log(np.maximum(one, 1e-300) / np.maximum(other, 1e-300))
    mean, n = np.mean(ratios, axis=0), len(ratios)
    error = np.std(ratios, axis=0, ddof=1) / np.sqrt(n) if n > 1 else np.zeros(mean.size)
    return SimulationGain(outputs=outputs, share=-np.expm1(mean), standard_error=np.exp(mean) * error)


def simulation_errors(likelihood: StageLikelihood) -> np.ndarray:
    """Return the sum of squared errors of each block simulated with parameters of the others, (n_blocks, n_c).

    The parameters without a record follow from the normal equations of the fit, in which each output is weighted by
    its scale; each record's own unknowns are fitted to it, as they are when a record is held out.  The white noise that
    the means of several samples have lost counts as it does in the records themselves.
    """
    stage, linearised = likelihood.stage, likelihood.linearised
    residual, sens = linearised.residual(), linearised.sensitivities()
    weights = np.array([stage.identify.scale[c] for c in residual.channels])
    given = linearised.preparation
    lost = noise_floor(linearised) ** 2 * (given.average * given.decimate - 1)
    known = np.isfinite(sens.prior_std)
    precision = np.where(known, 1.0 / np.where(known, sens.prior_std, 1.0) ** 2, 0.0)
    rows = []
    for block, slopes, own in zip(residual.blocks, sens.blocks, sens.nuisance, strict=True):
        e, f = (block / weights).ravel(), (slopes / weights[:, None]).reshape(block.size, -1)
        if own is not None and own.shape[2]:
            q, _ = np.linalg.qr((own / weights[:, None]).reshape(block.size, -1))
            e, f = e - q @ (q.T @ e), f - q @ (q.T @ f)
        rows.append((e, f))
    # samples are means over `average` of those of the fit, whose weights these are
    count = float(given.average)
    normal = np.diag(precision) + count * sum(f.T @ f for _, f in rows)
    right = precision * sens.prior_offset + count * sum(f.T @ e for e, f in rows)
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    parts = max(1, -(-LEAST_BLOCKS // len(rows)))
    errors = []
    for e, f in rows:
        left = (normal - count * f.T @ f) / np.outer(size, size)
        # what only this record determines keeps a hundredth of the information that there is of it
        left += 1e-2 * count * np.diag(np.sum((f / size) ** 2, axis=0)) + 1e-9 * np.eye(size.size)
        theta = np.linalg.solve(left, (right - count * f.T @ e) / size) / size
        left_over = ((e - f @ theta).reshape(-1, weights.size) * weights) ** 2
        errors += [np.sum(part, axis=0) + len(part) * lost for part in np.array_split(left_over, parts)]
    return np.array(errors)


def predictive_scores(likelihood: StageLikelihood) -> np.ndarray:
    """Return the log predictive density of every block, given the others, shape (n_blocks,).

    Innovations are independent, so blocks of them can be left out one by one.  Around the fit the outputs are linear in
    the parameters: the parameters' distribution without a block follows from the normal equations.  Each record's own
    unknowns are fitted to the record itself, as they are when a record is held out.
    """
    linearised, fitted = likelihood.linearised, likelihood.noise
    columns, std, offset = record_columns(linearised, fitted.records, likelihood.held)
    parts = max(1, -(-BLOCKS // len(columns)))
    blocks = []
    for record in columns:
        weighting = innovation_weighting(record.record, fitted.model)
        together = np.concatenate([record.residual[:, :, None], record.shared, record.own], axis=2)
        white = weighting(together)
        log_root = np.log(np.diagonal(weighting.root[record.record.observed], axis1=1, axis2=2)).sum(axis=1)
        flat = white.reshape(-1, white.shape[2])
        k = record.shared.shape[2]
        own = flat[:, 1 + k :]
        if own.shape[1]:
            q, _ = np.linalg.qr(own / np.maximum(np.linalg.norm(own, axis=0), 1e-300))
            flat = flat[:, : 1 + k] - q @ (q.T @ flat[:, : 1 + k])
        n_c = record.residual.shape[1]
        for rows in np.array_split(np.arange(len(white)), parts):
            part = flat[rows[0] * n_c : (rows[-1] + 1) * n_c]
            blocks.append((part[:, 0], part[:, 1 : 1 + k], float(np.sum(log_root[rows]))))
    known = np.isfinite(std)
    precision = np.where(known, 1.0 / np.where(known, std, 1.0) ** 2, 0.0)
    normal = np.diag(precision) + sum(f.T @ f for _, f, _ in blocks)
    right = precision * offset + sum(f.T @ e for e, f, _ in blocks)
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    scores = []
    for e, f, log_root in blocks:
        f_scaled = f / size
        # what only this block determines keeps a hundredth of the information that all blocks have of it
        left = (
            (normal - f.T @ f) / np.outer(size, size)
            + 1e-2 * np.diag(np.sum(f_scaled**2, axis=0))
            + 1e-9 * np.eye(size.size)
        )
        theta = np.linalg.solve(left, (right - f.T @ e) / size)
        r = e - f_scaled @ theta
        # Σ = I + F A⁻¹ Fᵀ, by the small matrix
        inner = left + f_scaled.T @ f_scaled
        fr = f_scaled.T @ r
        quadratic = float(r @ r - fr @ np.linalg.solve(inner, fr))
        log_det = float(np.linalg.slogdet(inner)[1] - np.linalg.slogdet(left)[1])
        scores.append(-0.5 * (quadratic + log_det) + log_root)
    return np.array(scores)
