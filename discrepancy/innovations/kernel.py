"""Compiled recursions of the innovation filter: covariances of a record, then any number of columns whitened."""

from __future__ import annotations

import numpy as np

from multibody.compile.sealed_code import njit_kept

__all__ = ["covariance_pass", "filter_columns"]


@njit_kept(nogil=True, fastmath=False)
def covariance_pass(  # type: ignore[no-untyped-def]
    phi, g0, g1, c, d, counts, source, channel, decay, variance, noise, gain, root
):
    """Run the covariance recursion of the Kalman filter along a record; return the sum of log √det S.

    Parameters
    ----------
    phi : ndarray, shape (N - 1, n, n)
    g0, g1 : ndarray, shape (N - 1, n, m)
        State-transition matrices; see `discrepancy.innovations.linear_record`.
    c, d : ndarray, shape (N, n_c, n) and (N, n_c, m)
    counts : ndarray of bool, shape (N,)
        Whether the sample was measured and is part of the likelihood.
    source, channel : ndarray of int, shape (p,)
        Column of g0, g1 and d that a process drives, or -1; output that it is added to, or -1.
    decay : ndarray, shape (N - 1, p)
        Correlation of each process from one sample to the next.
    variance : ndarray, shape (p,)
        Stationary variance of each process.
    noise : ndarray, shape (n_c, n_c)
        Covariance of the white noise of the outputs.
    gain : ndarray, shape (N, n + p, n_c)
        Filter gain: written.
    root : ndarray, shape (N, n_c, n_c)
        Inverse of the lower Cholesky factor of the innovations' covariance: written, where a sample counts.
    """
    count, n, n_c, p = c.shape[0], c.shape[2], c.shape[1], source.size
    size = n + p
    P = np.zeros((size, size))
    for j in range(p):
        P[n + j, n + j] = variance[j]
    A = np.zeros((size, size))
    H = np.zeros((n_c, size))
    AP = np.zeros((size, size))
    PH = np.zeros((size, n_c))
    S = np.zeros((n_c, n_c))
    log_det = 0.0
    for k in range(count):
        if counts[k]:
            H[:, :n] = c[k]
            for j in range(p):
                for i in range(n_c):
                    H[i, n + j] = d[k, i, source[j]] if source[j] >= 0 else (1.0 if channel[j] == i else 0.0)
            np.dot(P, H.T, PH)
            np.dot(H, PH, S)
            S += noise
            L = np.linalg.cholesky(S)
            inverse = root[k]
            inverse[:, :] = 0.0
            for i in range(n_c):
                log_det += np.log(L[i, i])
                inverse[i, i] = 1.0 / L[i, i]
                for j in range(i):
                    total = 0.0
                    for r in range(j, i):
                        total += L[i, r] * inverse[r, j]
                    inverse[i, j] = -total / L[i, i]
            for r in range(size):  # PH S^-1 = PH (L^-T L^-1)
                for i in range(n_c):
                    total = 0.0
                    for j in range(n_c):
                        weight = 0.0
                        for q in range(max(i, j), n_c):
                            weight += inverse[q, j] * inverse[q, i]
                        total += PH[r, j] * weight
                    gain[k, r, i] = total
            for r in range(size):
                for s in range(r + 1):
                    total = 0.0
                    for i in range(n_c):
                        total += gain[k, r, i] * PH[s, i]
                    P[r, s] -= total
                    P[s, r] = P[r, s]
        if k + 1 == count:
            break
        A[:n, :n] = phi[k]
        for j in range(p):
            rho = decay[k, j]
            A[n + j, n + j] = rho
            for i in range(n):
                A[i, n + j] = g0[k, i, source[j]] + rho * g1[k, i, source[j]] if source[j] >= 0 else 0.0
        np.dot(A, P, AP)
        np.dot(AP, A.T, P)
        for j in range(p):
            q = variance[j] * (1.0 - decay[k, j] ** 2)
            P[n + j, n + j] += q
            if source[j] >= 0:
                for i in range(n):
                    b = g1[k, i, source[j]]
                    P[i, n + j] += b * q
                    P[n + j, i] += b * q
                    for s in range(n):
                        P[i, s] += b * q * g1[k, s, source[j]]
    return log_det


@njit_kept(nogil=True)
def filter_columns(  # type: ignore[no-untyped-def]
    phi, g0, g1, c, d, observed, counts, source, channel, decay, gain, root, columns, out, inverse
):
    """Whiten columns, shape (N_observed, n_c, q), by the filter of `covariance_pass`; written to ``out``.

    With ``inverse`` columns are innovations, and what they are the innovations of is written.  A sample that does not
    count has innovations of zero.
    """
    count, n, n_c, p = c.shape[0], c.shape[2], c.shape[1], source.size
    q = columns.shape[2]
    x, f = np.zeros((n, q)), np.zeros((p, q))
    x_next, expected, innovation = np.zeros((n, q)), np.zeros((n_c, q)), np.zeros((n_c, q))
    row = 0
    for k in range(count):
        if observed[k] and not counts[k]:
            out[row] = 0.0
            row += 1
        elif observed[k]:
            np.dot(c[k], x, expected)
            for j in range(p):
                for i in range(n_c):
                    h = d[k, i, source[j]] if source[j] >= 0 else (1.0 if channel[j] == i else 0.0)
                    if h != 0.0:
                        for s in range(q):
                            expected[i, s] += h * f[j, s]
            if inverse:
                for i in range(n_c):
                    for s in range(q):  # the root is lower triangular
                        total = columns[row, i, s]
                        for j in range(i):
                            total -= root[k, i, j] * innovation[j, s]
                        innovation[i, s] = total / root[k, i, i]
                        out[row, i, s] = expected[i, s] + innovation[i, s]
            else:
                for i in range(n_c):
                    for s in range(q):
                        innovation[i, s] = columns[row, i, s] - expected[i, s]
                        total = 0.0
                        for j in range(i + 1):
                            total += root[k, i, j] * innovation[j, s]
                        out[row, i, s] = total
            for r in range(n):
                for i in range(n_c):
                    weight = gain[k, r, i]
                    for s in range(q):
                        x[r, s] += weight * innovation[i, s]
            for j in range(p):
                for i in range(n_c):
                    weight = gain[k, n + j, i]
                    for s in range(q):
                        f[j, s] += weight * innovation[i, s]
            row += 1
        if k + 1 == count:
            break
        np.dot(phi[k], x, x_next)
        for j in range(p):
            rho = decay[k, j]
            if source[j] >= 0:
                for i in range(n):
                    b = g0[k, i, source[j]] + rho * g1[k, i, source[j]]
                    if b != 0.0:
                        for s in range(q):
                            x_next[i, s] += b * f[j, s]
            for s in range(q):
                f[j, s] *= rho
        x, x_next = x_next, x
