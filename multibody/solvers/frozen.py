"""State-transition matrices where a machine is stiff: matrix exponentials of its Jacobian, frozen piece by piece.

An explicit integration of the variational equation needs as many steps as the fastest motion has time constants, even
when that motion has long died away: a connection that sticks in dry friction can ask for thousands between two
samples.  Where x' = A x + B u with A and B constant the transition is a matrix exponential, however fast the machine
is (Van Loan 1978, IEEE Trans. Automatic Control 23, 395-404); with A and B taken at the middle of each of a few pieces
it is exact to second order in their length.
"""

from __future__ import annotations

import numpy as np

__all__ = ["frozen_state_transition"]


def frozen_state_transition(a: np.ndarray, b: np.ndarray, h: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the state-transition matrices of intervals from the Jacobians in their pieces.

    Parameters
    ----------
    a : ndarray, shape (K, q, n, n), 1/s
        Jacobian by the states in the middle of each of q equal pieces of K intervals.
    b : ndarray, shape (K, q, n, m)
        Jacobian by the inputs there.
    h : ndarray, shape (K,), s
        Lengths of the intervals.

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
    from scipy.linalg import expm

    count, q, n, m = b.shape
    piece = (h / q)[:, None, None, None]
    whole = np.zeros((count, q, n + 2 * m, n + 2 * m))
    whole[..., :n, :n] = a * piece
    whole[..., :n, n : n + m] = b * piece
    whole[..., n : n + m, n + m :] = np.eye(m)
    blocks = expm(whole)
    phi = np.broadcast_to(np.eye(n), (count, n, n)).copy()
    gamma0, gamma1 = np.zeros((count, n, m)), np.zeros((count, n, m))
    for j in range(q):
        step, held, ramp = blocks[:, j, :n, :n], blocks[:, j, :n, n : n + m], blocks[:, j, :n, n + m :]
        # The addition runs from φ_k to φ_{k+1} over the interval: in a piece it begins at begun and rises by 1/q.
        begun = j / q
        gamma0 = step @ gamma0 + (1.0 - begun) * held - ramp / q
        gamma1 = step @ gamma1 + begun * held + ramp / q
        phi = step @ phi
    return phi, gamma0, gamma1
