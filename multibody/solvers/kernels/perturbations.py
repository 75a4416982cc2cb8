"""Many small perturbations of inputs, propagated through a machine that is linear around its trajectory."""

from __future__ import annotations

from multibody.compile.calls import entry, fused, independent, pointer, shift
from multibody.solvers.kernels.stepping import TINY


@fused
def add_products(count, factors, size, rows, total):
    """Add the sum of some rows times their factors, four at a time: the total is then read and written less often."""
    first = 0
    while first + 4 <= count:
        f0, f1, f2, f3 = factors[first], factors[first + 1], factors[first + 2], factors[first + 3]
        a0, a1 = shift(rows, first * size), shift(rows, (first + 1) * size)
        a2, a3 = shift(rows, (first + 2) * size), shift(rows, (first + 3) * size)
        for j in independent(size):
            total[j] += f0 * a0[j] + f1 * a1[j] + f2 * a2[j] + f3 * a3[j]
        first += 4
    while first < count:
        f, a = factors[first], shift(rows, first * size)
        for j in independent(size):
            total[j] += f * a[j]
        first += 1


@fused
def step(n, channels, m, phi, gamma0, gamma1, channel, before, after, now, then):
    """Carry the deviations now (n, m) over one interval into then; additions to the inputs before and after it."""
    for i in range(n):
        row, g0, g1 = shift(then, i * m), shift(gamma0, i * channels), shift(gamma1, i * channels)
        for j in range(m):
            row[j] = g0[channel[j]] * before[j] + g1[channel[j]] * after[j]
        add_products(n, shift(phi, i * n), m, now, row)


@fused
def observe(n, rows, channels, m, c, d, channel, samples, now, out):
    """Write the change of the outputs, out (rows, m), from the deviations and the additions at one sample."""
    for i in range(rows):
        row, direct = shift(out, i * m), shift(d, i * channels)
        for j in range(m):
            row[j] = direct[channel[j]] * samples[j]
        add_products(n, shift(c, i * n), m, now, row)


@entry
def propagate(phi, gamma0, gamma1, c, d, channel, values, room, out):
    """Write the change of the outputs, out (nt, n_y, m), by ``values`` (nt, m) added to the inputs ``channel`` (m,).

    δ_{k+1} = phi δ_k + gamma0 φ_k + gamma1 φ_{k+1}, y = c δ + d φ; δ begins at zero.  ``room``, shape (2, n, m), is for
    δ at the two ends of an interval.
    """
    rows, n, channels, m = c.shape[1], c.shape[2], d.shape[2], values.shape[1]
    of, samples = pointer(channel), pointer(values)
    now, then = pointer(room), shift(pointer(room), n * m)
    for j in range(n * m):
        now[j] = 0.0
    for k in range(values.shape[0]):
        if k > 0:
            at = (k - 1) * n * channels
            step(
                n, channels, m, shift(pointer(phi), (k - 1) * n * n), shift(pointer(gamma0), at),
                shift(pointer(gamma1), at), of, shift(samples, (k - 1) * m), shift(samples, k * m), now, then,
            )  # fmt: skip
            for j in independent(n * m):
                now[j] = then[j] if abs(then[j]) >= TINY else 0.0
        observe(
            n, rows, channels, m, shift(pointer(c), k * rows * n), shift(pointer(d), k * rows * channels), of,
            shift(samples, k * m), now, shift(pointer(out), k * rows * m),
        )  # fmt: skip
