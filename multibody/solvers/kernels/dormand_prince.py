"""Many steps of the Dormand-Prince 5(4) pair in one call.

Coefficients: Dormand and Prince (1980), J. Comput. Appl. Math. 6, 19-26; interpolant of order 4: Shampine
(1986), Math. Comp. 46, 135-150; step control: Hairer, Norsett, Wanner, Solving Ordinary Differential
Equations I, IV.2.

Indices into ``clock`` (float64): time, proposed step, error of the last step, end, direction, largest step,
begin and size of the last accepted step.  Indices into ``tally`` (int64): steps wanted, steps done, rejected
steps, evaluations, next sample, first sample of the buffer, state of the largest error, whether the
derivative at y is known (0 no, 1 as stage 1, 2 as stage 7 of the last step), slot of the last step.
"""

from __future__ import annotations

import math

from multibody.solvers.kernels.calls import entry, inner
from multibody.solvers.kernels.field import evaluate, hold_at, next_jump

T, STEP, ERROR, END, DIRECTION, LARGEST, T_OLD, STEP_OLD = range(8)
WANTED, DONE, REJECTED, EVALUATIONS, SAMPLE, FIRST, WORST, KNOWN, SLOT = range(9)
MORE, FINISHED, BUFFER_FULL, TOO_SMALL = 0, 1, 2, -1


@inner
def stages(field, t, h, y, k, y_new):
    """Write stages 2 to 7 into k and the result into y_new; stage 1 is there already."""
    size = y.size
    k1, k2, k3, k4, k5, k6, k7 = k[0], k[1], k[2], k[3], k[4], k[5], k[6]
    for i in range(size):
        y_new[i] = y[i] + h * (1 / 5) * k1[i]
    evaluate(t + h / 5, y_new, k2, field)
    for i in range(size):
        y_new[i] = y[i] + h * ((3 / 40) * k1[i] + (9 / 40) * k2[i])
    evaluate(t + h * (3 / 10), y_new, k3, field)
    for i in range(size):
        y_new[i] = y[i] + h * ((44 / 45) * k1[i] - (56 / 15) * k2[i] + (32 / 9) * k3[i])
    evaluate(t + h * (4 / 5), y_new, k4, field)
    for i in range(size):
        y_new[i] = y[i] + h * (
            (19372 / 6561) * k1[i] - (25360 / 2187) * k2[i] + (64448 / 6561) * k3[i] - (212 / 729) * k4[i]
        )
    evaluate(t + h * (8 / 9), y_new, k5, field)
    for i in range(size):
        y_new[i] = y[i] + h * (
            (9017 / 3168) * k1[i]
            - (355 / 33) * k2[i]
            + (46732 / 5247) * k3[i]
            + (49 / 176) * k4[i]
            - (5103 / 18656) * k5[i]
        )
    evaluate(t + h, y_new, k6, field)
    for i in range(size):
        y_new[i] = y[i] + h * (
            (35 / 384) * k1[i]
            + (500 / 1113) * k3[i]
            + (125 / 192) * k4[i]
            - (2187 / 6784) * k5[i]
            + (11 / 84) * k6[i]
        )
    evaluate(t + h, y_new, k7, field)


@inner
def scaled_error(h, y, y_new, k, rtol, atol, count):
    """Return the root mean square of the scaled error over the first ``count`` components."""
    k1, k3, k4, k5, k6, k7 = k[0], k[2], k[3], k[4], k[5], k[6]
    total = 0.0
    for i in range(count):
        e = h * (
            (71 / 57600) * k1[i]
            - (71 / 16695) * k3[i]
            + (71 / 1920) * k4[i]
            - (17253 / 339200) * k5[i]
            + (22 / 525) * k6[i]
            - (1 / 40) * k7[i]
        )
        s = atol[i] + rtol[i] * max(abs(y[i]), abs(y_new[i]))
        total += (e / s) * (e / s)
    return math.sqrt(total / count)


@inner
def worst_component(h, y, y_new, k, rtol, atol, count):
    """Return the index of the largest scaled error; a component that is not finite wins."""
    worst, largest = 0, -1.0
    for i in range(count):
        e = h * (
            (71 / 57600) * k[0, i]
            - (71 / 16695) * k[2, i]
            + (71 / 1920) * k[3, i]
            - (17253 / 339200) * k[4, i]
            + (22 / 525) * k[5, i]
            - (1 / 40) * k[6, i]
        )
        e = abs(e) / (atol[i] + rtol[i] * max(abs(y[i]), abs(y_new[i])))
        if not math.isfinite(e):
            return i
        if e > largest:
            worst, largest = i, e
    return worst


@inner
def interpolate(z, h, y, k, out):
    """Write the state at the fraction z of a step into out."""
    z2 = z * z
    z3 = z2 * z
    z4 = z3 * z
    b1 = h * (
        z - (8048581381 / 2820520608) * z2 + (8663915743 / 2820520608) * z3 - (12715105075 / 11282082432) * z4
    )
    b3 = h * (
        (131558114200 / 32700410799) * z2
        - (68118460800 / 10900136933) * z3
        + (87487479700 / 32700410799) * z4
    )
    b4 = h * (
        -(1754552775 / 470086768) * z2 + (14199869525 / 1410260304) * z3 - (10690763975 / 1880347072) * z4
    )
    b5 = h * (
        (127303824393 / 49829197408) * z2
        - (318862633887 / 49829197408) * z3
        + (701980252875 / 199316789632) * z4
    )
    b6 = h * (-(282668133 / 205662961) * z2 + (2019193451 / 616988883) * z3 - (1453857185 / 822651844) * z4)
    b7 = h * ((40617522 / 29380423) * z2 - (110615467 / 29380423) * z3 + (69997945 / 29380423) * z4)
    k1, k3, k4, k5, k6, k7 = k[0], k[2], k[3], k[4], k[5], k[6]
    for i in range(out.size):
        out[i] = y[i] + (b1 * k1[i] + b3 * k3[i] + b4 * k4[i] + b5 * k5[i] + b6 * k6[i] + b7 * k7[i])


@inner
def write_samples(clock, tally, y, k, sample_t, sample_y):
    """Write the samples inside the last step; return False when the buffer is full before its end."""
    direction, t, t_old, h = clock[DIRECTION], clock[T], clock[T_OLD], clock[STEP_OLD]
    j = tally[SAMPLE]
    while j < sample_t.size and direction * (sample_t[j] - t) <= 0.0:
        row = j - tally[FIRST]
        if row == sample_y.shape[0]:
            tally[SAMPLE] = j
            return False
        interpolate((sample_t[j] - t_old) / h, h, y, k, sample_y[row])
        j += 1
    tally[SAMPLE] = j
    return True


@inner
def one_step(field, clock, tally, y, k, y_new, rtol, atol, count):
    """Take one step with error control from y; return False if it would have to be too small."""
    t, direction = clock[T], clock[DIRECTION]
    held = field.held.size > 0
    smallest = 10.0 * 2.220446049250313e-16 * abs(t) + 1e-300
    proposal = min(clock[STEP], clock[LARGEST])
    rejected = False
    while True:
        if not proposal >= smallest:
            return False
        h = proposal
        remaining = direction * (clock[END] - t)
        t_new = t + direction * h
        clipped = 1.01 * h >= remaining
        if clipped:
            h, t_new = remaining, clock[END]
        jump = False
        if held:
            edge = next_jump(t, direction, 1.01 * h, field)
            gap = direction * (edge - t)
            if gap <= 1.01 * h:
                jump = gap < remaining
                clipped = True
                h, t_new = gap, edge
            hold_at(t + 0.5 * direction * h, field)
        if tally[KNOWN] == 0:
            evaluate(t, y, k[0], field)
            tally[EVALUATIONS] += 1
            tally[KNOWN] = 1
        signed = t_new - t
        stages(field, t, signed, y, k, y_new)
        tally[EVALUATIONS] += 6
        error = scaled_error(signed, y, y_new, k, rtol, atol, count)
        if error <= 1.0:
            break
        rejected = True
        tally[REJECTED] += 1
        tally[WORST] = worst_component(signed, y, y_new, k, rtol, atol, count)
        proposal = h * max(0.2, 0.9 * error**-0.17) if math.isfinite(error) else 0.2 * h
    # A PI controller: 0.17 = 1/5 - 0.75*0.04 (Hairer and Wanner, II, IV.2).
    error = max(error, 1e-10)
    grown = h * min(10.0, max(0.2, 0.9 * error**-0.17 * clock[ERROR] ** 0.04))
    if rejected:
        grown = min(grown, h)
    elif clipped:
        grown = max(grown, proposal)
    clock[STEP] = grown
    clock[ERROR] = max(error, 1e-4)
    clock[T_OLD] = t
    clock[STEP_OLD] = signed
    clock[T] = t_new
    tally[KNOWN] = 0 if jump else 2
    return True


@entry
def advance(field, clock, tally, y, y_new, store_t, store_y, store_k, rtol, atol, count, sample_t, sample_y):
    """Take steps until enough are done, the end is reached, the sample buffer is full, or the step is too
    small.

    The steps go one after another into store_t, store_y, store_k (step's begin and size, state at its begin,
    stages), which are used in a circle: with one slot, samples are the only way to see between the steps.
    """
    slots = store_t.shape[0]
    size = y.size
    tally[DONE] = 0
    slot = tally[SLOT]
    while True:
        if sample_t.size > 0 and tally[SAMPLE] < sample_t.size:
            written = write_samples(clock, tally, store_y[slot], store_k[slot], sample_t, sample_y)
            if not written:
                tally[SLOT] = slot
                return BUFFER_FULL
        if clock[T] == clock[END]:
            tally[SLOT] = slot
            return FINISHED
        if tally[DONE] >= tally[WANTED]:
            tally[SLOT] = slot
            return MORE
        following = tally[DONE] % slots
        if tally[KNOWN] == 2:
            last, first = store_k[slot, 6], store_k[following, 0]
            for i in range(size):
                first[i] = last[i]
            tally[KNOWN] = 1
        slot = following
        start = store_y[slot]
        for i in range(size):
            start[i] = y[i]
        if not one_step(field, clock, tally, start, store_k[slot], y_new, rtol, atol, count):
            tally[SLOT] = slot
            return TOO_SMALL
        store_t[slot, 0] = clock[T_OLD]
        store_t[slot, 1] = clock[STEP_OLD]
        tally[DONE] += 1
        for i in range(size):
            y[i] = y_new[i]


@entry
def interpolate_many(t, direction, steps, store_t, store_y, store_k, out):
    """Write the states at the times t, each in the stored step that holds it, into the rows of out."""
    j = 0
    for i in range(t.size):
        while j > 0 and direction * (t[i] - store_t[j, 0]) < 0.0:
            j -= 1
        while j + 1 < steps and direction * (t[i] - store_t[j + 1, 0]) > 0.0:
            j += 1
        h = store_t[j, 1]
        interpolate((t[i] - store_t[j, 0]) / h, h, store_y[j], store_k[j], out[i])
