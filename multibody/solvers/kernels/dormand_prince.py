"""Many steps of the Dormand-Prince 5(4) pair in one call.

Coefficients: Dormand and Prince (1980), J. Comput. Appl. Math. 6, 19-26; interpolant of order 4: Shampine
(1986), Math. Comp. 46, 135-150; step control: Hairer, Norsett, Wanner, Solving Ordinary Differential
Equations I, IV.2.
"""

from __future__ import annotations

import math

from multibody.compile.calls import entry, floats, fused, independent, inner, ints, pointer, shift
from multibody.solvers.kernels.field import evaluate
from multibody.solvers.kernels.field_layout import N
from multibody.solvers.kernels.stepping import (
    BUFFER_FULL,
    CALM,
    COUNTS,
    DONE,
    EVALUATIONS,
    FIRST,
    GO_ON,
    KNOWN,
    LARGEST,
    MORE,
    REJECTED,
    SAMPLE,
    SLOT,
    STATUS,
    STEP,
    STEP_OLD,
    SUSPECT,
    T_OLD,
    TICKS,
    TOO_SMALL,
    WANTED,
    WATCH,
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

REACH = 3.25  # |h·λ| on the edge of the method's stability
DAMPING = 0.04  # of the step's controller (Hairer and Wanner, Solving Ordinary Differential Equations II, IV.2)
EXPONENT = 1 / 5 - 0.75 * DAMPING


@fused
def stages(c, t, h, size, y, k, y_new):
    """Write stages 2 to 7 into k and the result into y_new; stage 1 is there already."""
    k1, k2, k3 = k, shift(k, size), shift(k, 2 * size)
    k4, k5, k6, k7 = shift(k, 3 * size), shift(k, 4 * size), shift(k, 5 * size), shift(k, 6 * size)
    for i in independent(size):
        y_new[i] = y[i] + h * (1 / 5) * k1[i]
    evaluate(t + h / 5, y_new, k2, c)
    for i in independent(size):
        y_new[i] = y[i] + h * ((3 / 40) * k1[i] + (9 / 40) * k2[i])
    evaluate(t + h * (3 / 10), y_new, k3, c)
    for i in independent(size):
        y_new[i] = y[i] + h * ((44 / 45) * k1[i] - (56 / 15) * k2[i] + (32 / 9) * k3[i])
    evaluate(t + h * (4 / 5), y_new, k4, c)
    for i in independent(size):
        y_new[i] = y[i] + h * (
            (19372 / 6561) * k1[i] - (25360 / 2187) * k2[i] + (64448 / 6561) * k3[i] - (212 / 729) * k4[i]
        )
    evaluate(t + h * (8 / 9), y_new, k5, c)
    for i in independent(size):
        y_new[i] = y[i] + h * (
            (9017 / 3168) * k1[i]
            - (355 / 33) * k2[i]
            + (46732 / 5247) * k3[i]
            + (49 / 176) * k4[i]
            - (5103 / 18656) * k5[i]
        )
    evaluate(t + h, y_new, k6, c)
    for i in independent(size):
        y_new[i] = y[i] + h * (
            (35 / 384) * k1[i] + (500 / 1113) * k3[i] + (125 / 192) * k4[i] - (2187 / 6784) * k5[i] + (11 / 84) * k6[i]
        )
    evaluate(t + h, y_new, k7, c)


@fused
def raw_errors(h, size, count, k, out):
    """Write the difference to the embedded method of order 4 into out."""
    k1, k3, k4 = k, shift(k, 2 * size), shift(k, 3 * size)
    k5, k6, k7 = shift(k, 4 * size), shift(k, 5 * size), shift(k, 6 * size)
    for i in independent(count):
        out[i] = h * (
            (71 / 57600) * k1[i]
            - (71 / 16695) * k3[i]
            + (71 / 1920) * k4[i]
            - (17253 / 339200) * k5[i]
            + (22 / 525) * k6[i]
            - (1 / 40) * k7[i]
        )


@fused
def interpolate(z, h, size, y, k, out):
    """Write the state at the fraction z of a step into out."""
    z2 = z * z
    z3 = z2 * z
    z4 = z3 * z
    b1 = h * (z - (8048581381 / 2820520608) * z2 + (8663915743 / 2820520608) * z3 - (12715105075 / 11282082432) * z4)
    b3 = h * ((131558114200 / 32700410799) * z2 - (68118460800 / 10900136933) * z3 + (87487479700 / 32700410799) * z4)
    b4 = h * (-(1754552775 / 470086768) * z2 + (14199869525 / 1410260304) * z3 - (10690763975 / 1880347072) * z4)
    b5 = h * (
        (127303824393 / 49829197408) * z2 - (318862633887 / 49829197408) * z3 + (701980252875 / 199316789632) * z4
    )
    b6 = h * (-(282668133 / 205662961) * z2 + (2019193451 / 616988883) * z3 - (1453857185 / 822651844) * z4)
    b7 = h * ((40617522 / 29380423) * z2 - (110615467 / 29380423) * z3 + (69997945 / 29380423) * z4)
    k1, k3, k4 = k, shift(k, 2 * size), shift(k, 3 * size)
    k5, k6, k7 = shift(k, 4 * size), shift(k, 5 * size), shift(k, 6 * size)
    for i in independent(size):
        out[i] = y[i] + (b1 * k1[i] + b3 * k3[i] + b4 * k4[i] + b5 * k5[i] + b6 * k6[i] + b7 * k7[i])


@inner
def write_samples(clock, tally, size, y, k, count, sample_t, rows, sample_y):
    """Write the samples inside the last step; return False when the buffer is full before its end."""
    while due(clock, tally, count, sample_t):
        j = tally[SAMPLE]
        row = j - tally[FIRST]
        if row == rows:
            return False
        h = clock[STEP_OLD]
        interpolate((sample_t[j] - clock[T_OLD]) / h, h, size, y, k, shift(sample_y, row * size))
        tally[SAMPLE] = j + 1
    return True


@inner
def stiffness_measure(h, n, size, y, k, y_new, rtol, atol):
    """Return |h·λ| of the fastest motion that the last two stages show.

    They are at the same time, so that what their rates differ by over what their states differ by is an
    eigenvalue.  Hairer and Wanner, Solving Ordinary Differential Equations II, IV.2.  Each direction shows an
    eigenvalue of its own: where its error limits the steps, the state's own fast motions have died away.
    """
    k1, k2, k3 = k, shift(k, size), shift(k, 2 * size)
    k4, k5, k6, k7 = shift(k, 3 * size), shift(k, 4 * size), shift(k, 5 * size), shift(k, 6 * size)
    fastest = 0.0
    for j in range(size // n):
        rates, states = 0.0, 0.0
        for a in range(n):
            i = j * n + a
            stage = y[i] + h * (
                (9017 / 3168) * k1[i]
                - (355 / 33) * k2[i]
                + (46732 / 5247) * k3[i]
                + (49 / 176) * k4[i]
                - (5103 / 18656) * k5[i]
            )
            unit = atol[a] + rtol[a] * abs(y_new[a])
            rates += ((k7[i] - k6[i]) / unit) ** 2
            states += ((y_new[i] - stage) / unit) ** 2
        if states > 0.0:
            fastest = max(fastest, rates / states)
    return abs(h) * math.sqrt(fastest)


@inner
def watch(clock, tally, n, size, y, k, y_new, rtol, atol):
    """Count the steps in a row that stability and not accuracy limits; six others end the row."""
    if tally[SUSPECT] == 0 and tally[DONE] % 8 != 0:
        return
    if stiffness_measure(clock[STEP_OLD], n, size, y, k, y_new, rtol, atol) > REACH:
        tally[SUSPECT] += 1
        tally[CALM] = 0
    else:
        tally[CALM] += 1
        if tally[CALM] == 6:
            tally[SUSPECT] = 0


@inner
def shorter(h, error, near):
    """Return the step to try after one with too large an error, or in which something narrow would pass by unseen."""
    if error <= 1.0:
        step = max(0.2 * h, near)
    elif math.isfinite(error):
        step = h * max(0.2, 0.9 * error**-EXPONENT)
    else:
        step = 0.2 * h
    return step


@inner
def accept_or_shorten(
    c, clock, tally, h, t_new, clipped, jump, size, count, y, k, y_new, rtol, atol, errors, largest, proposal, limit
):
    """Accept the step to y_new and return zero, or return the shorter step to try in its place.

    ``clipped`` and ``jump`` are those of `plan`, ``proposal`` is the step before it was clipped, and ``limit`` the
    shortest step that was rejected here.
    """
    begin = clock[T]
    raw_errors(t_new - begin, size, size, k, errors)
    error = mean_error(count, y, y_new, errors, rtol, atol, errors)
    if count < size and long_enough(h, begin):
        error = max(error, direction_error(c[N], size, y, y_new, errors, rtol, atol, largest))
    near = feature_step(c, t_new, y_new) if error <= 1.0 else 0.0
    if not h <= 2.0 * near:
        tally[REJECTED] += 1
        if not error <= 1.0:
            tally[WORST] = worst(count, errors)
        return shorter(h, error, near)
    forget_tiny(size, y_new)
    if count < size:
        remember_largest(c[N], size, y_new, largest)
    accept(clock, h, t_new, error, EXPONENT, DAMPING, proposal if clipped else 0.0, limit)
    tally[KNOWN] = 0 if jump else 2
    return 0.0


@inner
def one_step(c, clock, tally, size, count, y, k, y_new, rtol, atol, errors, largest):
    """Take one step with error control from y; return False if it would have to be too small."""
    t = clock[T]
    if clock[STEP] == 0.0:
        first_step(c, clock, tally, size, count, y, k, y_new, shift(k, size), rtol, atol)
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
        stages(c, t, t_new - t, size, y, k, y_new)
        tally[EVALUATIONS] += 6
        retry = accept_or_shorten(
            c, clock, tally, h, t_new, clipped, jump, size, count, y, k, y_new, rtol, atol, errors, largest, proposal,
            limit,
        )  # fmt: skip
        if retry == 0.0:
            return True
        limit, proposal = h, retry


@inner
def march(
    c, clock, tally, size, count, y, work, slots, spans, states, stages_of, rtol, atol, n_samples, times, rows, samples
):
    """Take steps of one run until enough are done or it cannot go on; return how it stands."""
    y_new, errors, largest = work, shift(work, size), shift(work, 2 * size)
    tally[DONE] = 0
    while True:
        slot = tally[SLOT]
        start, k = shift(states, slot * size), shift(stages_of, slot * 7 * size)
        if not write_samples(clock, tally, size, start, k, n_samples, times, rows, samples):
            return BUFFER_FULL
        status = state_before(clock, tally, tally[WANTED])
        if status != GO_ON:
            return status
        slot = tally[DONE] % slots
        tally[SLOT] = slot
        last = shift(k, 6 * size)
        start, k = shift(states, slot * size), shift(stages_of, slot * 7 * size)
        if tally[KNOWN] == 2:
            for i in independent(size):
                k[i] = last[i]
            tally[KNOWN] = 1
        for i in independent(size):
            start[i] = y[i]
        if not one_step(c, clock, tally, size, count, start, k, y_new, rtol, atol, errors, largest):
            return TOO_SMALL
        remember_step(clock, tally, spans)
        if tally[WATCH] != 0:
            watch(clock, tally, c[N], size, start, k, y_new, rtol, atol)
        for i in independent(size):
            y[i] = y_new[i]


@entry
def advance_one(call):
    """As `advance` of one run, whose arguments stand in one vector: addresses first, then numbers.

    To hand over fourteen arrays one by one takes Python as long as the loop takes for ten steps.
    """
    c = pointer(call)
    return march(
        ints(c[0]),
        floats(c[1]),
        ints(c[2]),
        c[12],
        c[13],
        floats(c[3]),
        floats(c[4]),
        c[14],
        floats(c[5]),
        floats(c[6]),
        floats(c[7]),
        floats(c[8]),
        floats(c[9]),
        c[15],
        floats(c[10]),
        c[16],
        floats(c[11]),
    )


@entry
def advance(numbers, clock, tally, y, work, store_t, store_y, store_k, rtol, atol, count, sample_t, sample_y):
    """Take steps of every run until enough are done, its end is reached, the buffer is full, or the step is too small.

    Where the tally says to watch, a run also stops when stability has limited many steps in a row.  How it stands
    goes into the tally; returned is how the last run stands.  Runs are rows of numbers, clock, tally and y, and
    sample_y is (runs, rows, size); they share the rest.

    The steps go one after another into store_t (slots, 2), store_y (slots, size) and store_k (slots, 7,
    size): begin and size, state at the begin, stages.  They are used in a circle: with one slot, samples are
    the only way to see between the steps.
    """
    size, rows, status = y.shape[1], sample_y.shape[1], MORE
    for r in range(y.shape[0]):
        counts = shift(pointer(tally), r * COUNTS)
        status = march(
            shift(pointer(numbers), r * numbers.shape[1]),
            shift(pointer(clock), r * TICKS),
            counts,
            size,
            count,
            shift(pointer(y), r * size),
            pointer(work),
            store_t.shape[0],
            pointer(store_t),
            pointer(store_y),
            pointer(store_k),
            pointer(rtol),
            pointer(atol),
            sample_t.size,
            pointer(sample_t),
            rows,
            shift(pointer(sample_y), r * rows * size),
        )
        counts[STATUS] = status
    return status
