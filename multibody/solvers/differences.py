"""The Jacobian of rates by forward differences, where a rough one will do."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

__all__ = ["forward_differences"]

_STEP = np.sqrt(np.finfo(float).eps)


def forward_differences(rates: Callable[[np.ndarray], np.ndarray], x: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Return the derivatives of rates with respect to the states, good for half of a number's digits.

    Parameters
    ----------
    rates : callable
        Gives a new array of rates for an array of states.
    x : ndarray, shape (n,)
    sizes : ndarray, shape (n,)
        What counts as a change of order one in each state; one is taken where it is zero.

    Returns
    -------
    ndarray, shape (n, n)
        Rates down, states across; x.size + 1 evaluations.

    Examples
    --------
    >>> print(forward_differences(lambda x: np.array([x[1], -4.0 * x[0]]), np.zeros(2), np.zeros(2)).round(6))
    [[ 0.  1.]
     [-4.  0.]]
    """
    here, matrix = rates(x), np.empty((x.size, x.size))
    for k in range(x.size):
        moved = x.copy()
        moved[k] += _STEP * (sizes[k] if sizes[k] > 0.0 else 1.0)
        matrix[:, k] = (rates(moved) - here) / (moved[k] - x[k])
    return matrix
