"""Functions of a model evaluated row by row along stored trajectories."""

from __future__ import annotations

from multibody.compile.calls import call_rhs, call_tangent, entry, independent, pointer, shift


@entry
def rhs_along(address, times, states, inputs, p, out):
    """Evaluate ``f(t, x, u, p)`` at every row; out has one row for each."""
    n, n_u, rows = states.shape[1], inputs.shape[1], out.shape[1]
    x, u, y, values = pointer(states), pointer(inputs), pointer(out), pointer(p)
    for k in range(times.size):
        call_rhs(address, times[k], shift(x, k * n), shift(u, k * n_u), values, shift(y, k * rows))


@entry
def tangents_along(address, times, states, inputs, p, x_dot, u_dot, p_dot, out):
    """Evaluate m directional derivatives at every row; x_dot (m, n), u_dot (m, n_u), p_dot (m, n_p), out (nt, m, ·)."""
    n, n_u, n_p, m, rows = x_dot.shape[1], u_dot.shape[1], p_dot.shape[1], out.shape[1], out.shape[2]
    x, u, values, y = pointer(states), pointer(inputs), pointer(p), pointer(out)
    dx, du, dp = pointer(x_dot), pointer(u_dot), pointer(p_dot)
    for k in range(times.size):
        for j in range(m):
            call_tangent(
                address,
                times[k],
                shift(x, k * n),
                shift(u, k * n_u),
                values,
                shift(dx, j * n),
                shift(du, j * n_u),
                shift(dp, j * n_p),
                shift(y, (k * m + j) * rows),
            )


@entry
def observe_along(address, times, states, inputs, input_rates, p, p_dot, shape, channel, delays, u_dot, out):
    """Derivative of the outputs along directions, from states [x, S_0, S_1, …] row by row; out is (nt, m, n_y).

    ``u_dot``, shape (n_u,), is room for the inputs' tangent.
    """
    m, width, n_u, n_p, rows = out.shape[1], states.shape[1], inputs.shape[1], p_dot.shape[1], out.shape[2]
    n = width // (m + 1)
    u, values, dp, du, y = pointer(inputs), pointer(p), pointer(p_dot), pointer(u_dot), pointer(out)
    for k in range(times.size):
        x = shift(pointer(states), k * width)
        for j in range(m):
            for c in range(n_u):
                u_dot[c] = delays[j, c] * input_rates[k, c]
            if channel[j] >= 0:
                u_dot[channel[j]] += shape[k, j]
            call_tangent(
                address,
                times[k],
                x,
                shift(u, k * n_u),
                values,
                shift(x, n * (j + 1)),
                du,
                shift(dp, j * n_p),
                shift(y, (k * m + j) * rows),
            )


@entry
def lanes_along(address, times, states, inputs, p, x_dot, u_dot, p_dot, room, out):
    """Evaluate directions, as many at once as the tangent has lanes, at every row; out (nt, rows, directions).

    Seeds are x_dot (groups, n, lanes), u_dot and p_dot likewise; the address is that of a tangent of as many directions
    (`multibody.compile.vector_mode`); ``room``, shape (rows, lanes), is for what it writes.
    """
    n, n_u, rows, count = states.shape[1], inputs.shape[1], out.shape[1], out.shape[2]
    groups, lanes, n_p = x_dot.shape[0], x_dot.shape[2], p_dot.shape[1]
    x, u, values, y, some = pointer(states), pointer(inputs), pointer(p), pointer(out), pointer(room)
    dx, du, dp = pointer(x_dot), pointer(u_dot), pointer(p_dot)
    for k in range(times.size):
        of = shift(y, k * rows * count)
        for g in range(groups):
            call_tangent(
                address,
                times[k],
                shift(x, k * n),
                shift(u, k * n_u),
                values,
                shift(dx, g * n * lanes),
                shift(du, g * n_u * lanes),
                shift(dp, g * n_p * lanes),
                some,
            )
            first = g * lanes
            for i in range(rows):
                for lane in range(min(lanes, count - first)):
                    of[i * count + first + lane] = some[i * lanes + lane]


@entry
def observe_lanes_along(address, first, times, states, inputs, rates, p, p_dot, shape, channel, delays, room, out):
    """As `observe_along`, for the directions from ``first`` on, as many at once as p_dot (n_p, lanes) has lanes.

    Only out, shape (nt, count, n_y), says how many of them there are; ``room`` is for their other arguments.
    """
    count, rows, lanes, n_u = out.shape[1], out.shape[2], p_dot.shape[1], inputs.shape[1]
    width, m = states.shape[1], channel.size
    n = width // (m + 1)
    u, values, dp, y = pointer(inputs), pointer(p), pointer(p_dot), pointer(out)
    x_wide = pointer(room)
    u_wide = shift(x_wide, n * lanes)
    lanes_out = shift(u_wide, n_u * lanes)
    for k in range(times.size):
        x = shift(pointer(states), k * width)
        columns = shift(x, n * (first + 1))
        for i in range(n):
            for lane in independent(count):
                x_wide[i * lanes + lane] = columns[n * lane + i]
        for lane in range(count):
            j = first + lane
            for c in range(n_u):
                u_wide[c * lanes + lane] = delays[j, c] * rates[k, c]
            if channel[j] >= 0:
                u_wide[channel[j] * lanes + lane] += shape[k, j]
        call_tangent(address, times[k], x, shift(u, k * n_u), values, x_wide, u_wide, dp, lanes_out)
        of = shift(y, k * count * rows)
        for i in range(rows):
            for lane in range(count):
                of[lane * rows + i] = lanes_out[i * lanes + lane]
