"""The Jacobian of the rates by the states, from directional derivatives: one by one, or all in one pass."""

from __future__ import annotations

from multibody.compile.calls import call_tangent, entry, floats, independent, inner, pointer, shift
from multibody.solvers.kernels.field import evaluate, hold_at
from multibody.solvers.kernels.field_layout import COLUMN_LANES, COLUMNS, PASSED, SEEDS, TANGENT, N, P, U


@inner
def jacobian(t, x, c, owner, colours, seed, column, zero, matrix):
    """Write the Jacobian by columns; ``owner`` gives for each colour and row the column of the entry."""
    n, lanes = c[N], c[COLUMN_LANES]
    for i in independent(n * n):
        matrix[i] = 0.0
    if lanes > 0:
        passed = floats(c[PASSED])
        for colour in range(colours):
            lane = colour % lanes
            if lane == 0:
                seeds = shift(floats(c[SEEDS]), colour * n)
                call_tangent(c[COLUMNS], t, x, floats(c[U]), floats(c[P]), seeds, zero, zero, passed)
            row = shift(owner, colour * n)
            for i in range(n):
                if row[i] >= 0:
                    matrix[row[i] * n + i] = passed[i * lanes + lane]
        return
    for colour in range(colours):
        row = shift(owner, colour * n)
        for i in range(n):
            seed[i] = 0.0
        for i in range(n):
            if row[i] >= 0:
                seed[row[i]] = 1.0
        call_tangent(c[TANGENT], t, x, floats(c[U]), floats(c[P]), seed, zero, zero, column)
        for i in range(n):
            if row[i] >= 0:
                matrix[row[i] * n + i] = column[i]


@entry
def jacobian_at(numbers, time, y, rates, owner, work, matrix):
    """Write the Jacobian of x at time[0] into matrix, by columns; for SciPy's own methods."""
    c = pointer(numbers)
    hold_at(time[0], c)
    evaluate(time[0], pointer(y), pointer(rates), c)
    n, seed = c[N], pointer(work)
    column, zero = shift(seed, n), shift(seed, 2 * n)
    jacobian(time[0], pointer(y), c, pointer(owner), owner.shape[0], seed, column, zero, pointer(matrix))
