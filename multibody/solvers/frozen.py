"""State-transition matrices where a machine is stiff: matrix exponentials of its Jacobian, frozen piece by piece.

An explicit integration of the variational equation needs as many steps as the fastest motion has time constants, even
when that motion has long died away: a connection that sticks in dry friction can ask for thousands between two
samples.  Where x' = A x + B u with A and B constant the transition is a matrix exponential, however fast the machine
is (Van Loan 1978, IEEE Trans. Automatic Control 23, 395-404); with A and B taken at the middle of each of a few pieces
it is exact to second order in their length.
"""

from __future__ import annotations

from math import factorial

import numpy as np

__all__ = ["frozen_state_transition"]

#: Norm to which a matrix is halved before its exponential is a series, and the last power in that: what is left out is
#: below rounding, 0.5^13 / 15!.
HALVED_TO, POWERS = 0.5, 12


@np.errstate(over="ignore", invalid="ignore")  # what is not finite is the caller's to tell
def frozen_state_transition(
    a: np.ndarray, b: np.ndarray, h: np.ndarray, shares: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the state-transition matrices of intervals from the Jacobians in their pieces.

    Parameters
    ----------
    a : ndarray, shape (K, q, n, n), 1/s
        Jacobian by the states in the middle of each of q pieces of K intervals.
    b : ndarray, shape (K, q, n, m)
        Jacobian by the inputs there.
    h : ndarray, shape (K,), s
        Lengths of the intervals.
    shares : ndarray, shape (q,), optional
        Of each piece in its interval; default: all equal.

    Returns
    -------
    phi, gamma0, gamma1 : ndarray, shape (K, n, n), (K, n, m), (K, n, m)
        As in `multibody.solvers.state_transition.StateTransitionMatrices`.

    Examples
    --------
    A first-order lag of 1 ms over an interval of 0.1 s forgets its state, and follows a ramp one time constant late:

    >>> rate = np.full((1, 1, 1, 1), 1e3)
    >>> phi, gamma0, gamma1 = frozen_state_transition(-rate, rate, np.array([0.1]))
    >>> round(float(phi[0, 0, 0]), 6), round(float(gamma0[0, 0, 0]), 6), round(float(gamma1[0, 0, 0]), 6)
    (0.0, 0.01, 0.99)
    """
    count, q, n, m = b.shape
    shares = np.full(q, 1.0 / q) if shares is None else shares
    piece = (h[:, None] * shares)[:, :, None, None]
    blocks = _exponentials((a * piece).reshape(count * q, n, n), (b * piece).reshape(count * q, n, m))
    step, held, ramp = (block.reshape(count, q, *block.shape[1:]) for block in blocks)
    phi = np.broadcast_to(np.eye(n), (count, n, n)).copy()
    gamma0, gamma1 = np.zeros((count, n, m)), np.zeros((count, n, m))
    begun = 0.0
    for j, share in enumerate(shares):
        # The addition runs from φ_k to φ_{k+1} over the interval: in a piece it begins at begun and rises by its share.
        gamma0 = step[:, j] @ gamma0 + (1.0 - begun) * held[:, j] - share * ramp[:, j]
        gamma1 = step[:, j] @ gamma1 + begun * held[:, j] + share * ramp[:, j]
        phi = step[:, j] @ phi
        begun += share
    return phi, gamma0, gamma1


def _exponentials(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return e^a, φ₁(a) b and φ₂(a) b, with φ₁(a) = (e^a - 1)/a and φ₂(a) = (e^a - 1 - a)/a², of many matrices at once.

    These are the first n rows of the exponential of [[a, b, 0], [0, 0, 1], [0, 0, 0]], by halving and squaring (Higham
    2005, SIAM J. Matrix Anal. Appl. 26, 1179-1193) with a Taylor series.  What is squared is e^a - 1, so that a slow
    motion beside a fast one, which asks for many halvings, is not rounded as often.

    Parameters
    ----------
    a : ndarray, shape (K, n, n)
    b : ndarray, shape (K, n, m)
    """
    n, m = b.shape[1:]
    norm = np.max(np.sum(np.abs(a), axis=1), axis=1, initial=0.0)
    halvings = np.ceil(np.log2(np.where(np.isfinite(norm), norm, 0.0).clip(min=HALVED_TO) / HALVED_TO)).astype(int)
    share = np.exp2(-halvings)[:, None, None]
    a, one = a * share, np.eye(n)
    second = np.broadcast_to(one / factorial(POWERS + 2), a.shape)
    for k in range(POWERS - 1, -1, -1):
        second = a @ second + one / factorial(k + 2)
    first = a @ second + one
    rows = np.concatenate((a @ first, first @ b * share, second @ b * share**2), axis=2)  # of e^a without its 1
    for j in range(halvings.max(initial=0)):
        long = np.flatnonzero(halvings > j)
        some = rows[long]
        twice = some[:, :, :n] @ some + 2.0 * some
        twice[:, :, n + m :] += some[:, :, n : n + m] * share[long] * 2.0**j
        rows[long] = twice
    return rows[:, :, :n] + one, rows[:, :, n : n + m], rows[:, :, n + m :]
