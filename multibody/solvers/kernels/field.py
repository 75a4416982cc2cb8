"""Inputs at a time, and the right-hand side with its directional derivatives, for every compiled driver.

Drivers get a `Field` (see `bundle`).
"""

from __future__ import annotations

import math

from multibody.solvers.kernels.bundle import LINEAR
from multibody.solvers.kernels.calls import call_rhs, call_tangent, entry, inner


@inner
def locate(times, s, i):
    """Return the interval i with times[i] <= s < times[i+1], beginning the search at i."""
    last = times.size - 2
    if last < 0:
        return 0
    if times[i] <= s:
        if i == last or s < times[i + 1]:
            return i
        if i + 1 == last or s < times[i + 2]:
            return i + 1
        low, high = i + 2, last + 1
    else:
        if i == 0 or times[i - 1] <= s:
            return max(i - 1, 0)
        low, high = 0, i - 1
    while high - low > 1:
        middle = (low + high) // 2
        if times[middle] <= s:
            low = middle
        else:
            high = middle
    return min(low, last)


@inner
def look_up(t, field):
    """Write the continuously changing inputs at time t into u."""
    times, values, slopes, kinds, delays = field.times, field.values, field.slopes, field.kinds, field.delays
    p, moving, u, cursor = field.p, field.moving, field.u, field.cursor
    end = times.size - 1
    for a in range(moving.size):
        c = moving[a]
        s = t
        if delays[c] >= 0:
            s -= p[delays[c]]
        if s <= times[0]:
            u[c] = values[0, c]
        elif s >= times[end]:
            u[c] = values[end, c]
        else:
            i = locate(times, s, cursor[c])
            cursor[c] = i
            width = times[i + 1] - times[i]
            z = (s - times[i]) / width
            if kinds[c] == LINEAR:
                u[c] = values[i, c] + z * (values[i + 1, c] - values[i, c])
            else:
                rise = values[i + 1, c] - values[i, c]
                a0 = width * slopes[i, c] - rise
                a1 = rise - width * slopes[i + 1, c]
                u[c] = values[i, c] + z * (rise + (1.0 - z) * ((1.0 - z) * a0 + z * a1))


@inner
def look_up_rate(t, field):
    """Write the time derivative of every delayed input into rate; that of a held input is taken as zero."""
    times, values, slopes, kinds, delays = field.times, field.values, field.slopes, field.kinds, field.delays
    p, moving, rate, cursor = field.p, field.moving, field.rate, field.cursor
    end = times.size - 1
    for a in range(moving.size):
        c = moving[a]
        if delays[c] < 0:
            continue
        s = t - p[delays[c]]
        if s <= times[0] or s >= times[end]:
            rate[c] = 0.0
            continue
        i = locate(times, s, cursor[c])
        cursor[c] = i
        width = times[i + 1] - times[i]
        rise = (values[i + 1, c] - values[i, c]) / width
        if kinds[c] == LINEAR:
            rate[c] = rise
        else:
            z = (s - times[i]) / width
            a0 = slopes[i, c] - rise
            a1 = rise - slopes[i + 1, c]
            rate[c] = rise + (1.0 - 2.0 * z) * ((1.0 - z) * a0 + z * a1) + z * (1.0 - z) * (a1 - a0)


@inner
def hold_at(t, field):
    """Write the held inputs of time t into u; t is inside a step, so that it is on no jump."""
    times, values, delays = field.times, field.values, field.delays
    p, held, u, cursor = field.p, field.held, field.u, field.cursor
    end = times.size - 1
    for a in range(held.size):
        c = held[a]
        s = t
        if delays[c] >= 0:
            s -= p[delays[c]]
        if s >= times[end]:
            u[c] = values[end, c]
        else:
            i = locate(times, s, cursor[c])
            cursor[c] = i
            u[c] = values[i, c]


@inner
def next_jump(t, direction, reach, field):
    """Return the time of the next jump of a held input in the direction of integration, within reach."""
    times, values, delays = field.times, field.values, field.delays
    p, held, cursor = field.p, field.held, field.cursor
    end = times.size - 1
    near = 1e-14 * abs(t)
    best = direction * math.inf
    for a in range(held.size):
        c = held[a]
        delay = 0.0
        if delays[c] >= 0:
            delay = p[delays[c]]
        i = locate(times, t - delay, cursor[c])
        if direction > 0.0:
            j = max(i, 1)
            while j <= end and times[j] + delay <= t + reach:
                if times[j] + delay > t + near and values[j, c] != values[j - 1, c]:
                    best = min(best, times[j] + delay)
                    break
                j += 1
        else:
            j = min(i + 1, end)
            while j >= 1 and times[j] + delay >= t - reach:
                if times[j] + delay < t - near and values[j, c] != values[j - 1, c]:
                    best = max(best, times[j] + delay)
                    break
                j -= 1
    return best


@inner
def input_tangent(t, k, field):
    """Write the tangent of the inputs along direction k into u_dot."""
    rate, u_dot, channel, weight = field.rate, field.u_dot, field.channel, field.weight
    shape_t, shape, shape_cursor, delayed = field.shape_t, field.shape, field.shape_cursor, field.delayed
    for c in range(u_dot.size):
        u_dot[c] = 0.0
    if delayed:
        for c in range(u_dot.size):
            u_dot[c] = weight[k, c] * rate[c]
    c = channel[k]
    if c >= 0:
        end = shape_t.size - 1
        if t <= shape_t[0]:
            u_dot[c] += shape[0, k]
        elif t >= shape_t[end]:
            u_dot[c] += shape[end, k]
        else:
            i = locate(shape_t, t, shape_cursor[0])
            shape_cursor[0] = i
            z = (t - shape_t[i]) / (shape_t[i + 1] - shape_t[i])
            u_dot[c] += (1.0 - z) * shape[i, k] + z * shape[i + 1, k]


@inner
def tangents(t, y, dy, field):
    """Write the derivative of every direction's column of y into dy; u must be that of time t."""
    tangent, n, m, p, u, u_dot, p_dot = (
        field.tangent,
        field.n,
        field.m,
        field.p,
        field.u,
        field.u_dot,
        field.p_dot,
    )
    if field.delayed:
        look_up_rate(t, field)
    for k in range(m):
        input_tangent(t, k, field)
        a = n * (k + 1)
        call_tangent(tangent, t, y, u, p, y[a : a + n], u_dot, p_dot[k], dy[a : a + n])


@inner
def evaluate(t, y, dy, field):
    """Write the derivative of y = [x, directions] at time t into dy; held inputs stay as they are."""
    if field.moving.size > 0:
        look_up(t, field)
    call_rhs(field.rhs, t, y, field.u, field.p, dy)
    if field.m > 0:
        tangents(t, y, dy, field)


@entry
def evaluate_at(t, y, dy, field):
    """Evaluate once, from Python; at a jump the value after it counts."""
    hold_at(t, field)
    evaluate(t, y, dy, field)


@entry
def inputs_along(t, out, out_rate, field):
    """Write the inputs, and the rates of the delayed ones, at many times."""
    for i in range(t.size):
        hold_at(t[i], field)
        look_up(t[i], field)
        look_up_rate(t[i], field)
        for c in range(out.shape[1]):
            out[i, c] = field.u[c]
            out_rate[i, c] = field.rate[c]
