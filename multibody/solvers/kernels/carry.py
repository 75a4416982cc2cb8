"""Many small additions to inputs carried through a machine that is linear around its trajectory."""

from __future__ import annotations

import numpy as np
from numba import njit, types

from multibody.solvers.kernels.stepping import TINY

I = types.int64[::1]  # noqa: E741
M = types.float64[:, ::1]
T = types.float64[:, :, ::1]


@njit(inline="always", fastmath={"contract"})
def add_products(factors, rows, total):
    """Add the sum of some rows times their factors, four at a time: the total is then read and written less often."""
    n, m = factors.size, total.size
    first = 0
    while first + 4 <= n:
        f0, f1, f2, f3 = factors[first], factors[first + 1], factors[first + 2], factors[first + 3]
        a0, a1, a2, a3 = rows[first], rows[first + 1], rows[first + 2], rows[first + 3]
        for j in range(m):
            total[j] += f0 * a0[j] + f1 * a1[j] + f2 * a2[j] + f3 * a3[j]
        first += 4
    while first < n:
        f0, a0 = factors[first], rows[first]
        for j in range(m):
            total[j] += f0 * a0[j]
        first += 1


@njit(types.void(T, T, T, T, T, I, M, T), cache=True, nogil=True, fastmath={"contract"})
def carry(phi, gamma0, gamma1, c, d, channel, push, out):
    """Write the change of the outputs, out (nt, n_y, m), by additions push (nt, m) to the inputs ``channel`` (m,).

    δ_{k+1} = phi δ_k + gamma0 φ_k + gamma1 φ_{k+1}, y = c δ + d φ; δ begins at zero.
    """
    n, m = phi.shape[1], push.shape[1]
    now, then = np.zeros((n, m)), np.zeros((n, m))
    for k in range(push.shape[0]):
        if k > 0:
            for i in range(n):
                row = then[i]
                for j in range(m):
                    a = channel[j]
                    row[j] = gamma0[k - 1, i, a] * push[k - 1, j] + gamma1[k - 1, i, a] * push[k, j]
                add_products(phi[k - 1, i], now, row)
            for i in range(n):
                for j in range(m):
                    x = then[i, j]
                    now[i, j] = x if abs(x) >= TINY else 0.0
        for i in range(c.shape[1]):
            row = out[k, i]
            for j in range(m):
                row[j] = d[k, i, channel[j]] * push[k, j]
            add_products(c[k, i], now, row)


