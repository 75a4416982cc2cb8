"""Many small additions to inputs carried through a machine that is linear around its trajectory."""

from __future__ import annotations

import numpy as np
from numba import njit, types

from multibody.solvers.kernels.stepping import TINY

I = types.int64[::1]  # noqa: E741
M = types.float64[:, ::1]
T = types.float64[:, :, ::1]


@njit(types.void(T, T, T, T, T, I, M, T), cache=True)
def carry(phi, gamma0, gamma1, c, d, channel, push, out):
    """Write the change of the outputs, out (nt, n_y, m), by additions push (nt, m) to the inputs ``channel`` (m,).

    δ_{k+1} = phi δ_k + gamma0 φ_k + gamma1 φ_{k+1}, y = c δ + d φ; δ begins at zero.
    """
    n, m = phi.shape[1], push.shape[1]
    now, then = np.zeros((n, m)), np.zeros((n, m))
    for k in range(push.shape[0]):
        if k > 0:
            for i in range(n):
                for j in range(m):
                    a = channel[j]
                    then[i, j] = gamma0[k - 1, i, a] * push[k - 1, j] + gamma1[k - 1, i, a] * push[k, j]
                for h in range(n):
                    f = phi[k - 1, i, h]
                    if f != 0.0:
                        for j in range(m):
                            then[i, j] += f * now[h, j]
                for j in range(m):
                    if abs(then[i, j]) < TINY:
                        then[i, j] = 0.0
            now, then = then, now
        for i in range(c.shape[1]):
            for j in range(m):
                out[k, i, j] = d[k, i, channel[j]] * push[k, j]
            for h in range(n):
                f = c[k, i, h]
                if f != 0.0:
                    for j in range(m):
                        out[k, i, j] += f * now[h, j]
