"""The extended Kalman filter as one compiled loop."""

from __future__ import annotations

import math

from estimation.filters.kernels.algebra import (
    balance,
    clear,
    copy,
    exponential,
    joseph,
    lower_product,
    mirror,
    potter,
    product,
    project,
    project_root,
    square,
    transpose,
    triangle,
)
from estimation.filters.kernels.equations import (
    count_substeps,
    has_rates,
    inputs_between,
    jacobian,
    propagate,
    rates,
    read,
    reading_rows,
)
from estimation.filters.kernels.layout import (
    ALL,
    BALANCE,
    COVARIANCES,
    EVERYTHING,
    EXPONENTIAL,
    HIGH,
    INTEGRATED,
    LD,
    LOW,
    N_U,
    N_Y,
    TIMES_STEP,
    VARIATIONAL,
    M,
)
from multibody.compile.calls import entry, floats, independent, inner, pointer, shift

# Settings by index: discretisation, kind of process noise, what is kept, square root, one linearisation a step, held
# inputs, substeps, samples that an earlier call has filtered: the last of them is then the first row here.
DISCRETISATION, NOISE, KEEP, ROOT, ONCE, HOLD, SUBSTEPS, TAKEN = range(8)
#: FilterSamples after which the sizes that balance the Jacobian are updated.
REBALANCE = 64


@inner
def variational(c, t, h, z, before, after, hold, substeps, u, f, jac, work):
    """Write the derivative of the propagated state by the state at the beginning into f; work holds four matrices.

    Runge and Kutta's method of order 4 on the state and its variational equation together.
    """
    n, ld = c[ALL], c[LD]
    size = n * ld
    total, slope, at, stage = work, shift(work, size), shift(work, 2 * size), shift(work, 3 * size)
    k, x, begun = shift(stage, 0), shift(stage, n), shift(stage, 2 * n)
    clear(f, size)
    for i in range(n):
        f[i * ld + i] = 1.0
        begun[i] = z[i]
    part = h / substeps
    for s in range(substeps):
        for i in range(n):
            x[i] = begun[i]
        copy(f, at, size)
        copy(f, total, size)
        for q in range(4):
            share = 0.0 if q == 0 else (1.0 if q == 3 else 0.5)
            inputs_between(c, before, after, hold, (s + share) / substeps, u)
            jacobian(c, t + (s + share) * part, x, u, jac)
            rates(c, t + (s + share) * part, x, u, k)
            product(jac, at, slope, n, ld)
            weight = part / 6.0 if q == 0 or q == 3 else part / 3.0
            ahead = 0.5 * part if q < 2 else part
            for i in range(size):
                total[i] += weight * slope[i]
                at[i] = f[i] + ahead * slope[i]
            for i in range(n):
                z[i] += weight * k[i]
                x[i] = begun[i] + ahead * k[i]
        copy(total, f, size)
        for i in range(n):
            begun[i] = z[i]


@inner
def propagate_covariance(f, p, q, half, work, n, ld):
    """Replace p by f (p + half q) fᵀ + half q, or with half = 0 by f p fᵀ + q; work holds two matrices."""
    size = n * ld
    first, turned = work, shift(work, size)
    if half > 0.0:
        for i in independent(size):
            p[i] += half * q[i]
    product(f, p, first, n, ld)
    transpose(f, turned, n, ld)
    lower_product(first, turned, p, n, ld)
    share = half if half > 0.0 else 1.0
    for i in independent(size):
        p[i] += share * q[i]
    mirror(p, n, ld)


@inner
def propagate_root(f, root, q_root, weight, integrated, tall, work, n, ld):
    """Replace the square root of the covariance as `propagate_covariance` does; tall holds 3 n rows."""
    product(f, root, work, n, ld)
    transpose(work, tall, n, ld)
    rows = 2 * n
    for i in range(n):
        for j in range(n):
            tall[(n + j) * ld + i] = weight * q_root[i * ld + j]
    if integrated:
        product(f, q_root, work, n, ld)
        for i in range(n):
            for j in range(n):
                tall[(2 * n + j) * ld + i] = weight * work[i * ld + j]
        rows = 3 * n
    triangle(tall, rows, n, root, ld)


@inner
def inner_product(a, b, n):
    """Return the sum of the products of two rows."""
    total = 0.0
    for i in range(n):
        total += a[i] * b[i]
    return total


@entry
def extended(
    numbers,
    times,
    inputs,
    values,
    noise,
    q,
    q_root,
    x,
    p,
    settings,
    gate,
    out,
    covariances,
    predicted,
    carried,
    rows_kept,
    innovations,
    space,
    verdict,
):
    """Filter all samples; verdict (3,) takes the log likelihood, readings refused, and the row not finite or −1.

    x (n,), p (n, ld) and their roots are prior and end; out (samples, 3 n) takes states before and after the
    reading and the variances after it; innovations (samples, 3 m) takes the innovations, their variances, and
    the innovations of the readings processed in turn over their standard deviations.  A call that continues an earlier
    one takes the state of its end, with the same space and arrays of the model, and leaves the first row of its
    results as it is.
    """
    c = pointer(numbers)
    n, m, ld, width = c[ALL], c[M], c[LD], c[N_U]
    size = n * ld
    discretisation, kind, keep = settings[DISCRETISATION], settings[NOISE], settings[KEEP]
    root_form, once, hold = settings[ROOT] == 1, settings[ONCE] == 1, settings[HOLD] == 1
    substeps, taken = settings[SUBSTEPS], settings[TAKEN]
    first = 1 if taken > 0 else 0
    earlier = taken - first
    work = pointer(space)
    f, jac, tall = shift(work, 4 * size), shift(work, 5 * size), shift(work, 8 * size)
    full = shift(work, 6 * size)
    rows = shift(tall, max(3 * size, c[N_Y] * ld))
    dz = shift(rows, m * ld)
    gain, w, k, column, moved = shift(dz, n), shift(dz, 2 * n), shift(dz, 3 * n), shift(dz, 7 * n), shift(dz, 8 * n)
    u = shift(dz, 9 * n)
    y = shift(u, 3 * width)
    z, cov, qq, q_r = pointer(x), pointer(p), pointer(q), pointer(q_root)
    table, given = pointer(inputs), pointer(values)
    r = pointer(noise)
    keep_p, keep_pred, keep_f, keep_h = pointer(covariances), pointer(predicted), pointer(carried), pointer(rows_kept)
    result, innovation = pointer(out), pointer(innovations)
    sizes, lowest, highest = floats(c[BALANCE]), floats(c[LOW]), floats(c[HIGH])
    rated = has_rates(c)
    likelihood, refused = 0.0, 0
    verdict[2] = -1.0
    for s in range(first, times.size):
        t = times[s]
        row = shift(table, s * width)
        if s > 0:
            h = t - times[s - 1]
            before = shift(table, (s - 1) * width)
            steps = count_substeps(c, times[s - 1], h, z, before, substeps)
            if discretisation != VARIATIONAL:
                if not once:
                    jacobian(c, times[s - 1], z, before, jac)
                if discretisation == EXPONENTIAL:
                    if (s + earlier) % REBALANCE == 1:
                        balance(jac, sizes, n, ld)
                    exponential(jac, h, sizes, f, work, n, ld)
                else:
                    for i in range(size):
                        f[i] = h * jac[i]
                    for i in range(n):
                        f[i * ld + i] += 1.0
                propagate(c, times[s - 1], h, z, before, row, hold, steps, u, k, column)
            else:
                variational(c, times[s - 1], h, z, before, row, hold, steps, u, f, jac, work)
            if root_form:
                weight = 1.0
                if kind == INTEGRATED:
                    weight = math.sqrt(0.5 * h)
                elif kind == TIMES_STEP:
                    weight = math.sqrt(h)
                propagate_root(f, cov, q_r, weight, kind == INTEGRATED, tall, work, n, ld)
            elif kind == INTEGRATED:
                propagate_covariance(f, cov, qq, 0.5 * h, work, n, ld)
            else:
                share = h if kind == TIMES_STEP else 1.0
                for i in range(size):
                    full[i] = share * qq[i]
                propagate_covariance(f, cov, full, 0.0, work, n, ld)
        for i in range(n):
            result[s * 3 * n + i] = z[i]
        if keep == EVERYTHING:
            if root_form:
                square(cov, full, n, ld)
            for i in range(n):
                for j in range(n):
                    keep_pred[(s * n + i) * n + j] = full[i * ld + j] if root_form else cov[i * ld + j]
                    keep_f[(s * n + i) * n + j] = f[i * ld + j] if s > 0 else 0.0
        seen = False
        for j in range(m):
            seen = seen or not math.isnan(given[s * m + j])
        if once or (seen and rated):
            jacobian(c, t, z, row, jac)
        if seen:
            if rated:
                rates(c, t, z, row, dz)
            read(c, t, z, row, dz, y)
            reading_rows(c, t, z, row, jac, rows, tall)
            clear(moved, n)
        for j in range(m):
            at = s * 3 * m + j
            innovation[at] = math.nan
            innovation[at + m] = math.nan
            innovation[at + 2 * m] = math.nan
            if not seen or math.isnan(given[s * m + j]):
                continue
            one = shift(rows, j * ld)
            innovation[at] = given[s * m + j] - y[j]
            innovation[at + m] = (
                project_root(cov, one, r[j], w, n, ld) if root_form else project(cov, one, r[j], w, n, ld)
            )
        for j in range(m):
            at = s * 3 * m + j
            if math.isnan(innovation[at]):
                continue
            one = shift(rows, j * ld)
            rest = innovation[at] - inner_product(one, moved, n)
            v = project_root(cov, one, r[j], w, n, ld) if root_form else project(cov, one, r[j], w, n, ld)
            if gate > 0.0 and rest * rest > gate * gate * v:
                refused += 1
                continue
            if root_form:
                potter(cov, w, v, r[j], gain, n, ld)
            else:
                joseph(cov, w, v, gain, n, ld)
            if v > 0.0:
                innovation[at + 2 * m] = rest / math.sqrt(v)
                likelihood -= 0.5 * (math.log(2.0 * math.pi * v) + rest * rest / v)
            for i in range(n):
                moved[i] += gain[i] * rest
        good = True
        if root_form:
            square(cov, full, n, ld)
        for i in range(n):
            if seen:
                z[i] += moved[i]
                z[i] = min(max(z[i], lowest[i]), highest[i])
            variance = full[i * ld + i] if root_form else cov[i * ld + i]
            result[(s * 3 + 1) * n + i] = z[i]
            result[(s * 3 + 2) * n + i] = variance
            good = good and math.isfinite(z[i]) and math.isfinite(variance)
        if keep >= COVARIANCES:
            for i in range(n):
                for j in range(n):
                    keep_p[(s * n + i) * n + j] = full[i * ld + j] if root_form else cov[i * ld + j]
        if keep == EVERYTHING:
            for j in range(m):
                for i in range(n):
                    keep_h[(s * m + j) * n + i] = rows[j * ld + i] if seen else 0.0
        if not good:
            verdict[2] = s
            break
    verdict[0], verdict[1] = likelihood, refused
