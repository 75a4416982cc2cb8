"""How fast the fastest motion of many Jacobians is."""

from __future__ import annotations

import numpy as np

__all__ = ["spectral_radius"]

SQUARINGS = 5


def spectral_radius(a: np.ndarray) -> np.ndarray:
    """Return for each matrix about the largest magnitude of its eigenvalues, at most 1.5 times too large.

    The norm of a high power, with the scale taken out at every squaring (Gelfand's formula).

    Parameters
    ----------
    a : ndarray, shape (nt, n, n)

    Returns
    -------
    ndarray, shape (nt,)

    Examples
    --------
    >>> print(spectral_radius(np.array([[[0.0, 1.0], [-4.0, 0.0]]])).round(1))
    [2.]
    """
    power, log = a.copy(), np.zeros(len(a))
    for k in range(SQUARINGS + 1):
        size = np.maximum(np.max(np.abs(power), axis=(1, 2)), 1e-300)
        log += np.log(size) / 2**k
        power /= size[:, None, None]
        if k < SQUARINGS:
            power = power @ power
    return np.exp(log)
