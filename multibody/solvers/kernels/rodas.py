"""Many steps of the Rosenbrock method Rodas5P in one call.

Coefficients: Steinebach (2023), Construction of Rosenbrock-Wanner method Rodas5P and numerical benchmarks,
BIT Numerical Mathematics 63, 27, in the form of Hairer and Wanner, Solving Ordinary Differential Equations
II, IV.7. Jacobian columns are directional derivatives of the right-hand side.  The Jacobian of [x,
directions] has that of x in every diagonal block, so that one factorization serves all; the block below it,
the second derivative along a direction, enters by a difference quotient.
"""

from __future__ import annotations

import math

from multibody.compile.calls import entry, fused, independent, inner, pointer, shift
from multibody.solvers.kernels.field import evaluate, evaluate_state, look_up, tangents
from multibody.solvers.kernels.field_layout import N_MOVING, M, N
from multibody.solvers.kernels.jacobian import jacobian
from multibody.solvers.kernels.rodas_tableau import GAMMA, NODES, TIME, A, C, H
from multibody.solvers.kernels.stepping import (
    BUFFER_FULL,
    DIRECTION,
    DONE,
    EVALUATIONS,
    FACTORIZATIONS,
    FIRST,
    GO_ON,
    JACOBIANS,
    LARGEST,
    REJECTED,
    SAMPLE,
    SLOT,
    STEP,
    STEP_OLD,
    T_OLD,
    TOO_SMALL,
    WANTED,
    WORST,
    T,
    accept,
    direction_error,
    due,
    feature_step,
    first_step,
    forget_tiny,
    long_enough,
    mean_error,
    plan,
    remember_largest,
    remember_step,
    state_before,
    worst,
)

INSIDE = 0.75  # share of a step at which the interpolant is tried


@fused
def factorize(n, a, pivots):
    """Replace a matrix stored by columns by its LU factors; return False if it is singular."""
    for k in range(n):
        own = shift(a, k * n)
        best, pivot = abs(own[k]), k
        for i in range(k + 1, n):
            if abs(own[i]) > best:
                best, pivot = abs(own[i]), i
        pivots[k] = pivot
        if not (best > 0.0 and math.isfinite(best)):
            return False
        scale = 1.0 / own[pivot]
        own[pivot], own[k] = own[k], own[pivot]
        for i in independent(k + 1, n):
            own[i] *= scale
        for j in range(k + 1, n):
            other = shift(a, j * n)
            factor = other[pivot]
            other[pivot], other[k] = other[k], factor
            if factor != 0.0:
                for i in independent(k + 1, n):
                    other[i] -= factor * own[i]
    return True


@inner
def first_not_finite(c, t, h, size, y, f, matrix, shifted, result):
    """Return the first state whose rate, or a derivative of it, is not finite here or just ahead; else -1.

    The scaled errors do not tell: solving the linear system spreads what is not finite over all states.
    """
    n = c[N]
    for i in range(n):
        if not math.isfinite(f[i]):
            return i
        for j in range(n):
            if not math.isfinite(matrix[j * n + i]):
                return i
    for i in range(size):
        shifted[i] = y[i] + h * f[i]
    evaluate(t + h, shifted, result, c)
    for i in range(n):
        if not math.isfinite(result[i]):
            return i
    return -1


@fused
def solve(n, a, pivots, b):
    """Replace b by the solution of the factorized system."""
    for k in range(n):
        pivot = pivots[k]
        value = b[pivot]
        b[pivot], b[k] = b[k], value
        if value != 0.0:
            own = shift(a, k * n)
            for i in independent(k + 1, n):
                b[i] -= value * own[i]
    for k in range(n - 1, -1, -1):
        own = shift(a, k * n)
        value = b[k] / own[k]
        b[k] = value
        for i in independent(k):
            b[i] -= value * own[i]


@inner
def couple(t, c, size, y, f, increment, shifted, result, out):
    """Add to the directions' part of out the derivative of their rates along ``increment`` of the state."""
    n, step = c[N], 1e-6
    for i in range(n):
        shifted[i] = y[i] + step * increment[i]
    for i in range(n, size):
        shifted[i] = y[i]
    if c[N_MOVING] > 0:
        look_up(t, c)
    tangents(t, shifted, result, c)
    for i in range(n, size):
        out[i] += (result[i] - f[i]) / step


@fused
def stages(c, t, h, size, y, f, f_t, factors, pivots, k, y_new, shifted, result):
    """Compute the eight stages into k and the result into y_new."""
    n = c[N]
    for s in range(8):
        own = shift(k, s * size)
        for i in independent(size):
            own[i] = f[i]
        if s > 0:
            last = shift(k, (s - 1) * size)
            if s < 6:
                for i in independent(size):
                    y_new[i] = y[i]
                for j in range(s):
                    a, other = A[s, j], shift(k, j * size)
                    for i in independent(size):
                        y_new[i] += a * other[i]
            else:
                for i in independent(size):
                    y_new[i] += last[i]
            evaluate(t + NODES[s] * h, y_new, own, c)
            for j in range(s):
                a, other = C[s, j] / h, shift(k, j * size)
                for i in independent(size):
                    own[i] += a * other[i]
        if TIME[s] != 0.0:
            a = h * TIME[s]
            for i in independent(size):
                own[i] += a * f_t[i]
        solve(n, factors, pivots, own)
        if size > n:
            couple(t, c, size, y, f, own, shifted, result, own)
            for j in range(c[M]):
                solve(n, factors, pivots, shift(own, n * (j + 1)))
    last = shift(k, 7 * size)
    for i in independent(size):
        y_new[i] += last[i]


@fused
def interpolate(z, count, y, end, d1, d2, d3, out):
    """Write the first components of the state at the fraction z of a step, from its ends and three vectors."""
    for i in independent(count):
        out[i] = (1.0 - z) * y[i] + z * (end[i] + (1.0 - z) * (d1[i] + z * (d2[i] + z * d3[i])))


@inner
def interpolate_from(z, size, y, k, out):
    """As `interpolate`, from the vectors that `store_interpolant` wrote one after another."""
    interpolate(z, size, y, k, shift(k, size), shift(k, 2 * size), shift(k, 3 * size), out)


@fused
def store_interpolant(size, k, y_new, out):
    """Write what `interpolate` needs of a step."""
    for i in independent(size):
        out[i] = y_new[i]
    for j in range(3):
        row = shift(out, (j + 1) * size)
        for i in independent(size):
            row[i] = 0.0
        for s in range(8):
            a, other = H[j, s], shift(k, s * size)
            for i in independent(size):
                row[i] += a * other[i]


@fused
def error_between(c, t, h, size, y, k, factors, pivots, shifted, rates, y_new, rtol, atol, errors):
    """Return how far off the interpolant is inside a step, as a root mean square in tolerances.

    What is short of the equations there, through the factors of the step, is about the error itself where a motion
    is stiff, and its change over the step where it is not.  Without it a fast motion that a kink sets off in the middle
    of a step has died away at its end, where the method's own estimate looks.  At three quarters the ratio to the
    largest error between is the most even (a gear contact: median 0.8; 0.3 in the middle).
    The idea is that of Rodas5Pr in OrdinaryDiffEq.jl, which looks in the middle and without the factors.
    """
    z, n = INSIDE, c[N]
    d1, d2, d3 = shift(k, size), shift(k, 2 * size), shift(k, 3 * size)
    interpolate(z, n, y, k, d1, d2, d3, shifted)
    evaluate_state(t + z * h, shifted, rates, c)
    for i in independent(n):
        bend = d1[i] + z * (d2[i] + z * d3[i])
        slope = k[i] - y[i] + (1.0 - 2.0 * z) * bend + z * (1.0 - z) * (d2[i] + 2.0 * z * d3[i])
        rates[i] = slope / h - rates[i]
    solve(n, factors, pivots, rates)
    return mean_error(n, y, y_new, rates, rtol, atol, errors)


@inner
def write_samples(clock, tally, size, y, k, count, sample_t, rows, sample_y):
    """Write the samples inside the last step; return False when the buffer is full before its end."""
    while due(clock, tally, count, sample_t):
        j = tally[SAMPLE]
        row = j - tally[FIRST]
        if row == rows:
            return False
        interpolate_from((sample_t[j] - clock[T_OLD]) / clock[STEP_OLD], size, y, k, shift(sample_y, row * size))
        tally[SAMPLE] = j + 1
    return True


@inner
def differentiate_by_time(c, t, reach, size, y, f, f_t):
    """Write the rates f at y and their time derivative f_t, from what they are at t + reach."""
    evaluate(t + reach, y, f_t, c)
    evaluate(t, y, f, c)
    for i in range(size):
        f_t[i] = (f_t[i] - f[i]) / reach


@inner
def linearize(c, t, reach, size, y, f, f_t, shifted, owner, colours, zero, matrix):
    """Write the rates f, their time derivative f_t and the Jacobian of x at y."""
    differentiate_by_time(c, t, reach, size, y, f, f_t)
    jacobian(t, y, c, owner, colours, shifted, shift(shifted, size), zero, matrix)


@inner
def one_step(c, clock, tally, size, count, y, work, pivots, owner, colours, rtol, atol, largest, between):
    """Take one step with error control from y; return False if it would have to be too small.

    ``between`` gets the vectors of the interpolant.
    """
    n, t, direction = c[N], clock[T], clock[DIRECTION]
    y_new, errors, f, f_t = work, shift(work, size), shift(work, 2 * size), shift(work, 3 * size)
    shifted, result, k = shift(work, 4 * size), shift(work, 5 * size), shift(work, 6 * size)
    matrix = shift(work, 14 * size)
    factors, zero = shift(matrix, n * n), shift(matrix, 2 * n * n)
    if clock[STEP] == 0.0:
        first_step(c, clock, tally, size, count, y, f, y_new, result, rtol, atol)
    proposal = min(min(clock[STEP], clock[LARGEST]), feature_step(c, t, y))
    limit = math.inf
    reach = 0.0
    while True:
        h, t_new, clipped, _ = plan(c, clock, proposal)
        if h == 0.0:
            return False
        if reach == 0.0:
            reach = min(h, math.sqrt(2.220446049250313e-16 * max(1e-5, abs(t))))
            linearize(c, t, direction * reach, size, y, f, f_t, shifted, owner, colours, zero, matrix)
            tally[EVALUATIONS] += 2
            tally[JACOBIANS] += 1
        elif h < reach:  # a kink beyond the step is none of its business
            reach = h
            differentiate_by_time(c, t, direction * reach, size, y, f, f_t)
            tally[EVALUATIONS] += 2
        signed = t_new - t
        diagonal = 1.0 / (signed * GAMMA)
        for i in independent(n * n):
            factors[i] = -matrix[i]
        for i in range(n):
            factors[i * n + i] += diagonal
        tally[FACTORIZATIONS] += 1
        error, near = math.nan, 0.0
        if factorize(n, factors, pivots):
            stages(c, t, signed, size, y, f, f_t, factors, pivots, k, y_new, shifted, result)
            tally[EVALUATIONS] += 7
            error = mean_error(count, y, y_new, shift(k, 7 * size), rtol, atol, errors)
            if count < size and long_enough(h, t):
                last = shift(k, 7 * size)
                error = max(error, direction_error(n, size, y, y_new, last, rtol, atol, largest))
            if error <= 1.0:
                store_interpolant(size, k, y_new, between)
                inside = error_between(
                    c, t, signed, size, y, between, factors, pivots, shifted, result, y_new, rtol, atol, errors
                )
                tally[EVALUATIONS] += 1
                error = max(error, inside) if math.isfinite(inside) else inside
            if error <= 1.0:
                near = feature_step(c, t_new, y_new)
            if h <= 2.0 * near:
                break
            tally[WORST] = worst(count, errors)
        if not math.isfinite(error):
            state = first_not_finite(c, t, signed, size, y, f, matrix, shifted, result)
            tally[WORST] = state if state >= 0 else tally[WORST]
        limit = h
        tally[REJECTED] += 1
        if error <= 1.0:
            proposal = max(0.2 * h, near)
            continue
        proposal = h * max(0.2, 0.9 * error**-0.2) if math.isfinite(error) else 0.2 * h
    forget_tiny(size, y_new)
    if count < size:
        remember_largest(n, size, y_new, largest)
    accept(clock, h, t_new, error, 0.2, 0.0, proposal if clipped else 0.0, limit)
    return True


@entry
def advance(
    numbers,
    clock,
    tally,
    y,
    work,
    store_t,
    store_y,
    store_k,
    rtol,
    atol,
    count,
    sample_t,
    sample_y,
    owner,
    pivots,
    largest,
):
    """Take many steps; as `dormand_prince.advance` of one run, with four vectors for the interpolant of each step."""
    size, c = y.shape[1], pointer(numbers)
    ticks, counts, times, samples = pointer(clock), pointer(tally), pointer(sample_t), pointer(sample_y)
    spans, states, vectors, space = pointer(store_t), pointer(store_y), pointer(store_k), pointer(work)
    state, rows = pointer(y), sample_y.shape[1]
    counts[DONE] = 0
    while True:
        slot = counts[SLOT]
        start, k = shift(states, slot * size), shift(vectors, slot * 4 * size)
        if not write_samples(ticks, counts, size, start, k, sample_t.size, times, rows, samples):
            return BUFFER_FULL
        status = state_before(ticks, counts, counts[WANTED])
        if status != GO_ON:
            return status
        slot = counts[DONE] % store_t.shape[0]
        counts[SLOT] = slot
        start, k = shift(states, slot * size), shift(vectors, slot * 4 * size)
        for i in range(size):
            start[i] = state[i]
        if not one_step(
            c,
            ticks,
            counts,
            size,
            count,
            start,
            space,
            pointer(pivots),
            pointer(owner),
            owner.shape[0],
            pointer(rtol),
            pointer(atol),
            pointer(largest),
            k,
        ):
            return TOO_SMALL
        remember_step(ticks, counts, spans)
        for i in range(size):
            state[i] = space[i]
