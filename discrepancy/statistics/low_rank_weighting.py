"""Weighting a residual down in the directions in which something known to be random moves it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["LowRankWeighting", "low_rank_weighting"]

_SMALLEST = 0.1  # deviations below this share of the output's noise need no weighting


@dataclass(frozen=True, eq=False)
class LowRankWeighting:
    """Multiplication by ``(I + B Bᵀ)^(−1/2)`` in units of each output's noise, with ``B`` of low rank.

    Parameters
    ----------
    noise : ndarray, shape (n_channels,)
    basis : ndarray, shape (n · n_channels, r)
        Orthonormal.
    factor : ndarray, shape (r,)
        By which each direction of the basis is multiplied.
    """

    noise: np.ndarray
    basis: np.ndarray
    factor: np.ndarray

    def __call__(self, block: np.ndarray) -> np.ndarray:
        """Return a block, shape (n, n_channels) or (n, n_channels, k), weighted down."""
        return self._times(self.factor, block)

    def inverse(self, block: np.ndarray) -> np.ndarray:
        """Return a block that was weighted down as it was before."""
        return self._times(1.0 / self.factor, block)

    def _times(self, factor: np.ndarray, block: np.ndarray) -> np.ndarray:
        n, c = block.shape[:2]
        if not self.basis.shape[1]:
            return block
        scale = self.noise[:, None]
        flat = (block.reshape(n, c, -1) / scale).reshape(n * c, -1)
        flat = flat + self.basis @ ((factor - 1.0)[:, None] * (self.basis.T @ flat))
        return (flat.reshape(n, c, -1) * scale).reshape(block.shape)


def low_rank_weighting(deviations: np.ndarray, noise: np.ndarray) -> LowRankWeighting:
    """Return the weighting for independent deviations of size one.

    Parameters
    ----------
    deviations : ndarray, shape (n, n_channels, k)
        Response of the outputs to each of them.
    noise : ndarray, shape (n_channels,)
        Of the outputs, in the same units, all above zero.
    """
    b = (deviations / noise[:, None]).reshape(-1, deviations.shape[2])
    if not np.all(np.isfinite(b)):
        return LowRankWeighting(noise, np.zeros((0, 0)), np.zeros(0))
    u, s, _ = np.linalg.svd(b, full_matrices=False)
    kept = s > _SMALLEST
    return LowRankWeighting(noise, u[:, kept], 1.0 / np.sqrt(1.0 + s[kept] ** 2))
