"""Many steps of Krogstad's exponential Runge-Kutta method of order 4 with one fast motion, in one call.

The rates are split as f(y) = L·y + N(y) with L = u·wᵀ of rank one: w is the left eigenvector of the fast motion, kept
from call to call, and u = (∂f/∂y)·v, from one more evaluation along the right eigenvector v (w·v = 1), renewed as
often as λ changes and when a step is refused: N holds what L lacks, so that any L gives the same order.
Its functions are then numbers: φ(hL)·x = φ(0)·x + h·φ₊(hλ)·(w·x)·u with φ₊ the next function and λ = w·u.

Krogstad (2005), Generalized integrating factor methods for stiff PDEs, J. Comput. Phys. 203, 72-88.  The rates at the
end of the step in place of those of the fourth stage give a result of order 3 for the control of the step.
"""

from __future__ import annotations

import math

from multibody.compile.calls import entry, fused, independent, inner, pointer, shift
from multibody.solvers.kernels.field import evaluate
from multibody.solvers.kernels.field_layout import N
from multibody.solvers.kernels.stepping import (
    BUFFER_FULL,
    DONE,
    EVALUATIONS,
    FIRST,
    GO_ON,
    KNOWN,
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
    due,
    feature_step,
    first_step,
    mean_error,
    plan,
    remember_step,
    state_before,
    worst,
)

#: Step of the difference quotient along the fast motion, as a share of the states' sizes.
NEAR = 1e-6
#: Steps for which the fast motion's rate is kept at most; fewer while it changes, none once a step with it is refused.
KEPT = 8.0
#: In ``rates``: the rate in use, steps for which it still holds, for how many it was to hold, time and rate when found.
RATE, LEFT, SPELL, SEEN, FOUND = range(5)
#: Relative change of the rate from which it is renewed at every step, and below which it is kept twice as long.
CHANGING, RESTING = 0.1, 0.03


@inner
def functions(z):
    """Return φ₁ to φ₄ at z: φ₁ = (eᶻ − 1)/z, φₖ₊₁ = (φₖ − 1/k!)/z."""
    if abs(z) < 1.0:
        p4 = 0.0
        for k in range(14):
            # Horner's scheme of the sum of z^j / (j + 4)!
            p4 = 1.0 + z * p4 / (18.0 - k)
        p4 /= 24.0
        p3 = 1.0 / 6.0 + z * p4
        p2 = 0.5 + z * p3
        p1 = 1.0 + z * p2
    else:
        p1 = (math.exp(z) - 1.0) / z
        p2 = (p1 - 1.0) / z
        p3 = (p2 - 0.5) / z
        p4 = (p3 - 1.0 / 6.0) / z
    return p1, p2, p3, p4


@fused
def dot(n, a, b):
    """Return the sum of products."""
    even, odd = 0.0, 0.0
    for i in range(n // 2):
        even += a[2 * i] * b[2 * i]
        odd += a[2 * i + 1] * b[2 * i + 1]
    if n % 2 == 1:
        even += a[n - 1] * b[n - 1]
    return even + odd


@inner
def fast_rate(c, t, n, y, f, left, right, rtol, atol, moved, u):
    """Write u = (∂f/∂y)·v and return λ = w·u; zero, with u, where the motion does not die away by itself."""
    reach = 0.0
    for i in range(n):
        size = abs(y[i]) + atol[i] / rtol[i]
        if right[i] != 0.0 and size > 0.0:
            reach = max(reach, abs(right[i]) / size)
    rate = 0.0
    if reach > 0.0:
        step = NEAR / reach
        for i in range(n):
            moved[i] = y[i] + step * right[i]
        evaluate(t, moved, u, c)
        for i in range(n):
            u[i] = (u[i] - f[i]) / step
        rate = dot(n, left, u)
    if not rate < 0.0:
        rate = 0.0
        for i in range(n):
            u[i] = 0.0
    return rate


@inner
def renew(c, t, h, y, f, left, right, rates, rtol, atol, moved, u):
    """Find the fast motion's rate anew, and for how many steps to keep it.

    Where it changes fast, it is taken as it will be in the middle of the step: what it changes by within a step is then
    all that the method has to follow.
    """
    before, kept = rates[FOUND], rates[SPELL]
    rate = fast_rate(c, t, c[N], y, f, left, right, rtol, atol, moved, u)
    change, size = abs(rate - before), max(abs(rate), abs(before))
    if change > CHANGING * size:
        kept = 1.0
    elif change < RESTING * size:
        kept = min(2.0 * kept, KEPT)
    rates[SPELL] = rates[LEFT] = max(kept, 1.0)
    rates[RATE] = rates[FOUND] = rate
    passed = abs(t - rates[SEEN])
    rates[SEEN] = t
    if kept < 1.5 and before < 0.0 and rate < 0.0 and passed > 0.0:
        ahead = min(max(1.0 + (1.0 - before / rate) * 0.5 * h / passed, 0.5), 2.0)
        rates[RATE] *= ahead
        for i in range(c[N]):
            u[i] *= ahead


@fused
def stages(c, t, h, rate, n, y, f, u, left, moved, d2, d3, d4, y_new, f_new, raw):
    """Write the result, its rates and the raw errors of a step of signed size h."""
    z = h * rate
    p1, p2, p3, p4 = functions(z)
    q1, q2, q3, _ = functions(0.5 * z)
    w1 = dot(n, left, f)
    # s is w·(stage − y), and what L takes from the rates is u·s
    s = 0.5 * h * q1 * w1
    own = 0.25 * h * h * q2 * w1
    for i in independent(n):
        moved[i] = y[i] + 0.5 * h * f[i] + own * u[i]
    evaluate(t + 0.5 * h, moved, d2, c)
    for i in independent(n):
        d2[i] = d2[i] - f[i] - s * u[i]
    w2 = dot(n, left, d2)
    s += h * q2 * w2
    own = 0.5 * h * h * q3 * w2
    for i in independent(n):
        moved[i] += 0.5 * h * d2[i] + own * u[i]
    evaluate(t + 0.5 * h, moved, d3, c)
    for i in independent(n):
        d3[i] = d3[i] - f[i] - s * u[i]
    w3 = dot(n, left, d3)
    s = h * p1 * w1 + 2.0 * h * p2 * w3
    own = h * h * (p2 * w1 + 2.0 * p3 * w3)
    for i in independent(n):
        moved[i] = y[i] + h * (f[i] + d3[i]) + own * u[i]
    evaluate(t + h, moved, d4, c)
    for i in independent(n):
        d4[i] = d4[i] - f[i] - s * u[i]
    w4 = dot(n, left, d4)
    s = h * (p1 * w1 + (2.0 * p2 - 4.0 * p3) * (w2 + w3) + (4.0 * p3 - p2) * w4)
    own = h * h * (p2 * w1 + (2.0 * p3 - 4.0 * p4) * (w2 + w3) + (4.0 * p4 - p3) * w4)
    for i in independent(n):
        y_new[i] = y[i] + h * (f[i] + (d2[i] + d3[i]) / 3.0 + d4[i] / 6.0) + own * u[i]
    evaluate(t + h, y_new, f_new, c)
    for i in independent(n):
        raw[i] = d4[i] - (f_new[i] - f[i] - s * u[i])
    own = h * h * (4.0 * p4 - p3) * dot(n, left, raw)
    for i in independent(n):
        raw[i] = h / 6.0 * raw[i] + own * u[i]


@fused
def interpolate(z, h, size, y, k, out):
    """Write the state at the fraction z of a step: the cubic through states and rates at both ends."""
    f, f_new, y_new = k, shift(k, size), shift(k, 2 * size)
    z2 = z * z
    rise = z2 * (3.0 - 2.0 * z)
    before, after = h * z * (1.0 - z) * (1.0 - z), h * z2 * (z - 1.0)
    for i in independent(size):
        out[i] = y[i] + rise * (y_new[i] - y[i]) + before * f[i] + after * f_new[i]


@inner
def write_samples(c, clock, tally, size, y, k, left, right, rate, moved, result, count, sample_t, rows, sample_y):
    """Write the samples inside the last step; return False when the buffer is full before its end.

    The cubic leaves the fast motion a little off the path to which it clings; one step of Newton's method along it
    brings it back, or forces that depend on it would be wrong by λ times the cubic's error.
    """
    h = clock[STEP_OLD]
    f, f_new, y_new = k, shift(k, size), shift(k, 2 * size)
    while due(clock, tally, count, sample_t):
        j = tally[SAMPLE]
        row = j - tally[FIRST]
        if row == rows:
            return False
        out = shift(sample_y, row * size)
        z = (sample_t[j] - clock[T_OLD]) / h
        interpolate(z, h, size, y, k, out)
        if rate < 0.0 and z > 0.0 and z < 1.0:
            evaluate(sample_t[j], out, result, c)
            tally[EVALUATIONS] += 1
            for i in range(size):
                slope = 6.0 * z * (1.0 - z) * (y_new[i] - y[i]) / h
                slope += (1.0 - z) * (1.0 - 3.0 * z) * f[i] + z * (3.0 * z - 2.0) * f_new[i]
                moved[i] = result[i] - slope
            faded = 1.0 - math.exp(abs(h) * rate)
            back = faded * faded * dot(size, left, moved) / rate
            for i in range(size):
                out[i] -= back * right[i]
        tally[SAMPLE] = j + 1
    return True


@inner
def one_step(c, clock, tally, size, y, k, left, right, rates, rtol, atol, space):
    """Take one step with error control from y; return False if it would have to be too small."""
    moved, d2, d3 = space, shift(space, size), shift(space, 2 * size)
    d4, u, errors = shift(space, 3 * size), shift(space, 4 * size), shift(space, 5 * size)
    f_new, y_new = shift(k, size), shift(k, 2 * size)
    t = clock[T]
    if clock[STEP] == 0.0:
        first_step(c, clock, tally, size, size, y, k, y_new, d2, rtol, atol)
        tally[KNOWN] = 1
    proposal = min(min(clock[STEP], clock[LARGEST]), feature_step(c, t, y))
    limit = math.inf
    while True:
        h, t_new, clipped, jump = plan(c, clock, proposal)
        if h == 0.0:
            return False
        if tally[KNOWN] == 0:
            evaluate(t, y, k, c)
            tally[EVALUATIONS] += 1
            tally[KNOWN] = 1
        if rates[LEFT] < 0.5:
            renew(c, t, h, y, k, left, right, rates, rtol, atol, moved, u)
            tally[EVALUATIONS] += 1
        stages(c, t, t_new - t, rates[RATE], size, y, k, u, left, moved, d2, d3, d4, y_new, f_new, errors)
        tally[EVALUATIONS] += 4
        error = mean_error(size, y, y_new, errors, rtol, atol, errors)
        near = feature_step(c, t_new, y_new) if error <= 1.0 else 0.0
        if h <= 2.0 * near:
            break
        limit = h
        if rates[LEFT] < rates[SPELL] - 0.5:
            rates[LEFT], rates[SPELL] = 0.0, 1.0
        tally[REJECTED] += 1
        if error <= 1.0:
            proposal = max(0.2 * h, near)
            continue
        tally[WORST] = worst(size, errors)
        proposal = h * max(0.2, 0.9 * error**-0.25) if math.isfinite(error) else 0.2 * h
    rates[LEFT] -= 1.0
    accept(clock, h, t_new, error, 0.21, 0.05, proposal if clipped else 0.0, limit)
    tally[KNOWN] = 0 if jump else 2
    return True


@entry
def advance(
    numbers, clock, tally, y, work, store_t, store_y, store_k, rtol, atol, count, sample_t, sample_y, left, right, rates
):
    """Take many steps; as `dormand_prince.advance` of one run, with rates and states at both ends for the interpolant.

    ``left`` and ``right`` are the fast motion's eigenvectors, ``rates`` what is known of its λ (see `RATE` and so on).
    """
    size, c = y.shape[1], pointer(numbers)
    ticks, counts, times, samples = pointer(clock), pointer(tally), pointer(sample_t), pointer(sample_y)
    spans, states, ends, space = pointer(store_t), pointer(store_y), pointer(store_k), pointer(work)
    state, rows, w, v, rate = pointer(y), sample_y.shape[1], pointer(left), pointer(right), pointer(rates)
    counts[DONE] = 0
    while True:
        slot = counts[SLOT]
        start, k = shift(states, slot * size), shift(ends, slot * 3 * size)
        if not write_samples(
            c,
            ticks,
            counts,
            size,
            start,
            k,
            w,
            v,
            rate[RATE],
            space,
            shift(space, size),
            sample_t.size,
            times,
            rows,
            samples,
        ):
            return BUFFER_FULL
        status = state_before(ticks, counts, counts[WANTED])
        if status != GO_ON:
            return status
        last = shift(k, size)
        slot = counts[DONE] % store_t.shape[0]
        counts[SLOT] = slot
        start, k = shift(states, slot * size), shift(ends, slot * 3 * size)
        if counts[KNOWN] == 2:
            for i in range(size):
                k[i] = last[i]
            counts[KNOWN] = 1
        for i in range(size):
            start[i] = state[i]
        if not one_step(c, ticks, counts, size, start, k, w, v, rate, pointer(rtol), pointer(atol), space):
            return TOO_SMALL
        remember_step(ticks, counts, spans)
        y_new = shift(k, 2 * size)
        for i in range(size):
            state[i] = y_new[i]
