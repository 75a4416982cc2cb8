"""Compiled recursions of the innovation filter: covariances of a record, then any number of columns whitened."""

from __future__ import annotations

import numpy as np
from numba import njit

from multibody.compile.sealed_code import njit_kept

__all__ = ["covariance_pass", "filter_columns", "score_pass"]


@njit(nogil=True, inline="always")
def _output_rows(c, d, source, channel, k, H):  # type: ignore[no-untyped-def]
    """Write how the outputs of a sample depend on states and processes, shape (n_c, n + p)."""
    n_c, n = c.shape[1], c.shape[2]
    for i in range(n_c):
        for s in range(n):
            H[i, s] = c[k, i, s]
        for j in range(source.size):
            H[i, n + j] = d[k, i, source[j]] if source[j] >= 0 else (1.0 if channel[j] == i else 0.0)


@njit(nogil=True, inline="always")
def _state_rows(phi, g0, g1, source, partner, along, turn, k, A):  # type: ignore[no-untyped-def]
    """Write how the states of the next sample depend on states and processes of this one, shape (n, n + p)."""
    n = phi.shape[1]
    for i in range(n):
        for s in range(n):
            A[i, s] = phi[k, i, s]
        for j in range(source.size):
            A[i, n + j] = 0.0
        for j in range(source.size):
            v = source[j]
            if v >= 0:
                A[i, n + j] += g0[k, i, v] + along[k, j] * g1[k, i, v]
                A[i, n + partner[j]] += turn[k, j] * g1[k, i, v]


@njit(nogil=True, inline="always")
def _driven_together(partner, along, turn, variance, k, j):  # type: ignore[no-untyped-def]
    """Return the covariance of what drives a process to the next sample with what drives its partner."""
    o = partner[j]
    return -variance[j] * (along[k, j] * turn[k, o] + turn[k, j] * along[k, o])


@njit_kept(calls=(_output_rows, _state_rows, _driven_together), nogil=True)
def covariance_pass(  # type: ignore[no-untyped-def]
    phi, g0, g1, c, d, counts, source, channel, partner, along, turn, variance, noise, gain, root, latent
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
    partner : ndarray of int, shape (p,)
        The process that it turns into and out of; itself if there is none.
    along, turn : ndarray, shape (N - 1, p)
        From one sample to the next a process keeps ``along`` of itself and gains ``turn`` of its partner.
    variance : ndarray, shape (p,)
        Stationary variance of each process, the same of partners, which are independent of each other at one time.
    noise : ndarray, shape (n_c, n_c)
        Covariance of the white noise of the outputs.
    gain : ndarray, shape (N, n + p, n_c)
        Filter gain: written.
    root : ndarray, shape (N, n_c, n_c)
        Inverse of the lower Cholesky factor of the innovations' covariance: written, where a sample counts.
    latent : ndarray, shape (N, p, n + p)
        Covariance of the processes with the states and the processes, after each sample: written.

    Raises
    ------
    LinAlgError
        If the covariance of an innovation is not positive definite.
    """
    count, n, n_c, p = c.shape[0], c.shape[2], c.shape[1], source.size
    size = n + p
    P, A, T, X = np.zeros((size, size)), np.zeros((n, size)), np.zeros((n, size)), np.zeros((n, n))
    for j in range(p):
        P[n + j, n + j] = variance[j]
    H, HP, G = np.zeros((n_c, size)), np.zeros((n_c, size)), np.zeros((n_c, size))
    M, MP, U = np.zeros((size, size)), np.zeros((size, size)), np.zeros((p, p))
    S, L, weight = np.zeros((n_c, n_c)), np.zeros((n_c, n_c)), np.zeros((n_c, n_c))
    log_det = 0.0
    for k in range(count):
        if counts[k]:
            _output_rows(c, d, source, channel, k, H)
            np.dot(H, P, HP)  # rows of outputs: the loops over states then run along memory, and are vectorised
            np.dot(HP, H.T, S)
            inverse = root[k]
            inverse[:, :] = 0.0
            for i in range(n_c):  # Cholesky factor of H P Hᵀ + noise, and its inverse
                for j in range(i + 1):
                    total = S[i, j] + noise[i, j]
                    for q in range(j):
                        total -= L[i, q] * L[j, q]
                    if j < i:
                        L[i, j] = total / L[j, j]
                    elif total > 0.0:
                        L[i, i] = np.sqrt(total)
                    else:
                        raise np.linalg.LinAlgError("the covariance of an innovation is not positive definite")
                log_det += np.log(L[i, i])
                inverse[i, i] = 1.0 / L[i, i]
                for j in range(i):
                    total = 0.0
                    for r in range(j, i):
                        total += L[i, r] * inverse[r, j]
                    inverse[i, j] = -total / L[i, i]
            for i in range(n_c):  # S⁻¹ = L⁻ᵀ L⁻¹
                for j in range(i + 1):
                    total = 0.0
                    for q in range(i, n_c):
                        total += inverse[q, j] * inverse[q, i]
                    weight[i, j] = total
                    weight[j, i] = total
            for i in range(n_c):  # the gain, transposed: S⁻¹ H P
                for r in range(size):
                    G[i, r] = 0.0
                for j in range(n_c):
                    for r in range(size):
                        G[i, r] += weight[i, j] * HP[j, r]
                for r in range(size):
                    gain[k, r, i] = G[i, r]
            surprising = False
            for i in range(n_c):
                surprising |= L[i, i] ** 2 > 1e6 * noise[i, i]  # where dry friction lets go, a state grows by 1e5
            if surprising:  # Joseph's form: a difference of large numbers would lose what is left of P
                for r in range(size):
                    for s in range(size):
                        total = 1.0 if r == s else 0.0
                        for i in range(n_c):
                            total -= gain[k, r, i] * H[i, s]
                        M[r, s] = total
                np.dot(M, P, MP)
                np.dot(MP, M.T, P)
                for r in range(size):
                    for s in range(r + 1):
                        total = 0.5 * (P[r, s] + P[s, r])
                        for i in range(n_c):
                            for j in range(n_c):
                                total += gain[k, r, i] * noise[i, j] * gain[k, s, j]
                        P[r, s] = total
                        P[s, r] = total
            else:
                for r in range(size):
                    for i in range(n_c):
                        weighted = G[i, r]
                        for s in range(r + 1):
                            P[r, s] -= weighted * HP[i, s]
                    for s in range(r):
                        P[s, r] = P[r, s]
        for j in range(p):
            for s in range(size):
                latent[k, j, s] = P[n + j, s]
        if k + 1 == count:
            break
        _state_rows(phi, g0, g1, source, partner, along, turn, k, A)
        np.dot(A, P, T)
        np.dot(T, A.T, X)
        for j in range(p):
            for t in range(p):
                U[j, t] = along[k, j] * P[n + j, n + t] + turn[k, j] * P[n + partner[j], n + t]
        for j in range(p):
            for t in range(j + 1):
                value = along[k, t] * U[j, t] + turn[k, t] * U[j, partner[t]]
                P[n + j, n + t] = value
                P[n + t, n + j] = value
            P[n + j, n + j] += variance[j] * (1.0 - along[k, j] ** 2 - turn[k, j] ** 2)
            if partner[j] < j:
                together = _driven_together(partner, along, turn, variance, k, j)
                P[n + j, n + partner[j]] += together
                P[n + partner[j], n + j] += together
        for i in range(n):
            for j in range(p):
                value = along[k, j] * T[i, n + j] + turn[k, j] * T[i, n + partner[j]]
                if source[j] >= 0:
                    value += g1[k, i, source[j]] * variance[j] * (1.0 - along[k, j] ** 2 - turn[k, j] ** 2)
                if source[partner[j]] >= 0 and partner[j] != j:
                    value += g1[k, i, source[partner[j]]] * _driven_together(partner, along, turn, variance, k, j)
                P[i, n + j] = value
                P[n + j, i] = value
            for r in range(i + 1):
                P[i, r] = X[i, r]
        for j in range(p):
            if source[j] >= 0:
                q = variance[j] * (1.0 - along[k, j] ** 2 - turn[k, j] ** 2)
                for i in range(n):
                    driven = q * g1[k, i, source[j]]
                    if driven != 0.0:
                        for r in range(i + 1):
                            P[i, r] += driven * g1[k, r, source[j]]
        for i in range(n):
            for r in range(i):
                P[r, i] = P[i, r]
    return log_det


@njit_kept(calls=(_output_rows, _state_rows, _driven_together), nogil=True)
def score_pass(  # type: ignore[no-untyped-def]
    phi,
    g0,
    g1,
    c,
    d,
    observed,
    counts,
    source,
    channel,
    partner,
    along,
    turn,
    variance,
    gain,
    root,
    latent,
    white,
    noise,
    first,
    driving,
    together,
    kept,
    gained,
    course,
):
    """Run the disturbance smoother backwards along a record; write what the derivatives of the likelihood consist of.

    The score of a Gaussian state-space model (Koopman and Shephard, Biometrika 79, 1992): with the smoothed noises u of
    the outputs and r of the states, and their covariances D and N, each variance has as its derivative half the sum of
    the squares minus the covariances.  The derivative by the transition T of a sample, x ↦ T x, is
    r E[x]ᵀ - N T P with the smoothed mean E[x] and the covariance P of the filter; that of the processes follows
    forwards from the smoothed noises that drive them, for they depend on nothing else.

    Parameters
    ----------
    phi, g0, g1, c, d, counts, source, channel, partner, along, turn, variance, gain, root, latent : ndarray
        As in `covariance_pass`.
    observed : ndarray of bool, shape (N,)
    white : ndarray, shape (N_observed, n_c, q)
        Standardised innovations whose squares are added up: of a residual, and of what is uncertain in it.
    noise : ndarray, shape (n_c, n_c)
        Written: the sum of u uᵀ - D.
    first : ndarray, shape (p,)
        Written: for each process squares minus covariances of its first value.
    driving : ndarray, shape (N - 1, p)
        Written: squares minus covariances of what drives it to the next sample.
    together : ndarray, shape (N - 1, p)
        Written: products minus covariances of what drives it and what drives its partner; zero without one.
    kept, gained : ndarray, shape (N - 1, p)
        Written: derivatives by ``along`` and by ``turn``, what drives it held at its variance.
    course : ndarray, shape (N, p)
        Written: the smoothed mean of every process, given the first column.
    """
    count, n, n_c, p = c.shape[0], c.shape[2], c.shape[1], source.size
    size, q = n + p, white.shape[2]
    H, A = np.zeros((n_c, size)), np.zeros((n, size))
    r, before = np.zeros((size, q)), np.zeros((size, q))
    N, NA = np.zeros((size, size)), np.zeros((size, size))
    u, E, F, D = np.zeros((n_c, q)), np.zeros((n_c, size)), np.zeros((n_c, size)), np.zeros((n_c, n_c))
    g, m = np.zeros(size), np.zeros(size)
    pushed = np.zeros((count, p, q))
    path, path_next = np.zeros((p, q)), np.zeros((p, q))
    noise[:, :] = 0.0
    row = white.shape[0]
    for k in range(count - 1, -1, -1):
        if k + 1 < count:
            for j in range(p):
                for i in range(n):
                    g[i] = g1[k, i, source[j]] if source[j] >= 0 else 0.0
                total = 0.0
                for s in range(q):
                    driven = r[n + j, s]
                    for i in range(n):
                        driven += g[i] * r[i, s]
                    pushed[k, j, s] = driven
                    total += driven * driven
                total -= N[n + j, n + j]
                for i in range(n):
                    if g[i] != 0.0:
                        total -= 2.0 * g[i] * N[i, n + j]
                        for t in range(n):
                            total -= g[i] * g[t] * N[i, t]
                driving[k, j] = total
            for j in range(p):
                o = partner[j]
                if o < j:
                    total = -N[n + j, n + o]
                    for t in range(q):
                        total += pushed[k, j, t] * pushed[k, o, t]
                    for i in range(n):
                        of_one = g1[k, i, source[j]] if source[j] >= 0 else 0.0
                        of_other = g1[k, i, source[o]] if source[o] >= 0 else 0.0
                        total -= of_one * N[i, n + o] + of_other * N[i, n + j]
                        if of_one != 0.0 and source[o] >= 0:
                            for t in range(n):
                                total -= of_one * g1[k, t, source[o]] * N[i, t]
                    together[k, j] = total
                    together[k, o] = total
            _state_rows(phi, g0, g1, source, partner, along, turn, k, A)
            for s in range(size):  # r = Aᵀ r, N = Aᵀ N A
                for t in range(q):
                    before[s, t] = 0.0
                    if s >= n:
                        other = partner[s - n]
                        before[s, t] = along[k, s - n] * r[s, t] + turn[k, other] * r[n + other, t]
                for i in range(n):
                    a = A[i, s]
                    if a != 0.0:
                        for t in range(q):
                            before[s, t] += a * r[i, t]
            r, before = before, r
            for s in range(size):
                for t in range(size):
                    NA[s, t] = 0.0
                    if t >= n:
                        other = partner[t - n]
                        NA[s, t] = N[s, t] * along[k, t - n] + N[s, n + other] * turn[k, other]
                for i in range(n):
                    a = N[s, i]
                    if a != 0.0:
                        for t in range(size):
                            NA[s, t] += a * A[i, t]
            for j in range(p):
                for t in range(size):
                    m[t] = NA[n + j, t]
                if source[j] >= 0:
                    for i in range(n):
                        a = g1[k, i, source[j]]
                        if a != 0.0:
                            for t in range(size):
                                m[t] += a * NA[i, t]
                kept[k, j] = 0.0
                gained[k, j] = 0.0
                for t in range(size):
                    kept[k, j] -= m[t] * latent[k, j, t]
                    gained[k, j] -= m[t] * latent[k, partner[j], t]
            for s in range(size):
                for t in range(s + 1):
                    N[s, t] = 0.0
                    if s >= n:
                        other = partner[s - n]
                        N[s, t] = along[k, s - n] * NA[s, t] + turn[k, other] * NA[n + other, t]
                for i in range(n):
                    a = A[i, s]
                    if a != 0.0:
                        for t in range(s + 1):
                            N[s, t] += a * NA[i, t]
                for t in range(s):
                    N[t, s] = N[s, t]
        if observed[k]:
            row -= 1
        if counts[k]:
            _output_rows(c, d, source, channel, k, H)
            for i in range(n_c):
                for t in range(q):
                    u[i, t] = 0.0
                for j in range(i, n_c):  # the root is lower triangular
                    a = root[k, j, i]
                    for t in range(q):
                        u[i, t] += a * white[row, j, t]
                for s in range(size):
                    a = gain[k, s, i]
                    for t in range(q):
                        u[i, t] -= a * r[s, t]
                for t in range(size):
                    E[i, t] = 0.0
                for s in range(size):
                    a = gain[k, s, i]
                    for t in range(size):
                        E[i, t] += a * N[s, t]
            for i in range(n_c):
                for j in range(i + 1):
                    total = 0.0
                    for t in range(i, n_c):
                        total += root[k, t, i] * root[k, t, j]
                    D[i, j] = total
                for s in range(size):
                    e = E[i, s]
                    for j in range(i + 1):
                        D[i, j] += e * gain[k, s, j]
                for j in range(i + 1):
                    D[j, i] = D[i, j]
                    total = D[i, j]
                    for t in range(q):
                        total -= u[i, t] * u[j, t]
                    noise[i, j] -= total
                    if i != j:
                        noise[j, i] -= total
            for i in range(n_c):  # F = D H / 2 - E
                for t in range(size):
                    F[i, t] = -E[i, t]
                for j in range(n_c):
                    weight = 0.5 * D[i, j]
                    for t in range(size):
                        F[i, t] += weight * H[j, t]
            for s in range(size):
                for i in range(n_c):
                    h = H[i, s]
                    if h != 0.0:
                        for t in range(q):
                            r[s, t] += h * u[i, t]
            for s in range(size):  # N + Hᵀ F + Fᵀ H
                for i in range(n_c):
                    h, f = H[i, s], F[i, s]
                    for t in range(s + 1):
                        N[s, t] += h * F[i, t] + f * H[i, t]
                for t in range(s):
                    N[t, s] = N[s, t]
    for j in range(p):  # a process begins with its stationary variance
        total = -N[n + j, n + j]
        for t in range(q):
            total += r[n + j, t] ** 2
            path[j, t] = variance[j] * r[n + j, t]
        first[j] = total
        course[0, j] = path[j, 0]
    for k in range(count - 1):
        for j in range(p):
            o = partner[j]
            driven = variance[j] * (1.0 - along[k, j] ** 2 - turn[k, j] ** 2)
            shared = _driven_together(partner, along, turn, variance, k, j) if o != j else 0.0
            for t in range(q):
                kept[k, j] += pushed[k, j, t] * path[j, t]
                gained[k, j] += pushed[k, j, t] * path[o, t]
                path_next[j, t] = along[k, j] * path[j, t] + turn[k, j] * path[o, t]
                path_next[j, t] += driven * pushed[k, j, t] + shared * pushed[k, o, t]
        path, path_next = path_next, path
        for j in range(p):
            course[k + 1, j] = path[j, 0]


@njit_kept(nogil=True)
def filter_columns(  # type: ignore[no-untyped-def]
    phi, g0, g1, c, d, observed, counts, source, channel, partner, along, turn, gain, root, columns, out, inverse
):
    """Whiten columns, shape (N_observed, n_c, q), by the filter of `covariance_pass`; written to ``out``.

    With ``inverse`` columns are innovations, and what they are the innovations of is written.  A sample that does not
    count has innovations of zero.
    """
    count, n, n_c, p = c.shape[0], c.shape[2], c.shape[1], source.size
    q = columns.shape[2]
    x, f, f_next = np.zeros((n, q)), np.zeros((p, q)), np.zeros((p, q))
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
            for s in range(q):
                f_next[j, s] = along[k, j] * f[j, s] + turn[k, j] * f[partner[j], s]
        for j in range(p):
            if source[j] >= 0:
                for i in range(n):
                    g, h = g0[k, i, source[j]], g1[k, i, source[j]]
                    if g != 0.0 or h != 0.0:
                        for s in range(q):
                            x_next[i, s] += g * f[j, s] + h * f_next[j, s]
        f, f_next = f_next, f
        x, x_next = x_next, x
