"""State-transition matrices of linear equations whose coefficients change in time, over many short intervals.

δ' = A(t) δ + B(t) φ(t) with A and B that are parabolas of the time in each piece of an interval.  A step is two
exponentials (order 4; Blanes and Moan 2006, Applied Numerical Mathematics 56, 1519-1537), of each of which the Taylor
series is applied to all columns at once.  Of A only the entries that are not zero are multiplied.
"""

from __future__ import annotations

from multibody.compile.calls import entry, fused, independent, inner, pointer, shift

ROOT = 0.7745966692414834  # sqrt(3/5): the nodes of a piece are at 0 and ± that, from its middle in half lengths
FIRST, SECOND = 0.5 - 0.28867513459481287, 0.5 + 0.28867513459481287  # (1 ∓ 1/sqrt(3)) / 2: those of a step
MORE, LESS = 0.5 + 0.5773502691896257, 0.5 - 0.5773502691896257  # their weights in the exponential of each half
WIDTH = 32  # columns that are carried at a time: those of 37 states then stay where the processor reads fastest


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
def product(n, begin, columns, factor, a, y, out):
    """Write a factor times the sparse matrix a times y (n, WIDTH) into out; each row of a has fours of entries."""
    for i in range(n):
        row, e = shift(out, i * WIDTH), begin[i]
        a0, a1, a2, a3 = factor * a[e], factor * a[e + 1], factor * a[e + 2], factor * a[e + 3]
        y0, y1 = shift(y, columns[e] * WIDTH), shift(y, columns[e + 1] * WIDTH)
        y2, y3 = shift(y, columns[e + 2] * WIDTH), shift(y, columns[e + 3] * WIDTH)
        for j in independent(WIDTH):
            row[j] = a0 * y0[j] + a1 * y1[j] + a2 * y2[j] + a3 * y3[j]
        for e in range(begin[i] + 4, begin[i + 1], 4):
            b0, b1, b2, b3 = factor * a[e], factor * a[e + 1], factor * a[e + 2], factor * a[e + 3]
            z0, z1 = shift(y, columns[e] * WIDTH), shift(y, columns[e + 1] * WIDTH)
            z2, z3 = shift(y, columns[e + 2] * WIDTH), shift(y, columns[e + 3] * WIDTH)
            for j in independent(WIDTH):
                row[j] = row[j] + b0 * z0[j] + b1 * z1[j] + b2 * z2[j] + b3 * z3[j]


@inner
def add_input(count, row_of, column_of, b, share, first, out):
    """Add a share of B to the columns from ``first`` on, of which those from 0 to WIDTH are there."""
    for e in range(count):
        j = first + column_of[e]
        if 0 <= j < WIDTH:
            out[row_of[e] * WIDTH + j] += b[e] * share


@inner
def add(size, term, y):
    """Add a term of the series."""
    for j in independent(size):
        y[j] = y[j] + term[j]


@inner
def exponential(
    n, first, terms, tau, at, slope, begin, columns, a, count, row_of, column_of, risen_of, b, y, now, then
):
    """Carry columns y, the whole's from ``first`` on, over the time tau in which A and B stand still.

    The share of the additions that belongs to their end, ``risen_of``, grows from ``at`` by slope.
    """
    product(n, begin, columns, tau, a, y, now)
    add_input(count, row_of, column_of, b, tau * (1.0 - at), n - first, now)
    add_input(count, row_of, risen_of, b, tau * at, n - first, now)
    add(n * WIDTH, now, y)
    for k in range(2, terms + 1):
        product(n, begin, columns, tau / k, a, now, then)
        if k == 2:
            share = 0.5 * tau * slope * tau
            add_input(count, row_of, column_of, b, -share, n - first, then)
            add_input(count, row_of, risen_of, b, share, n - first, then)
        add(n * WIDTH, then, y)
        now, then = then, now


@inner
def weights_of_half(half, s, steps):
    """Return the weights of the nodes in the exponential of one half of a step."""
    p0, p1, p2 = weights(2.0 * (s + FIRST) / steps - 1.0)
    q0, q1, q2 = weights(2.0 * (s + SECOND) / steps - 1.0)
    u, v = MORE, LESS
    if half == 1:
        u, v = LESS, MORE
    return u * p0 + v * q0, u * p1 + v * q1, u * p2 + v * q2


@entry
def integrate_intervals(
    nodes_a, nodes_b, begin, columns, where, row_of, column_of, risen_of, where_b, first, spans, counts, which, room,
    phi, gamma0, gamma1,
):  # fmt: skip
    """Write phi, gamma0 and gamma1 of the intervals ``which``.

    ``nodes_a`` (3 P, n n) and ``nodes_b`` (3 P, n m) are A and B at the nodes of P pieces; ``columns`` and ``where``
    (e,) the entries of A, those of row i from ``begin[i]`` on; ``row_of``, ``column_of`` and ``where_b`` (f,) those of
    B; what an addition is at its interval's begin goes into column ``column_of`` behind phi's, what it is at the end
    into ``risen_of``, which is the same where it lasts.  The pieces of interval which[k] begin with ``first[k]``;
    ``spans`` (P, 3) are the length of each and which share of its interval is over at its begin and at its end;
    ``counts`` (P, 2) its steps and the terms of each series.
    ``room``, shape (3 n WIDTH + e + f,), is for as many columns at a time.
    """
    n, m, e, f = phi.shape[1], gamma0.shape[2], where.size, where_b.size
    total = n + m
    for k in range(f):
        total = max(total, n + 1 + risen_of[k])
    y = pointer(room)
    now = shift(y, n * WIDTH)
    then = shift(now, n * WIDTH)
    a = shift(then, n * WIDTH)
    b = shift(a, e)
    for k in range(which.size):
        for block in range(0, total, WIDTH):
            for i in range(n * WIDTH):
                y[i] = 0.0
            for i in range(block, min(n, block + WIDTH)):
                y[i * WIDTH + i - block] = 1.0
            for p in range(first[k], first[k + 1]):
                steps, risen = counts[p, 0], spans[p, 2] - spans[p, 1]
                of_a, of_b = shift(pointer(nodes_a), 3 * p * n * n), shift(pointer(nodes_b), 3 * p * n * m)
                for h in range(2 * steps):
                    w0, w1, w2 = weights_of_half(h % 2, h // 2, steps)
                    blend(e, pointer(where), of_a, n * n, w0, w1, w2, a)
                    blend(f, pointer(where_b), of_b, n * m, w0, w1, w2, b)
                    tau, slope = 0.5 * spans[p, 0] / steps, risen / spans[p, 0]
                    at = spans[p, 1] + 0.5 * risen * h / steps
                    exponential(
                        n, block, counts[p, 1], tau, at, slope, pointer(begin), pointer(columns), a,
                        f, pointer(row_of), pointer(column_of), pointer(risen_of), b, y, now, then,
                    )  # fmt: skip
            c = which[k]
            for i in range(n):
                row = shift(y, i * WIDTH - block)
                for j in range(block, min(block + WIDTH, n)):
                    phi[c, i, j] = row[j]
                for j in range(m):
                    if n + j >= block and n + j < block + WIDTH:
                        gamma0[c, i, j] = row[n + j]
                    if n + m + j >= block and n + m + j < block + WIDTH:
                        gamma1[c, i, j] = row[n + m + j]
