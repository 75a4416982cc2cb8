"""Standardised recursive residuals: each record against all before it, exactly normal where nothing changes.

R. L. Brown, J. Durbin, J. M. Evans, J. Royal Statistical Society B 37 (1975) 149 (recursive residuals);
D. M. Hawkins, The Statistician 36 (1987) 299 (a chart that starts itself, so that no mean or spread has to be known).
"""

from __future__ import annotations

import numpy as np

__all__ = ["recursive_residuals", "standardised_residuals"]

#: Degrees of freedom of the spread from which a residual counts: with fewer, Student's tails are so heavy that the
#: transformed residual tells nothing.
FEWEST = 3
#: Largest size of a standardised residual: beyond it the transformation underflows.
LARGEST = 8.0


def standardised_residuals(values: np.ndarray, covariates: np.ndarray | None = None) -> np.ndarray:
    """Return each value's deviation from what those before it predict, as a standard normal variable.

    Where the values are a constant, plus known covariates times unknown factors, plus independent normal noise of
    unknown size, the results are independent and standard normal, however few values there are.

    Parameters
    ----------
    values : ndarray, shape (n,)
    covariates : ndarray, shape (n, q), optional
        Conditions that the values may depend on linearly, such as temperature and load.

    Returns
    -------
    ndarray, shape (n,)
        NaN for the first values, which only serve to estimate, and where a covariate is new: it does not lie in the
        span of what was seen.

    Examples
    --------
    >>> np.round(standardised_residuals(np.array([1.0, 2.0, 1.5, 1.2, 1.8, 9.0])), 2)
    array([ nan,  nan,  nan,  nan, 0.68, 3.95])
    """
    return _as_normal(*recursive_residuals(values, covariates))


def recursive_residuals(
    values: np.ndarray, covariates: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return each value's deviation from what those before it predict, in one scale, unknown and the same for all.

    Parameters
    ----------
    values, covariates
        As for `standardised_residuals`.

    Returns
    -------
    residuals, squares, degrees : ndarray, shape (n,)
        Where nothing changes the residuals are independent and normal with one variance; the sum of the squares of
        those before, and its degrees of freedom: 0 where there is no residual.
    """
    y = np.asarray(values, dtype=float)
    n = y.size
    if covariates is None or np.asarray(covariates).size == 0:
        before = np.arange(n)
        mean = (np.cumsum(y) - y) / np.maximum(before, 1)
        w = (y - mean) * np.sqrt(before / (before + 1.0))
        return w, np.cumsum(w**2) - w**2, np.maximum(before - 1, 0)
    x = np.column_stack([np.ones(n), np.asarray(covariates, dtype=float)])
    spread = np.ptp(x[:, 1:], axis=0)  # one scale for the rank decisions, whatever the units
    x[:, 1:] = (x[:, 1:] - x[:, 1:].mean(axis=0)) / np.where(spread > 0.0, spread, 1.0)
    residuals, sums, degrees = np.zeros(n), np.zeros(n), np.zeros(n)
    normal, right = np.zeros((x.shape[1], x.shape[1])), np.zeros(x.shape[1])
    squares = 0.0
    for k in range(n):
        inverse = np.linalg.pinv(normal, hermitian=True, rcond=1e-9)
        rank = int(np.linalg.matrix_rank(normal, hermitian=True, tol=1e-9 * max(np.trace(normal), 1e-300)))
        spanned = k > 0 and np.linalg.norm(normal @ (inverse @ x[k]) - x[k]) < 1e-6 * np.linalg.norm(x[k])
        if spanned:
            residuals[k] = (y[k] - x[k] @ (inverse @ right)) / np.sqrt(1.0 + x[k] @ inverse @ x[k])
            sums[k], degrees[k] = squares, k - rank
            squares += residuals[k] ** 2
        normal += np.outer(x[k], x[k])
        right += x[k] * y[k]
    return residuals, sums, degrees


def _as_normal(residuals: np.ndarray, squares: np.ndarray, degrees: np.ndarray) -> np.ndarray:
    """Return residuals over the spread of those before them, from Student's to the normal distribution."""
    from scipy.stats import norm, t

    out = np.full(residuals.size, np.nan)
    known = (degrees >= FEWEST) & (squares > 0.0)
    ratio = residuals[known] / np.sqrt(squares[known] / degrees[known])
    out[known] = np.sign(ratio) * np.minimum(norm.isf(t.sf(np.abs(ratio), degrees[known])), LARGEST)
    return out
