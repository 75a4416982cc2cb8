"""Functions of a model evaluated row by row along stored trajectories."""

from __future__ import annotations

import numpy as np
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


@njit(types.void(U, V, M, M, M, V, M, M, types.int64[::1], M, T), cache=True)
def observe_along(address, times, states, inputs, input_rates, p, p_dot, shape, channel, delays, out):
    """Derivative of the outputs along directions, from states [x, S_0, S_1, …] row by row; out is (nt, m, n_y)."""
    m = p_dot.shape[0]
    n = states.shape[1] // (m + 1)
    u_dot = np.zeros(inputs.shape[1])
    for k in range(times.size):
        for j in range(m):
            for c in range(u_dot.size):
                u_dot[c] = delays[j, c] * input_rates[k, c]
            if channel[j] >= 0:
                u_dot[channel[j]] += shape[k, j]
            call_tangent(
                address, times[k], states[k, :n], inputs[k], p, states[k, n * (j + 1) : n * (j + 2)], u_dot, p_dot[j],
                out[k, j])
