"""Functions of a model evaluated row by row along stored trajectories."""

from __future__ import annotations

from numba import njit, types

from multibody.solvers.kernels.calls import call_rhs, call_tangent

V = types.float64[::1]
M = types.float64[:, ::1]
T = types.float64[:, :, ::1]
U = types.uintp


@njit(types.void(U, V, M, M, V, M), cache=True)
def rhs_along(address, times, states, inputs, p, out):
    """Evaluate ``f(t, x, u, p)`` at every row; out has one row for each."""
    for k in range(times.size):
        call_rhs(address, times[k], states[k], inputs[k], p, out[k])


@njit(types.void(U, V, M, M, V, M, M, M, T), cache=True)
def tangents_along(address, times, states, inputs, p, x_dot, u_dot, p_dot, out):
    """Evaluate m directional derivatives at every row; x_dot (m, n), u_dot (m, n_u), p_dot (m, n_p), out (nt, m, ·)."""
    for k in range(times.size):
        for j in range(x_dot.shape[0]):
            call_tangent(address, times[k], states[k], inputs[k], p, x_dot[j], u_dot[j], p_dot[j], out[k, j])
