"""Linear equations with coefficients that change in time, carried over many short intervals, for discrete transitions.

δ' = A(t) δ + B(t) φ(t) with A and B that are parabolas of the time in each piece of an interval.  A step is two
exponentials (order 4; Blanes and Moan 2006, Applied Numerical Mathematics 56, 1519-1537), of each of which the Taylor
series is applied to all columns at once.  Of A only the entries that are not zero are multiplied.
"""

from __future__ import annotations

from multibody.solvers.kernels.calls import entry, fused, independent, inner, pointer, shift

ROOT = 0.7745966692414834  # sqrt(3/5): the nodes of a piece are at 0 and ± that, from its middle in half lengths
FIRST, SECOND = 0.5 - 0.28867513459481287, 0.5 + 0.28867513459481287  # (1 ∓ 1/sqrt(3)) / 2: those of a step
MORE, LESS = 0.5 + 0.5773502691896257, 0.5 - 0.5773502691896257  # their weights in the exponential of each half


@inner
def weights(x):
    """Return what a parabola takes from each node of its piece, at x half lengths from the middle."""
    z = x / ROOT
    return 0.5 * z * (z - 1.0), (1.0 - z) * (1.0 + z), 0.5 * z * (z + 1.0)


@fused
def blend(count, where, values, stride, w0, w1, w2, out):
    """Write the weighted sum of some entries of three matrices that follow each other into out; -1 is no entry."""
    one, two = shift(values, stride), shift(values, 2 * stride)
    for e in range(count):
        k = where[e]
        out[e] = 0.0
        if k >= 0:
            out[e] = w0 * values[k] + w1 * one[k] + w2 * two[k]


@fused
def product(n, width, begin, columns, factor, a, y, out):
    """Write a factor times the sparse matrix a times y (n, width) into out; each row of a has fours of entries."""
    for i in range(n):
        row, e = shift(out, i * width), begin[i]
        a0, a1, a2, a3 = factor * a[e], factor * a[e + 1], factor * a[e + 2], factor * a[e + 3]
        y0, y1 = shift(y, columns[e] * width), shift(y, columns[e + 1] * width)
        y2, y3 = shift(y, columns[e + 2] * width), shift(y, columns[e + 3] * width)
        for j in independent(width):
            row[j] = a0 * y0[j] + a1 * y1[j] + a2 * y2[j] + a3 * y3[j]
        for e in range(begin[i] + 4, begin[i + 1], 4):
            b0, b1, b2, b3 = factor * a[e], factor * a[e + 1], factor * a[e + 2], factor * a[e + 3]
            z0, z1 = shift(y, columns[e] * width), shift(y, columns[e + 1] * width)
            z2, z3 = shift(y, columns[e + 2] * width), shift(y, columns[e + 3] * width)
            for j in independent(width):
                row[j] = row[j] + b0 * z0[j] + b1 * z1[j] + b2 * z2[j] + b3 * z3[j]


@fused
def push(count, row_of, column_of, b, held, rising, n, m, width, out):
    """Add B's share: ``held`` of the ramps that fall and ``rising`` of those that rise."""
    for e in range(count):
        k = row_of[e] * width + n + column_of[e]
        out[k] += b[e] * held
        out[k + m] += b[e] * rising


@inner
def add(size, term, y):
    """Add a term of the series."""
    for j in independent(size):
        y[j] = y[j] + term[j]


@inner
def exponential(n, m, width, terms, tau, at, slope, begin, columns, a, count, row_of, column_of, b, y, now, then):
    """Carry y over the time tau: A and B stand still, the risen share of the additions grows from ``at`` by slope."""
    product(n, width, begin, columns, tau, a, y, now)
    push(count, row_of, column_of, b, tau * (1.0 - at), tau * at, n, m, width, now)
    add(n * width, now, y)
    for k in range(2, terms + 1):
        product(n, width, begin, columns, tau / k, a, now, then)
        if k == 2:
            share = 0.5 * tau * slope * tau
            push(count, row_of, column_of, b, -share, share, n, m, width, then)
        add(n * width, then, y)
        now, then = then, now


@entry
def carry_intervals(
    nodes_a, nodes_b, begin, columns, where, row_of, column_of, where_b, first, spans, counts, which, room,
    phi, gamma0, gamma1,
):  # fmt: skip
    """Write phi, gamma0 and gamma1 of the intervals ``which``.

    ``nodes_a`` (3 P, n n) and ``nodes_b`` (3 P, n m) are A and B at the nodes of P pieces; ``columns`` and ``where`` (e,)
    the entries of A, those of row i from ``begin[i]`` on; ``row_of``, ``column_of`` and ``where_b`` (f,) those of B; the
    pieces of interval which[k] begin with ``first[k]``; ``spans`` (P, 3) are the length of each and which share of its
    interval is over at its begin and at its end; ``counts`` (P, 2) its steps and the terms of each series.
    ``room``, shape (3 n width + e + f,), is for columns of which there are n + 2 m or, to fill registers, more.
    """
    n, m, f = phi.shape[1], gamma0.shape[2], where_b.size
    e = where.size
    width = (room.size - e - f) // (3 * n)
    y = pointer(room)
    now = shift(y, n * width)
    then = shift(now, n * width)
    a = shift(then, n * width)
    b = shift(a, e)
    for k in range(which.size):
        for i in range(3 * n * width):
            y[i] = 0.0
        for i in range(n):
            y[i * width + i] = 1.0
        for p in range(first[k], first[k + 1]):
            steps, terms = counts[p, 0], counts[p, 1]
            tau, risen = 0.5 * spans[p, 0] / steps, spans[p, 2] - spans[p, 1]
            of_a, of_b = shift(pointer(nodes_a), 3 * p * n * n), shift(pointer(nodes_b), 3 * p * n * m)
            for s in range(steps):
                p0, p1, p2 = weights(2.0 * (s + FIRST) / steps - 1.0)
                q0, q1, q2 = weights(2.0 * (s + SECOND) / steps - 1.0)
                for half in range(2):
                    u, v = MORE, LESS
                    if half == 1:
                        u, v = LESS, MORE
                    w0, w1, w2 = u * p0 + v * q0, u * p1 + v * q1, u * p2 + v * q2
                    blend(e, pointer(where), of_a, n * n, w0, w1, w2, a)
                    blend(f, pointer(where_b), of_b, n * m, w0, w1, w2, b)
                    at, slope = spans[p, 1] + risen * (s + 0.5 * half) / steps, risen / spans[p, 0]
                    exponential(
                        n, m, width, terms, tau, at, slope, pointer(begin), pointer(columns), a,
                        f, pointer(row_of), pointer(column_of), b, y, now, then,
                    )  # fmt: skip
        c = which[k]
        for i in range(n):
            for j in range(n):
                phi[c, i, j] = y[i * width + j]
            for j in range(m):
                gamma0[c, i, j] = y[i * width + n + j]
                gamma1[c, i, j] = y[i * width + n + m + j]
