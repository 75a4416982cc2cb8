"""Inputs at a time, and the right-hand side with its directional derivatives, for every compiled driver.

``c`` is the vector of a `Field` (see `bundle` for its indices), ``y`` is [x, directions].
"""

from __future__ import annotations

import math

from multibody.compile.calls import (
    call_rhs,
    call_tangent,
    entry,
    floats,
    independent,
    inner,
    ints,
    pointer,
    shift,
)
from multibody.solvers.kernels.field_layout import (
    BREAK_CURSOR,
    BREAK_DELAY,
    BREAK_START,
    BREAKS,
    CHANNEL,
    CURSOR,
    DELAYED,
    DELAYS,
    FADING,
    HELD,
    KINDS,
    LANES,
    LINEAR,
    MOVING,
    N_GROUPS,
    N_HELD,
    N_MOVING,
    N_P,
    N_U,
    P_DOT,
    P_WIDE,
    PLAIN,
    PUSHED,
    RATE,
    RHS,
    ROOM,
    ROWS,
    SHAPE,
    SHAPE_CURSOR,
    SHAPE_ROWS,
    SHAPE_T,
    SLOPES,
    TANGENT,
    TIMES,
    U_DOT,
    VALUES,
    WEIGHT,
    WIDE,
    WINDOW,
    M,
    N,
    P,
    U,
)


@inner
def locate(times, rows, s, i):
    """Return the interval i with times[i] <= s < times[i+1], beginning the search at i."""
    last = rows - 2
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
def own_time(t, column, c):
    """Return the time at which a column is looked up."""
    delay = ints(c[DELAYS])[column]
    return t - floats(c[P])[delay] if delay >= 0 else t


@inner
def interval(s, column, c):
    """Return the interval of the table that holds a time inside it, and remember it for a column."""
    times, cursor, end = floats(c[TIMES]), ints(c[CURSOR]), c[ROWS] - 1
    i = cursor[column]
    if s < times[i] or s >= times[i + 1]:
        pace = floats(c[WINDOW])[3]
        if pace > 0.0:  # an even grid: a step that is longer than two of its intervals needs no search
            i = min(int((s - times[0]) * pace), end - 1)
        i = locate(times, end + 1, s, i)
        cursor[column] = i
    return i


@inner
def look_up_plain(t, c):
    """As `look_up`, where every column is linear between its samples and none is delayed."""
    times, u, moving, end = floats(c[TIMES]), floats(c[U]), ints(c[MOVING]), c[ROWS] - 1
    if times[0] < t < times[end]:
        i = interval(t, moving[0], c)
        z = (t - times[i]) / (times[i + 1] - times[i])
        low = shift(floats(c[VALUES]), i * c[N_U])
        high = shift(low, c[N_U])
        for a in range(c[N_MOVING]):
            column = moving[a]
            u[column] = low[column] + z * (high[column] - low[column])
    else:
        row = shift(floats(c[VALUES]), 0 if t <= times[0] else end * c[N_U])
        for a in range(c[N_MOVING]):
            u[moving[a]] = row[moving[a]]


@inner
def look_up(t, c):
    """Write the continuously changing inputs at time t into u."""
    seen = shift(floats(c[WINDOW]), 2)
    if t == seen[0]:  # the last stages of a step are at one time
        return
    seen[0] = t
    if c[PLAIN] != 0:
        look_up_plain(t, c)
        return
    times, values, slopes, u = floats(c[TIMES]), floats(c[VALUES]), floats(c[SLOPES]), floats(c[U])
    kinds, moving = ints(c[KINDS]), ints(c[MOVING])
    width, end = c[N_U], c[ROWS] - 1
    last, i, z, span, inside = math.nan, 0, 0.0, 1.0, False
    for a in range(c[N_MOVING]):
        column = moving[a]
        s = own_time(t, column, c)
        if s != last:  # columns of one delay are looked up at one time: the search and the division are done once
            last = s
            inside = times[0] < s < times[end]
            i = 0 if s <= times[0] else end
            if inside:
                i = interval(s, column, c)
                span = times[i + 1] - times[i]
                z = (s - times[i]) / span
        j = i * width + column
        if not inside:
            u[column] = values[j]
            continue
        rise = values[j + width] - values[j]
        if kinds[column] == LINEAR:
            u[column] = values[j] + z * rise
        else:
            left = span * slopes[j] - rise
            right = rise - span * slopes[j + width]
            u[column] = values[j] + z * (rise + (1.0 - z) * ((1.0 - z) * left + z * right))


@inner
def look_up_rates(t, c):
    """Write the time derivative of every delayed input into rate; of a held input its jumps, spread over two intervals.

    It may jump where steps begin and end; there the value inside the step counts.
    """
    window = floats(c[WINDOW])
    t = min(max(t, window[0]), window[1])
    times, values, slopes, rate = floats(c[TIMES]), floats(c[VALUES]), floats(c[SLOPES]), floats(c[RATE])
    kinds, moving, held, delays = ints(c[KINDS]), ints(c[MOVING]), ints(c[HELD]), ints(c[DELAYS])
    width, end, count = c[N_U], c[ROWS] - 1, c[N_MOVING]
    for a in range(count + c[N_HELD]):
        column = moving[a] if a < count else held[a - count]
        if delays[column] < 0:
            continue
        s = own_time(t, column, c)
        if s <= times[0] or s >= times[end]:
            rate[column] = 0.0
            continue
        i = interval(s, column, c)
        j = i * width + column
        if a >= count:
            rate[column] = slopes[j]
            continue
        span = times[i + 1] - times[i]
        rise = (values[j + width] - values[j]) / span
        rate[column] = rise
        if kinds[column] != LINEAR:
            z = (s - times[i]) / span
            left, right = slopes[j] - rise, rise - slopes[j + width]
            rate[column] += (1.0 - 2.0 * z) * ((1.0 - z) * left + z * right) + z * (1.0 - z) * (right - left)


@inner
def hold_at(t, c):
    """Write the held inputs of time t into u; the solvers ask inside a step, so that t is on no jump."""
    times, values, u = floats(c[TIMES]), floats(c[VALUES]), floats(c[U])
    cursor, held = ints(c[CURSOR]), ints(c[HELD])
    end = c[ROWS] - 1
    for a in range(c[N_HELD]):
        column = held[a]
        s = own_time(t, column, c)
        i = end
        if s < times[end]:
            i = locate(times, end + 1, s, cursor[column])
            cursor[column] = i
        u[column] = values[i * c[N_U] + column]


@inner
def next_break(t, direction, c):
    """Return the next time at which a step must end, in the direction of integration, and its index."""
    times, start, delays = floats(c[BREAKS]), ints(c[BREAK_START]), ints(c[BREAK_DELAY])
    cursor = ints(c[BREAK_CURSOR])
    # What is nearer than rounding has been reached.
    edge = t + direction * 1e-14 * abs(t)
    best, index = direction * math.inf, -1
    for g in range(c[N_GROUPS]):
        delay = floats(c[P])[delays[g]] if delays[g] >= 0 else 0.0
        j, low, high = cursor[g], start[g], start[g + 1]
        # j becomes the first break that lies after the edge, or for a backward search not before it.
        while j < high and (times[j] + delay <= edge if direction > 0.0 else times[j] + delay < edge):
            j += 1
        while j > low and (times[j - 1] + delay > edge if direction > 0.0 else times[j - 1] + delay >= edge):
            j -= 1
        cursor[g] = j
        if direction < 0.0:
            j -= 1
        if low <= j < high and direction * (times[j] + delay - best) < 0.0:
            best, index = times[j] + delay, j
    return best, index


@inner
def input_tangent(t, k, c):
    """Write the tangent of the inputs along direction k into u_dot."""
    u_dot, width = floats(c[U_DOT]), c[N_U]
    if c[DELAYED]:
        rate, weight = floats(c[RATE]), shift(floats(c[WEIGHT]), k * width)
        for column in range(width):
            u_dot[column] = weight[column] * rate[column]
    else:
        for column in range(width):
            u_dot[column] = 0.0
    channel = ints(c[CHANNEL])[k]
    if channel >= 0:
        times, shape, m, end = floats(c[SHAPE_T]), floats(c[SHAPE]), c[M], c[SHAPE_ROWS] - 1
        if t <= times[0]:
            u_dot[channel] += shape[k]
        elif t >= times[end]:
            u_dot[channel] += shape[end * m + k]
        else:
            cursor = ints(c[SHAPE_CURSOR])
            i = locate(times, end + 1, t, cursor[0])
            cursor[0] = i
            z = (t - times[i]) / (times[i + 1] - times[i])
            u_dot[channel] += (1.0 - z) * shape[i * m + k] + z * shape[(i + 1) * m + k]


@inner
def all_faded(y, first, last, c):
    """Tell whether some directions only began, and are zero by now."""
    channel, n = ints(c[CHANNEL]), c[N]
    for k in range(first, last):
        if channel[k] != FADING:
            return False
    i, end = n * (first + 1), n * (last + 1)
    while i < end and y[i] == 0.0:
        i += 1
    return i == end


@inner
def tangents_together(t, y, dy, first, last, c):
    """Write the derivatives of a group of directions, which go through the equations side by side."""
    n, width, lanes, count = c[N], c[N_U], c[LANES], last - first
    x_wide = floats(c[ROOM])
    out, u_wide = shift(x_wide, n * lanes), shift(x_wide, 2 * n * lanes)
    columns, rates = shift(y, n * (first + 1)), shift(dy, n * (first + 1))
    for i in range(n):
        for lane in independent(count):
            x_wide[i * lanes + lane] = columns[n * lane + i]
    if c[PUSHED] != 0:
        u_dot = floats(c[U_DOT])
        for lane in range(count):
            input_tangent(t, first + lane, c)
            for j in range(width):
                u_wide[j * lanes + lane] = u_dot[j]
    p_wide = shift(floats(c[P_WIDE]), first * c[N_P])
    call_tangent(c[WIDE], t, y, floats(c[U]), floats(c[P]), x_wide, u_wide, p_wide, out)
    for i in range(n):
        for lane in independent(count):
            rates[n * lane + i] = out[i * lanes + lane]


@inner
def tangents(t, y, dy, c):
    """Write the derivative of every direction's column of y into dy; u must be that of time t."""
    if c[DELAYED]:
        look_up_rates(t, c)
    n, m, group, u, p = c[N], c[M], max(c[LANES], 1), floats(c[U]), floats(c[P])
    for g in range((m + group - 1) // group):
        first, last = g * group, min((g + 1) * group, m)
        if all_faded(y, first, last, c):
            for i in range(n * (first + 1), n * (last + 1)):
                dy[i] = 0.0
        elif c[WIDE] != 0:
            tangents_together(t, y, dy, first, last, c)
        else:
            input_tangent(t, first, c)
            a, p_dot = n * (first + 1), shift(floats(c[P_DOT]), first * c[N_P])
            call_tangent(c[TANGENT], t, y, u, p, shift(y, a), floats(c[U_DOT]), p_dot, shift(dy, a))


@inner
def evaluate_state(t, y, dy, c):
    """Write the rates of the state alone."""
    if c[N_MOVING] > 0:
        look_up(t, c)
    call_rhs(c[RHS], t, y, floats(c[U]), floats(c[P]), dy)


@inner
def evaluate(t, y, dy, c):
    """Write the derivative of y at time t into dy; held inputs stay as they are."""
    evaluate_state(t, y, dy, c)
    if c[M] > 0:
        tangents(t, y, dy, c)


@entry
def evaluate_at(time, y, dy, numbers):
    """Evaluate once at time[0], from Python; at a jump the value after it counts."""
    c = pointer(numbers)
    hold_at(time[0], c)
    evaluate(time[0], pointer(y), pointer(dy), c)


@entry
def inputs_along(times, out, out_rate, numbers):
    """Write the inputs, and the rates of the delayed ones, at many times."""
    c = pointer(numbers)
    u, rate = floats(c[U]), floats(c[RATE])
    for i in range(times.size):
        hold_at(times[i], c)
        look_up(times[i], c)
        look_up_rates(times[i], c)
        for column in range(out.shape[1]):
            out[i, column] = u[column]
            out_rate[i, column] = rate[column]
