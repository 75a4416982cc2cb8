"""The unscented Kalman filter as one compiled loop."""

from __future__ import annotations

import math

from estimation.filters.kernels.algebra import cholesky, clear, symmetrise
from estimation.filters.kernels.equations import count_substeps, has_rates, propagate, rates, read
from estimation.filters.kernels.layout import ALL, COVARIANCES, HIGH, INTEGRATED, LD, LOW, N_U, PER_STEP, M
from multibody.compile.calls import entry, floats, inner, pointer, shift

# Settings by index.
NOISE, KEEP, HOLD, SUBSTEPS = range(4)


@inner
def spread_points(x, root, reach, points, n, ld):
    """Write 2 n + 1 points about x, along the columns of a root of its covariance."""
    for i in range(n):
        points[i] = x[i]
    for j in range(n):
        up, down = shift(points, (1 + 2 * j) * n), shift(points, (2 + 2 * j) * n)
        for i in range(n):
            away = reach * root[i * ld + j]
            up[i] = x[i] + away
            down[i] = x[i] - away


@inner
def mean_of(points, width, count, first, rest, out):
    """Write the weighted mean of the points."""
    for i in range(width):
        out[i] = first * points[i]
    for q in range(1, count):
        for i in range(width):
            out[i] += rest * points[q * width + i]


@entry
def unscented(
    numbers,
    times,
    inputs,
    values,
    noise,
    q,
    x,
    p,
    settings,
    reach,
    weights,
    out,
    covariances,
    innovations,
    space,
    verdict,
):
    """Filter all samples; arrays as in `extended`; verdict (2,) takes log likelihood and the row that failed or −1."""
    c = pointer(numbers)
    n, m, ld, width = c[ALL], c[M], c[LD], c[N_U]
    count = 2 * n + 1
    kind, keep, hold, substeps = settings[NOISE], settings[KEEP], settings[HOLD] == 1, settings[SUBSTEPS]
    first_mean, first_spread, rest = weights[0], weights[1], weights[2]
    work = pointer(space)
    root = work
    points = shift(root, n * ld)
    readings = shift(points, count * n)
    dz = shift(readings, count * m)
    k, column = shift(dz, n), shift(dz, 5 * n)
    u = shift(dz, 6 * n)
    y = shift(u, 3 * width)
    pyy = shift(y, m)
    pxy = shift(pyy, m * m)
    gain = shift(pxy, n * m)
    z, cov, qq = pointer(x), pointer(p), pointer(q)
    table, given, r = pointer(inputs), pointer(values), pointer(noise)
    keep_p, result, innovation = pointer(covariances), pointer(out), pointer(innovations)
    lowest, highest = floats(c[LOW]), floats(c[HIGH])
    rated = has_rates(c)
    likelihood = 0.0
    verdict[1] = -1.0
    good = True
    for s in range(times.size):
        t = times[s]
        row = shift(table, s * width)
        if s > 0:
            h = t - times[s - 1]
            before = shift(table, (s - 1) * width)
            if kind == INTEGRATED:
                for i in range(n * ld):
                    cov[i] += 0.5 * h * qq[i]
            good = good and cholesky(cov, root, n, ld)
            spread_points(z, root, reach, points, n, ld)
            steps = count_substeps(c, times[s - 1], h, z, before, substeps)
            for j in range(count):
                propagate(c, times[s - 1], h, shift(points, j * n), before, row, hold, steps, u, k, column)
            mean_of(points, n, count, first_mean, rest, z)
            clear(cov, n * ld)
            for j in range(count):
                weight = first_spread if j == 0 else rest
                for i in range(n):
                    away = weight * (points[j * n + i] - z[i])
                    for a in range(n):
                        cov[i * ld + a] += away * (points[j * n + a] - z[a])
            share = 0.5 * h if kind == INTEGRATED else (1.0 if kind == PER_STEP else h)
            for i in range(n * ld):
                cov[i] += share * qq[i]
            symmetrise(cov, n, ld)
        for i in range(n):
            result[s * 3 * n + i] = z[i]
        seen = False
        for j in range(m):
            seen = seen or not math.isnan(given[s * m + j])
        for j in range(3 * m):
            innovation[s * 3 * m + j] = math.nan
        if seen:
            good = good and cholesky(cov, root, n, ld)
            spread_points(z, root, reach, points, n, ld)
            for j in range(count):
                point = shift(points, j * n)
                if rated:
                    rates(c, t, point, row, dz)
                read(c, t, point, row, dz, shift(readings, j * m))
            mean_of(readings, m, count, first_mean, rest, y)
            clear(pyy, m * m)
            clear(pxy, n * m)
            for j in range(count):
                weight = first_spread if j == 0 else rest
                for a in range(m):
                    away = weight * (readings[j * m + a] - y[a])
                    for b in range(m):
                        pyy[a * m + b] += away * (readings[j * m + b] - y[b])
                    for i in range(n):
                        pxy[a * n + i] += away * (points[j * n + i] - z[i])
            for a in range(m):
                innovation[(s * 3 + 0) * m + a] = given[s * m + a] - y[a]
                innovation[(s * 3 + 1) * m + a] = pyy[a * m + a] + r[a]
            for a in range(m):
                if math.isnan(given[s * m + a]):
                    innovation[(s * 3 + 1) * m + a] = math.nan
                    continue
                v = pyy[a * m + a] + r[a]
                away = given[s * m + a] - y[a]
                innovation[(s * 3 + 2) * m + a] = away / math.sqrt(v)
                likelihood -= 0.5 * (math.log(2.0 * math.pi * v) + away * away / v)
                for i in range(n):
                    gain[i] = pxy[a * n + i] / v
                for i in range(n):
                    z[i] += gain[i] * away
                    for b in range(n):
                        cov[i * ld + b] -= gain[i] * pxy[a * n + b]
                for b in range(a + 1, m):
                    y[b] += pyy[b * m + a] / v * away
                    for i in range(n):
                        pxy[b * n + i] -= gain[i] * pyy[a * m + b]
                for b in range(a + 1, m):
                    for d in range(a + 1, m):
                        pyy[b * m + d] -= pyy[b * m + a] * pyy[a * m + d] / v
            symmetrise(cov, n, ld)
            for i in range(n):
                z[i] = min(max(z[i], lowest[i]), highest[i])
        for i in range(n):
            result[(s * 3 + 1) * n + i] = z[i]
            result[(s * 3 + 2) * n + i] = cov[i * ld + i]
            good = good and math.isfinite(z[i]) and math.isfinite(cov[i * ld + i])
        if keep >= COVARIANCES:
            for i in range(n):
                for j in range(n):
                    keep_p[(s * n + i) * n + j] = cov[i * ld + j]
        if not good:
            verdict[1] = s
            break
    verdict[0] = likelihood
