"""Intervals of a least-squares fit that hold when residuals are coloured: the block sandwich.

With the Jacobian J, residual e and blocks b that are longer than the residual remembers,
``cov = H⁻¹ (Σ_b s_b s_bᵀ) H⁻¹`` with ``H = JᵀJ`` (+ priors) and ``s_b = J_bᵀ e_b`` (Liang and Zeger 1986).  White
noise is not assumed; only blocks are taken as independent.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

__all__ = ["block_sandwich", "correlation_time", "cut_rows"]


def correlation_time(e: np.ndarray, longest: float = 0.2) -> float:
    """Return the integrated autocorrelation time of a series in samples, at least 1.

    The sum ends at the first lag where the autocorrelation falls below zero, or at ``longest`` of the series.
    """
    x = np.asarray(e, dtype=float) - np.mean(e)
    n = x.size
    power = float(x @ x)
    if n < 8 or power == 0.0:
        return 1.0
    spectrum = np.fft.rfft(x, 2 * n)
    rho = np.fft.irfft(spectrum * spectrum.conj())[: max(2, int(longest * n))] / power
    negative = np.flatnonzero(rho < 0.0)
    end = negative[0] if negative.size else rho.size
    return float(max(1.0, 1.0 + 2.0 * rho[1:end].sum()))


def cut_rows(lengths: Sequence[int], shortest: int, most: int = 60) -> list[np.ndarray]:
    """Cut stacked records into blocks of at least ``shortest`` rows, none across two records.

    Returns the row indices of each block.
    """
    blocks: list[np.ndarray] = []
    total = sum(lengths)
    first = 0
    for length in lengths:
        wanted = max(1, round(most * length / max(total, 1)))
        count = max(1, min(wanted, length // max(shortest, 1)))
        blocks += [first + part for part in np.array_split(np.arange(length), count)]
        first += length
    return blocks


def block_sandwich(
    jacobian: np.ndarray, residual: np.ndarray, blocks: Sequence[np.ndarray], prior: np.ndarray | None = None
) -> tuple[np.ndarray, int]:
    """Return the covariance of the parameters and the degrees of freedom of its scale.

    Parameters
    ----------
    jacobian : ndarray, shape (N, k)
        Weighted derivatives of the model.
    residual : ndarray, shape (N,)
        Weighted residual at the optimum.
    blocks : sequence of ndarray of int
        Rows of each block.
    prior : ndarray, shape (k,), optional
        Precision 1/std² of each parameter's prior; its information counts as it is.

    Returns
    -------
    covariance : ndarray, shape (k, k)
    degrees : int
        Number of blocks less 1; intervals use Student's t with it.
    """
    h = jacobian.T @ jacobian
    if prior is not None:
        h = h + np.diag(prior)
    scale = np.sqrt(np.maximum(np.diag(h), 1e-300))
    inverse = np.linalg.pinv(h / np.outer(scale, scale), rcond=1e-14, hermitian=True) / np.outer(scale, scale)
    count = len(blocks)
    meat = np.zeros_like(h)
    for rows in blocks:
        j = jacobian[rows]
        # A block pulls the fit towards itself; undoing that (as HC3 does for single rows) keeps few blocks honest:
        # J_bᵀ (I − J_b H⁻¹ J_bᵀ)⁻¹ e_b = (I − J_bᵀJ_b H⁻¹)⁻¹ J_bᵀ e_b.
        s = np.linalg.lstsq(np.eye(h.shape[0]) - (j.T @ j) @ inverse, j.T @ residual[rows], rcond=1e-10)[0]
        meat += np.outer(s, s)
    meat *= (count - 1) / count if count > 1 else 1.0
    if prior is not None:
        meat += np.diag(prior)
    return inverse @ meat @ inverse, max(count - 1, 1)
