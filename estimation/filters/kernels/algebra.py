"""Small dense linear algebra over bare pointers: products, exponential, triangles, Joseph's update.

Matrices are stored row by row with rows of ``ld`` elements, of which the first n count and the rest are zero:
``ld`` is a multiple of eight, so that the inner loops become whole vector instructions.
"""

from __future__ import annotations

import math

from multibody.compile.calls import fused, independent, inner, shift

_ROOT = math.sqrt(177.0)
# Bader, Blanes and Casas (2019), "Computing the matrix exponential with an optimized Taylor polynomial
# approximation", Mathematics 7(12) 1174: the Taylor polynomial of degree 8 with three products.
X_3 = 2.0 / 3.0
X_1 = X_3 * (1.0 + _ROOT) / 88.0
X_2 = X_3 * (1.0 + _ROOT) / 352.0
X_4 = (-271.0 + 29.0 * _ROOT) / (315.0 * X_3)
X_5 = 11.0 * (-1.0 + _ROOT) / (1260.0 * X_3)
X_6 = 11.0 * (-9.0 + _ROOT) / (5040.0 * X_3)
X_7 = (89.0 - _ROOT) / (5040.0 * X_3 * X_3)
Y_2 = (857.0 - 58.0 * _ROOT) / 630.0
# The remainder of degree 9 is then below 2e-13.
NORM = 0.15
ROOT_2 = math.sqrt(2.0)


@inner
def clear(a, count):
    """Set elements to zero."""
    for i in range(count):
        a[i] = 0.0


@inner
def copy(a, b, count):
    """Write a into b."""
    for i in range(count):
        b[i] = a[i]


@fused
def product(a, b, out, n, ld):
    """Write a b into out."""
    for i in range(n):
        row_product(shift(a, i * ld), b, shift(out, i * ld), n, ld, ld)


@fused
def lower_product(a, b, out, n, ld):
    """Write the lower triangle of a b into out, and whatever comes with whole vectors above it."""
    for i in range(n):
        row_product(shift(a, i * ld), b, shift(out, i * ld), n, ld, (i // 4 + 1) * 4)


@fused
def row_product(row, b, out, n, ld, width):
    """Write the product of a row and the first columns of b into out, four rows of b at a time."""
    first = row[0]
    for j in independent(width):
        out[j] = first * b[j]
    k = 1
    while k + 3 < n:
        f_0, f_1, f_2, f_3 = row[k], row[k + 1], row[k + 2], row[k + 3]
        b_0, b_1, b_2, b_3 = shift(b, k * ld), shift(b, (k + 1) * ld), shift(b, (k + 2) * ld), shift(b, (k + 3) * ld)
        for j in independent(width):
            out[j] += f_0 * b_0[j] + f_1 * b_1[j] + f_2 * b_2[j] + f_3 * b_3[j]
        k += 4
    while k < n:
        one, b_0 = row[k], shift(b, k * ld)
        for j in independent(width):
            out[j] += one * b_0[j]
        k += 1


@inner
def balance(a, scale, n, ld):
    """Adapt sizes of the states, powers of two, until rows and columns of a are alike (Osborne 1960)."""
    for _ in range(4):
        for i in range(n):
            row, column = 0.0, 0.0
            for j in range(n):
                if j != i:
                    row += abs(a[i * ld + j]) * scale[j]
                    column += abs(a[j * ld + i]) / scale[j]
            row /= scale[i]
            column *= scale[i]
            factor = 1.0
            if row > 0.0 and column > 0.0:
                factor = math.sqrt(row / column)
            elif column > 0.0:
                factor = 1.0 / column
            elif row > 0.0:
                factor = row
            if not (factor > 0.0 and math.isfinite(factor)):
                factor = 1.0
            while factor > ROOT_2:
                factor *= 0.5
                scale[i] *= 2.0
            while factor < 1.0 / ROOT_2:
                factor *= 2.0
                scale[i] *= 0.5


@inner
def transpose(a, out, n, ld):
    """Write the transpose of a into out."""
    for i in range(n):
        for j in range(n):
            out[j * ld + i] = a[i * ld + j]


@inner
def symmetrise(a, n, ld):
    """Replace a by the mean of itself and its transpose."""
    for i in range(n):
        for j in range(i):
            mean = 0.5 * (a[i * ld + j] + a[j * ld + i])
            a[i * ld + j] = mean
            a[j * ld + i] = mean


@inner
def exponential(a, h, scale, out, work, n, ld):
    """Write exp(h a) into out; work holds four matrices; ``scale`` are sizes of the states that balance a."""
    size = n * ld
    x, x2, x4, mixed = work, shift(work, size), shift(work, 2 * size), shift(work, 3 * size)
    largest = 0.0
    for i in range(n):
        row = 0.0
        inverse = h / scale[i]
        for j in range(n):
            value = inverse * a[i * ld + j] * scale[j]
            x[i * ld + j] = value
            row += abs(value)
        for j in range(n, ld):
            x[i * ld + j] = 0.0
        largest = max(largest, row)
    squarings = 0
    shrink = 1.0
    while largest * shrink > NORM and squarings < 60:
        shrink *= 0.5
        squarings += 1
    if squarings > 0:
        for i in range(size):
            x[i] *= shrink
    product(x, x, x2, n, ld)
    for i in range(size):
        mixed[i] = X_1 * x[i] + X_2 * x2[i]
    product(x2, mixed, x4, n, ld)
    for i in range(size):
        mixed[i] = X_5 * x[i] + X_6 * x2[i] + X_7 * x4[i]
        x4[i] += X_3 * x2[i]
    for i in range(n):
        mixed[i * ld + i] += X_4
    product(x4, mixed, out, n, ld)
    for i in range(size):
        out[i] += x[i] + Y_2 * x2[i]
    for i in range(n):
        out[i * ld + i] += 1.0
    for _ in range(squarings):
        product(out, out, x, n, ld)
        copy(x, out, size)
    for j in range(n):
        x[j] = 1.0 / scale[j]
    for i in range(n):
        row = scale[i]
        for j in range(n):
            out[i * ld + j] *= row * x[j]


@inner
def sum_rows(a, h, w, n, ld):
    """Write aᵀ h into w, leaving out the rows whose element of h is zero."""
    for j in range(n):
        w[j] = 0.0
    for i in range(n):
        factor = h[i]
        if factor != 0.0:
            row = shift(a, i * ld)
            for j in range(n):
                w[j] += factor * row[j]


@inner
def project(p, h, r, w, n, ld):
    """Write p h into w for a symmetric p; return the variance h p hᵀ + r of a reading."""
    sum_rows(p, h, w, n, ld)
    s = r
    for i in range(n):
        s += h[i] * w[i]
    return s


@inner
def joseph(p, w, s, gain, n, ld):
    """Update the covariance p by a scalar reading; w and s are the results of `project`.

    Joseph's form (I − k hᵀ) p (I − k hᵀ)ᵀ + r k kᵀ, multiplied out: p − k wᵀ − w kᵀ + s k kᵀ, which an error
    of the gain k changes in second order only.  The result is symmetric to the last bit.
    """
    for i in range(n):
        gain[i] = w[i] / s if s > 0.0 else 0.0
    for i in range(n):
        row = shift(p, i * ld)
        k, away = gain[i], s * gain[i] - w[i]
        for j in range(n):
            row[j] += away * gain[j] - k * w[j]
    mirror(p, n, ld)


@inner
def mirror(a, n, ld):
    """Copy the lower triangle of a onto the upper one."""
    for i in range(n):
        for j in range(i):
            a[j * ld + i] = a[i * ld + j]


@inner
def project_root(root, h, r, w, n, ld):
    """Write rootᵀ h into w; return the variance of a reading."""
    sum_rows(root, h, w, n, ld)
    s = r
    for j in range(n):
        s += w[j] * w[j]
    return s


@inner
def potter(root, w, s, r, gain, n, ld):
    """Update the square root of a covariance, p = root rootᵀ, by a scalar reading (Potter 1963)."""
    if s <= 0.0:
        for i in range(n):
            gain[i] = 0.0
        return
    shrink = 1.0 / (1.0 + math.sqrt(r / s))
    for i in range(n):
        row = shift(root, i * ld)
        total = 0.0
        for j in range(n):
            total += row[j] * w[j]
        gain[i] = total / s
        for j in range(n):
            row[j] -= shrink * gain[i] * w[j]


@inner
def square(root, out, n, ld):
    """Write root rootᵀ into out."""
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(n):
                total += root[i * ld + k] * root[j * ld + k]
            out[i * ld + j] = total
            out[j * ld + i] = total


@inner
def triangle(a, rows, columns, out, ld):
    """Write the lower triangle whose square is aᵀa into out, by Householder reflections; a is used up.

    a has ``rows`` ≥ ``columns`` rows of ``ld`` elements.
    """
    for k in range(columns):
        norm = 0.0
        for i in range(k, rows):
            norm += a[i * ld + k] * a[i * ld + k]
        norm = math.sqrt(norm)
        if norm == 0.0:
            continue
        if a[k * ld + k] > 0.0:
            norm = -norm
        a[k * ld + k] -= norm
        scale = norm * a[k * ld + k]  # −(square of the reflector)/2
        for j in range(k + 1, columns):
            total = 0.0
            for i in range(k, rows):
                total += a[i * ld + k] * a[i * ld + j]
            total /= scale
            for i in range(k, rows):
                a[i * ld + j] += total * a[i * ld + k]
        a[k * ld + k] = norm
    for i in range(columns):
        for j in range(ld):
            out[i * ld + j] = 0.0
        for j in range(i + 1):
            out[i * ld + j] = a[j * ld + i]


@inner
def cholesky(a, out, n, ld):
    """Write the lower triangle whose square is a into out; a zero pivot leaves its column zero.

    Returns False if a pivot is clearly negative: then a is no covariance.
    """
    good = True
    for i in range(n):
        for j in range(ld):
            out[i * ld + j] = 0.0
    for j in range(n):
        pivot = a[j * ld + j]
        for k in range(j):
            pivot -= out[j * ld + k] * out[j * ld + k]
        least = 1e-13 * a[j * ld + j]
        if pivot <= least:
            good = good and pivot >= -1e-8 * abs(a[j * ld + j])
            continue
        root = math.sqrt(pivot)
        out[j * ld + j] = root
        for i in range(j + 1, n):
            total = a[i * ld + j]
            for k in range(j):
                total -= out[i * ld + k] * out[j * ld + k]
            out[i * ld + j] = total / root
    return good
