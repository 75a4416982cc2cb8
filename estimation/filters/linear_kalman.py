"""The linear Kalman filter and smoother in their textbook form, which the compiled filters are compared with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from estimation.filters.smoother import backward_pass, smoother_gains

if TYPE_CHECKING:
    from multibody.system.linearize import Linearization

__all__ = ["LinearModel", "kalman_filter", "rauch_tung_striebel", "van_loan"]


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearModel:
    """x_{k+1} = F x_k + G u_k + c + w, y_k = H x_k + D u_k + v with cov w = Q and cov v = R.

    Parameters
    ----------
    F, H, Q, R : ndarray, shapes (n, n), (m, n), (n, n), (m, m)
    G, D : ndarray, shapes (n, n_u), (m, n_u), optional
    c : ndarray, shape (n,), optional
    """

    F: np.ndarray
    H: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    G: np.ndarray | None = None
    D: np.ndarray | None = None
    c: np.ndarray | None = None

    @classmethod
    def of(cls, linear: Linearization, step: float, density: np.ndarray, R: np.ndarray) -> LinearModel:
        """Return a linearised machine sampled with inputs held, its noise density integrated exactly.

        Parameters
        ----------
        linear : Linearization
            With the measured outputs only, about an equilibrium at zero.
        step : float, s
        density : ndarray, shape (n, n)
            Of the process noise, unit² per second.
        R : ndarray, shape (m, m)
        """
        from scipy.linalg import expm

        n, n_u = linear.B.shape
        whole = np.zeros((n + n_u, n + n_u))
        whole[:n, :n], whole[:n, n:] = linear.A, linear.B
        moved = expm(whole * step)
        return cls(
            F=moved[:n, :n],
            H=linear.C,
            Q=van_loan(linear.A, density, step),
            R=np.asarray(R, dtype=float),
            G=moved[:n, n:],
            D=linear.D,
        )


def van_loan(a: np.ndarray, density: np.ndarray, step: float) -> np.ndarray:
    """Return ∫₀ʰ exp(A s) Q exp(A s)ᵀ ds exactly (C. F. Van Loan, IEEE Trans. Automatic Control 23, 1978).

    Parameters
    ----------
    a, density : ndarray, shape (n, n)
    step : float, s

    Examples
    --------
    >>> van_loan(np.array([[0.0, 1.0], [0.0, 0.0]]), np.diag([0.0, 3.0]), 1.0)
    array([[1. , 1.5],
           [1.5, 3. ]])
    """
    from scipy.linalg import expm

    n = len(a)
    whole = np.zeros((2 * n, 2 * n))
    whole[:n, :n], whole[:n, n:], whole[n:, n:] = -a, density, a.T
    moved = expm(whole * step)
    integral = moved[n:, n:].T @ moved[:n, n:]
    return 0.5 * (integral + integral.T)


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearRun:
    """States and covariances before and after each reading, and the log likelihood."""

    predicted: np.ndarray
    predicted_covariances: np.ndarray
    states: np.ndarray
    covariances: np.ndarray
    log_likelihood: float


def kalman_filter(
    model: LinearModel, readings: np.ndarray, x: np.ndarray, p: np.ndarray, inputs: np.ndarray | None = None
) -> LinearRun:
    """Run the Kalman filter; the first reading belongs to the prior's instant.

    Parameters
    ----------
    model : LinearModel
    readings : ndarray, shape (k, m)
        NaN where one is missing.
    x, p : ndarray, shapes (n,), (n, n)
        Prior.
    inputs : ndarray, shape (k, n_u), optional
    """
    x, p = np.array(x, dtype=float), np.array(p, dtype=float)
    before, before_p, after, after_p, likelihood = [], [], [], [], 0.0
    eye = np.eye(len(x))
    for k, y in enumerate(np.atleast_2d(readings)):
        if k > 0:
            x = model.F @ x
            if inputs is not None and model.G is not None:
                x = x + model.G @ inputs[k - 1]
            if model.c is not None:
                x = x + model.c
            p = model.F @ p @ model.F.T + model.Q
        before.append(x)
        before_p.append(p)
        seen = np.isfinite(y)
        if seen.any():
            h, r = model.H[seen], model.R[np.ix_(seen, seen)]
            expected = model.H @ x
            if inputs is not None and model.D is not None:
                expected = expected + model.D @ inputs[k]
            e = y[seen] - expected[seen]
            s = h @ p @ h.T + r
            gain = np.linalg.solve(s, h @ p).T
            x = x + gain @ e
            left = eye - gain @ h
            p = left @ p @ left.T + gain @ r @ gain.T
            likelihood -= 0.5 * (seen.sum() * np.log(2.0 * np.pi) + np.linalg.slogdet(s)[1] + e @ np.linalg.solve(s, e))
        after.append(x)
        after_p.append(p)
    return LinearRun(
        predicted=np.array(before),
        predicted_covariances=np.array(before_p),
        states=np.array(after),
        covariances=np.array(after_p),
        log_likelihood=float(likelihood),
    )


def rauch_tung_striebel(model: LinearModel, run: LinearRun) -> tuple[np.ndarray, np.ndarray]:
    """Return smoothed states, shape (k, n), and covariances, shape (k, n, n)."""
    transitions = np.broadcast_to(model.F, run.covariances.shape)
    gains = smoother_gains(run.covariances, run.predicted_covariances, transitions)
    return backward_pass(run.states, run.covariances, run.predicted, run.predicted_covariances, gains)
