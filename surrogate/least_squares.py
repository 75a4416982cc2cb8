"""Linear least squares by singular values, with its rank, leverages and null directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LinearFit", "solve"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class LinearFit:
    """Solution of min |A c - y|.

    Parameters
    ----------
    coefficients : ndarray, shape (p,)
        Minimum-norm (in scaled columns) if A lacks rank.
    leverages : ndarray, shape (n,)
        Diagonal of the hat matrix.
    spread : ndarray, shape (p, rank)
        (AᵀA)⁺ = spread spreadᵀ.
    null : ndarray, shape (p, p - rank)
        Directions of the coefficients that the points say nothing about, for scaled columns.
    condition : float
        Of the column-scaled matrix.
    """

    coefficients: Array
    leverages: Array
    spread: Array
    null: Array
    condition: float

    @property
    def rank(self) -> int:
        """Number of directions of the coefficients that the points determine."""
        return int(self.spread.shape[1])


def solve(matrix: Array, y: Array) -> LinearFit:
    """Solve by a singular value decomposition of the column-scaled matrix, shape (n, p).

    The normal equations of the paper's Eq. 5 square the condition number; this does not.
    """
    scale = np.sqrt((matrix**2).sum(axis=0))
    scale[scale == 0.0] = 1.0
    # The complete right factor is wanted for the null directions when there are fewer points than terms.
    u, s, vt = np.linalg.svd(matrix / scale, full_matrices=matrix.shape[0] < matrix.shape[1])
    u = u[:, : len(s)]
    rank = int((s > max(matrix.shape) * np.finfo(float).eps * s[0]).sum())
    spread = (vt[:rank].T / s[:rank]) / scale[:, None]
    coefficients = spread @ (u[:, :rank].T @ y)
    # One step of refinement: the residual is small, so its correction carries the digits lost above.
    coefficients = coefficients + spread @ (u[:, :rank].T @ (y - matrix @ coefficients))
    smallest = s[-1] if len(s) == matrix.shape[1] else 0.0
    return LinearFit(
        coefficients=coefficients,
        leverages=(u[:, :rank] ** 2).sum(axis=1),
        spread=spread,
        null=vt[rank:].T,
        condition=float(s[0] / smallest) if smallest > 0.0 else float("inf"),
    )
