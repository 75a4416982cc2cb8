"""Bounded nonlinear least squares for simulations: few evaluations, tall Jacobians handled in pieces.

Levenberg and Marquardt with the damping of Nielsen (1999), variables held at a bound while the gradient pushes them
outwards.  Only the small normal matrix is kept, with columns scaled to unit length; as the residual itself is exact,
its condition limits the speed of the last digits and not their accuracy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

__all__ = ["Solution", "solve"]

Rows = Iterable[tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Solution:
    """Where a least-squares fit ended.

    Parameters
    ----------
    x : ndarray, shape (k,)
    cost : float
        Half the sum of squares.
    evaluations : int
        Residuals computed.
    message : str
        Why it ended.
    """

    x: np.ndarray
    cost: float
    evaluations: int
    message: str


def solve(
    cost: Callable[[np.ndarray], float], rows: Callable[[np.ndarray], Rows], x: np.ndarray, low: np.ndarray,
    high: np.ndarray, *, tolerance: float = 1e-7, max_evaluations: int = 40,
) -> Solution:
    """Minimise half the sum of squares within bounds.

    Parameters
    ----------
    cost : callable
        Half the sum of squares at a point; infinite where the simulation fails.
    rows : callable
        Yields pairs (J, e) of blocks of the Jacobian (m, k) and the residual (m,) at a point.
    x : ndarray, shape (k,)
        Start, within the bounds.
    low, high : ndarray, shape (k,)
    tolerance : float
        Relative fall of the cost, and relative step, below which it ends.
    max_evaluations : int

    Examples
    --------
    >>> t = np.linspace(0.0, 1.0, 20)
    >>> y = np.exp(-2.0 * t)
    >>> def rows(x):
    ...     yield (-t * np.exp(-x[0] * t))[:, None], np.exp(-x[0] * t) - y
    >>> def cost(x):
    ...     return 0.5 * float(np.sum((np.exp(-x[0] * t) - y) ** 2))
    >>> round(float(solve(cost, rows, np.array([1.0]), np.array([0.0]), np.array([9.0])).x[0]), 6)
    2.0
    """
    x = np.clip(np.asarray(x, dtype=float), low, high)
    current, evaluations = cost(x), 1
    damping, growth = 1e-4, 2.0
    message = "reached the largest number of simulations"
    while evaluations < max_evaluations:
        normal, gradient = _normal(rows(x), x.size)
        held = ((x <= low) & (gradient > 0)) | ((x >= high) & (gradient < 0))
        free = ~held & (np.diag(normal) > 0)
        if not free.any() or _flat(gradient, normal, free, current):
            message = "the gradient vanishes"
            break
        improved = False
        while evaluations < max_evaluations:
            trial, predicted = _step(x, normal, gradient, free, damping, low, high)
            change = trial - x
            if np.linalg.norm(change) <= tolerance * 1e-2 * (np.linalg.norm(x) + 1e-300) or predicted <= 0:
                break
            reached = cost(trial)
            evaluations += 1
            if reached < current:
                gain = (current - reached) / predicted
                damping *= max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3)
                growth = 2.0
                fall = (current - reached) / max(current, 1e-300)
                x, current, improved = trial, reached, True
                break
            damping, growth = damping * growth, growth * 2.0
        if not improved:
            message = "no step improves any more"
            break
        if fall < tolerance:
            message = "the error hardly falls any more"
            break
    return Solution(x, current, evaluations, message)


def _normal(rows: Rows, k: int) -> tuple[np.ndarray, np.ndarray]:
    normal, gradient = np.zeros((k, k)), np.zeros(k)
    for jacobian, residual in rows:
        normal += jacobian.T @ jacobian
        gradient += jacobian.T @ residual
    return normal, gradient


def _flat(gradient: np.ndarray, normal: np.ndarray, free: np.ndarray, cost: float) -> bool:
    """Tell whether the cosine between residual and every free column is below rounding."""
    size = np.sqrt(np.diag(normal)[free] * max(2.0 * cost, 1e-300))
    return bool(np.all(np.abs(gradient[free]) <= 1e-9 * size))


def _step(
    x: np.ndarray, normal: np.ndarray, gradient: np.ndarray, free: np.ndarray, damping: float, low: np.ndarray,
    high: np.ndarray,
) -> tuple[np.ndarray, float]:
    """Return the damped step, cut off at the bounds, and the fall of the cost that it promises."""
    index = np.flatnonzero(free)
    trial = x.copy()
    for _ in range(index.size):
        scale = np.sqrt(np.diag(normal)[index])
        scaled = normal[np.ix_(index, index)] / np.outer(scale, scale)
        # what has hit a bound in this step stays there and acts on the others through the gradient
        pull = gradient[index] + normal[index] @ (trial - x) - normal[np.ix_(index, index)] @ (trial - x)[index]
        change = -np.linalg.solve(scaled + (damping + 1e-14) * np.eye(index.size), pull / scale) / scale
        wanted = x[index] + change
        over = (wanted < low[index]) | (wanted > high[index])
        trial[index] = np.clip(wanted, low[index], high[index])
        if not over.any() or over.all():
            break
        index = index[~over]
    change = trial - x
    return trial, float(-(gradient @ change + 0.5 * change @ normal @ change))
