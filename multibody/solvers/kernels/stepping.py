"""What every method with error control does around its formulas: plan a step, accept it, propose the next one.

Indices into ``clock`` (float64): time, proposed step, logarithm of the last step's error, end, direction, largest step,
begin and size of the last accepted step, largest accepted step.
Indices into ``tally`` (int64): steps wanted, steps done, rejected
steps, evaluations, next sample, first sample of the buffer, state of the largest error, whether the
derivative at y is known (0 no, 1 as stage 1, 2 as stage 7 of the last step), slot of the last step,
Jacobians, factorizations, whether to watch for stiffness, steps in a row that stability limited, steps since
the last of them, how the run stands (one of the numbers below).
"""

from __future__ import annotations

import math

from multibody.compile.calls import call_rhs, floats, independent, inner, ints
from multibody.solvers.kernels.field import evaluate, hold_at, next_break
from multibody.solvers.kernels.field_layout import (
    DELAYED,
    JUMPS,
    N_GROUPS,
    N_HELD,
    N_SPEEDS,
    PACES,
    SPEEDS,
    WIDTHS,
    WINDOW,
    P,
    U,
)

T, STEP, ERROR, END, DIRECTION, LARGEST, T_OLD, STEP_OLD, LONGEST = range(9)
WANTED, DONE, REJECTED, EVALUATIONS, SAMPLE, FIRST, WORST, KNOWN, SLOT, JACOBIANS, FACTORIZATIONS = range(11)
WATCH, SUSPECT, CALM, STATUS = range(11, 15)
TICKS, COUNTS = 9, 15  # lengths of clock and tally
MORE, FINISHED, BUFFER_FULL, STIFF, GO_ON, TOO_SMALL = 0, 1, 2, 3, 4, -1
ROW = 15  # steps in a row on the edge of stability that make a problem stiff
NEGLIGIBLE = 1e-4  # share of a direction's largest component below which a component needs no relative accuracy
LEAST_ERROR = math.log(1e-4)  # of those that the next step looks back at
TINY = 1e-150  # what is smaller has died away; its square is still a normal number
HARDLY = 1e-12  # share of the time below which a step is nearly as short as rounding lets it be (2e-15); chosen
FAINT = 1e-130  # a direction that is smaller has not begun: its error counts from there


@inner
def plan(c, clock, proposal):
    """Fit a proposed step to the end and to the next break of the inputs, and hold the inputs for it.

    Returns the size of the step, its end, whether it was clipped, and whether the rates jump at its end; the
    size is zero if the proposal is too small to go on.
    """
    t, direction = clock[T], clock[DIRECTION]
    h = proposal
    t_new = t + direction * h
    clipped, jump = False, False
    if not proposal >= 10.0 * 2.220446049250313e-16 * abs(t) + 1e-300:
        return 0.0, t, clipped, jump
    target = clock[END]
    if c[N_GROUPS] > 0:
        edge, index = next_break(t, direction, c)
        if direction * (edge - target) < 0.0:
            target = edge
            jump = ints(c[JUMPS])[index] != 0 or c[DELAYED] != 0
    remaining = direction * (target - t)
    if 1.01 * h >= remaining:
        h, t_new, clipped = remaining, target, True
    else:
        jump = False
        # Two equal steps are better than a long one and a short one.
        if 2.0 * h > remaining:
            h, clipped = 0.5 * remaining, True
            t_new = t + direction * h
    if c[N_HELD] > 0:
        hold_at(t + 0.5 * direction * h, c)
    if c[DELAYED] != 0:
        inside = max(1e-9 * h, 1e-15 * max(abs(t), abs(t_new)))
        window = floats(c[WINDOW])
        window[0], window[1] = min(t, t_new) + inside, max(t, t_new) - inside
    return h, t_new, clipped, jump


@inner
def feature_step(c, t, y):
    """Return the step in which something narrow passes by half of its width, at the speeds of a state."""
    shortest = math.inf
    if c[N_SPEEDS] > 0:
        speeds = floats(c[PACES])
        call_rhs(c[SPEEDS], t, y, floats(c[U]), floats(c[P]), speeds)
        shortest = half_passed(c[N_SPEEDS], speeds, floats(c[WIDTHS]))
    return shortest


@inner
def half_passed(count, speeds, widths):
    """Return after which time the first of some widths has passed by by half."""
    shortest = math.inf
    for i in range(count):
        if 0.5 * widths[i] < abs(speeds[i]) * shortest:
            shortest = 0.5 * widths[i] / abs(speeds[i])
    return shortest


@inner
def first_step(c, clock, tally, size, count, y, f, y_new, result, rtol, atol):
    """Write the rates at y into f and propose the first step, from their size and their change.

    Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.4, for methods of order 5.
    """
    t, direction = clock[T], clock[DIRECTION]
    limit = min(clock[LARGEST], direction * (clock[END] - t))
    plan(c, clock, limit)
    evaluate(t, y, f, c)
    d0, d1, d2 = 0.0, 0.0, 0.0
    for i in range(count):
        scale = 1.0 / (atol[i] + rtol[i] * abs(y[i]) + 1e-300)
        d0 += (y[i] * scale) ** 2
        d1 += (f[i] * scale) ** 2
    d0, d1 = math.sqrt(d0 / count), math.sqrt(d1 / count)
    h = 1e-6
    if d0 >= 1e-5 and d1 >= 1e-5:
        h = 0.01 * d0 / d1
    h = min(h, limit)
    for i in range(size):
        y_new[i] = y[i] + direction * h * f[i]
    evaluate(t + direction * h, y_new, result, c)
    for i in range(count):
        d2 += ((result[i] - f[i]) / (atol[i] + rtol[i] * abs(y[i]) + 1e-300)) ** 2
    steepest = max(d1, math.sqrt(d2 / count) / h)
    first = max(1e-6, 1e-3 * h)
    if steepest > 1e-15:
        first = (0.01 / steepest) ** (1.0 / 6.0)
    first = min(100.0 * h, first, limit)
    clock[STEP] = first if math.isfinite(first) and first > 0.0 else min(1e-6, limit)
    tally[EVALUATIONS] += 2


@inner
def accept(clock, h, t_new, error, exponent, damping, keep, limit):
    """Accept a step: remember it and propose the next, between ``keep`` and ``limit``.

    A PI controller (Hairer and Wanner, Solving Ordinary Differential Equations II, IV.2).
    """
    t = clock[T]
    size = math.log(max(error, 1e-10))  # two powers by one logarithm: they are a tenth of a small machine's step
    factor = 0.9 * math.exp(damping * clock[ERROR] - exponent * size)
    clock[STEP] = min(limit, max(keep, h * min(10.0, max(0.2, factor))))
    clock[ERROR] = max(size, LEAST_ERROR)
    clock[T_OLD] = t
    clock[STEP_OLD] = t_new - t
    clock[LONGEST] = max(clock[LONGEST], h)
    clock[T] = t_new


@inner
def mean_error(count, y, y_new, raw, rtol, atol, errors):
    """Scale raw errors by the tolerances and return their root mean square."""
    for i in independent(count):
        errors[i] = raw[i] / (atol[i] + rtol[i] * max(abs(y[i]), abs(y_new[i])))
    # four sums side by side: each addition waits for the one before
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    whole = count - count % 4
    for i in range(0, whole, 4):
        a += errors[i] * errors[i]
        b += errors[i + 1] * errors[i + 1]
        c += errors[i + 2] * errors[i + 2]
        d += errors[i + 3] * errors[i + 3]
    for i in range(whole, count):
        a += errors[i] * errors[i]
    return math.sqrt((a + b + c + d) / count)


@inner
def direction_error(n, size, y, y_new, raw, rtol, atol, largest):
    """Return the largest error of a direction: a root mean square over its components, in tolerances.

    What a direction may be off by follows its own size: the relative tolerance of a component times the largest that
    the component has been (``largest``), where the states' tolerances are the units in which components of a direction
    compare.  A component that stays far below the others of its direction need not be relatively exact.

    A direction that begins at a kink in the middle of a step is off by a share of its own size, however short the step:
    where steps are hardly longer than the time's rounding it does not count (`long_enough`).
    """
    worst_mean, per_unit = 0.0, largest  # the states' places there are free
    for i in range(n):
        per_unit[i] = 1.0 / (atol[i] + rtol[i] * max(abs(y[i]), abs(y_new[i])))
    for j in range(1, size // n):
        first, most = j * n, 0.0
        for i in range(n):
            most = max(most, max(largest[first + i], abs(y_new[first + i]), FAINT) * per_unit[i])
        total = 0.0
        for i in range(n):
            unit = atol[i] + rtol[i] * max(abs(y[i]), abs(y_new[i]))
            own = max(largest[first + i], abs(y_new[first + i]), FAINT)
            allowed = rtol[first + i] * max(own, NEGLIGIBLE * most * unit)
            if allowed > 0.0:
                total += (raw[first + i] / allowed) ** 2
        if not math.isfinite(total):
            return math.inf
        worst_mean = max(worst_mean, total / n)
    return math.sqrt(worst_mean)


@inner
def long_enough(h, t):
    """Tell whether a step is long enough for the errors of directions to count."""
    return h > HARDLY * abs(t)


@inner
def remember_largest(n, size, y_new, largest):
    """Raise the largest size of every component of the directions to that at the end of a step."""
    for i in range(n, size):
        largest[i] = max(largest[i], abs(y_new[i]))


@inner
def forget_tiny(size, y_new):
    """Set to zero what has died away: the processor needs a hundred times longer for numbers below 1e-308.

    The derivatives by a start state get there within seconds in a machine that forgets how it began.
    """
    for i in independent(size):
        y_new[i] = 0.0 if abs(y_new[i]) < TINY else y_new[i]


@inner
def worst(count, errors):
    """Return the index of the largest scaled error; one that is not finite wins."""
    index, largest = 0, -1.0
    for i in range(count):
        e = abs(errors[i])
        if not math.isfinite(e):
            return i
        if e > largest:
            index, largest = i, e
    return index


@inner
def due(clock, tally, count, times):
    """Tell whether the next sample lies within the last step."""
    j = tally[SAMPLE]
    return j < count and clock[DIRECTION] * (times[j] - clock[T]) <= 0.0


@inner
def step_of(t, direction, steps, spans, j):
    """Return the stored step that holds a time, beginning the search at j; ``spans`` holds begin and size of each."""
    while j > 0 and direction * (t - spans[2 * j]) < 0.0:
        j -= 1
    while j + 1 < steps and direction * (t - spans[2 * j + 2]) > 0.0:
        j += 1
    return j


@inner
def state_before(clock, tally, wanted):
    """Return how a run stands before its next step: finished, stiff, with enough steps, or to be gone on with."""
    if clock[T] == clock[END]:
        return FINISHED
    if tally[SUSPECT] >= ROW:
        tally[SUSPECT] = 0
        return STIFF
    return MORE if tally[DONE] >= wanted else GO_ON


@inner
def remember_step(clock, tally, spans):
    """Note begin and size of the step just taken in its slot."""
    slot = tally[SLOT]
    spans[2 * slot], spans[2 * slot + 1] = clock[T_OLD], clock[STEP_OLD]
    tally[DONE] += 1
