"""The Rauch–Tung–Striebel smoother, from what a filter kept.

H. E. Rauch, F. Tung, C. T. Striebel: Maximum likelihood estimates of linear dynamic systems, AIAA J. 3 (1965).
"""

from __future__ import annotations

import numpy as np

__all__ = ["backward_pass", "smoother_gains"]


def smoother_gains(covariances: np.ndarray, predicted: np.ndarray, transitions: np.ndarray) -> np.ndarray:
    """Return C_k = P_k F_{k+1}ᵀ (P⁻_{k+1})⁻¹, shape (k − 1, n, n).

    A predicted covariance without full rank (a state without noise) is inverted on its range.
    """
    ahead = predicted[1:]
    scale = np.sqrt(np.maximum(np.diagonal(ahead, axis1=1, axis2=2), 0.0))
    scale = np.where(scale > 0.0, scale, 1.0)
    scaled = ahead / (scale[:, :, None] * scale[:, None, :])
    cross = transitions[1:] @ covariances[:-1] / scale[:, :, None]
    try:
        np.linalg.cholesky(scaled - 1e-13 * np.eye(scaled.shape[1]))
        solved = np.linalg.solve(scaled, cross)
    except np.linalg.LinAlgError:
        solved = np.linalg.pinv(scaled, rcond=1e-12, hermitian=True) @ cross
    return np.swapaxes(solved / scale[:, :, None], 1, 2)


def backward_pass(
    states: np.ndarray, covariances: np.ndarray, ahead: np.ndarray, ahead_covariances: np.ndarray, gains: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return smoothed states and covariances from filtered and predicted (``ahead``) ones."""
    x, p = states.copy(), covariances.copy()
    for k in range(len(x) - 2, -1, -1):
        c = gains[k]
        x[k] += c @ (x[k + 1] - ahead[k + 1])
        p[k] += c @ (p[k + 1] - ahead_covariances[k + 1]) @ c.T
        p[k] = 0.5 * (p[k] + p[k].T)
    return x, p
