"""Batched runs of one structure: the explicit method's stages as SIMD vectors of one number for each run.

Every lane has a time, a step, inputs and an error of its own, so that each run takes the steps that it takes alone, to
the last bit.  Only the equations and the sums of the stages go through the lanes together; whatever decides about a
step does so for one lane after another, on plain vectors.  A lane whose run has ended takes the next one.
"""

from __future__ import annotations

import math

from multibody.compile.calls import call_batched, entry, floats, fused, independent, inner, pointer, shift
from multibody.solvers.kernels.dormand_prince import accept_or_shorten, march, watch, write_samples
from multibody.solvers.kernels.field import evaluate, look_up
from multibody.solvers.kernels.field_layout import N_P, N_U, SIZE, N, P, U
from multibody.solvers.kernels.stepping import (
    COUNTS,
    DONE,
    EVALUATIONS,
    GO_ON,
    KNOWN,
    LARGEST,
    STATUS,
    STEP,
    TICKS,
    TOO_SMALL,
    WANTED,
    WATCH,
    T,
    feature_step,
    first_step,
    plan,
    remember_step,
    state_before,
)

LANES = 4  # a vector of the common kind; eight are no faster for a lane (lift with 37 states: 0.43 and 0.45 µs)


@inner
def bring_inputs(times, numbers, run_of, wide_u):
    """Look up the inputs of every lane at its own time."""
    for lane in range(LANES):
        c = shift(numbers, run_of[lane] * SIZE)
        look_up(times[lane], c)
        u = floats(c[U])
        for j in range(c[N_U]):
            wide_u[j * LANES + lane] = u[j]


@fused
def batched_stages(address, numbers, run_of, begins, h, size, times, y, k, y_new, wide_u, wide_p):
    """As `stages` of a single run, for every lane with its own time and step."""
    wide = size * LANES
    k1, k2, k3 = k, shift(k, wide), shift(k, 2 * wide)
    k4, k5, k6, k7 = shift(k, 3 * wide), shift(k, 4 * wide), shift(k, 5 * wide), shift(k, 6 * wide)
    for i in range(size):
        for lane in independent(LANES):
            a = i * LANES + lane
            y_new[a] = y[a] + h[lane] * (1 / 5) * k1[a]
    for lane in range(LANES):
        times[lane] = begins[lane] + h[lane] / 5
    bring_inputs(times, numbers, run_of, wide_u)
    call_batched(address, times, y_new, wide_u, wide_p, k2)
    for i in range(size):
        for lane in independent(LANES):
            a = i * LANES + lane
            y_new[a] = y[a] + h[lane] * ((3 / 40) * k1[a] + (9 / 40) * k2[a])
    for lane in range(LANES):
        times[lane] = begins[lane] + h[lane] * (3 / 10)
    bring_inputs(times, numbers, run_of, wide_u)
    call_batched(address, times, y_new, wide_u, wide_p, k3)
    for i in range(size):
        for lane in independent(LANES):
            a = i * LANES + lane
            y_new[a] = y[a] + h[lane] * ((44 / 45) * k1[a] - (56 / 15) * k2[a] + (32 / 9) * k3[a])
    for lane in range(LANES):
        times[lane] = begins[lane] + h[lane] * (4 / 5)
    bring_inputs(times, numbers, run_of, wide_u)
    call_batched(address, times, y_new, wide_u, wide_p, k4)
    for i in range(size):
        for lane in independent(LANES):
            a = i * LANES + lane
            y_new[a] = y[a] + h[lane] * (
                (19372 / 6561) * k1[a] - (25360 / 2187) * k2[a] + (64448 / 6561) * k3[a] - (212 / 729) * k4[a]
            )
    for lane in range(LANES):
        times[lane] = begins[lane] + h[lane] * (8 / 9)
    bring_inputs(times, numbers, run_of, wide_u)
    call_batched(address, times, y_new, wide_u, wide_p, k5)
    for i in range(size):
        for lane in independent(LANES):
            a = i * LANES + lane
            y_new[a] = y[a] + h[lane] * (
                (9017 / 3168) * k1[a]
                - (355 / 33) * k2[a]
                + (46732 / 5247) * k3[a]
                + (49 / 176) * k4[a]
                - (5103 / 18656) * k5[a]
            )
    for lane in range(LANES):
        times[lane] = begins[lane] + h[lane]
    bring_inputs(times, numbers, run_of, wide_u)
    call_batched(address, times, y_new, wide_u, wide_p, k6)
    for i in range(size):
        for lane in independent(LANES):
            a = i * LANES + lane
            y_new[a] = y[a] + h[lane] * (
                (35 / 384) * k1[a]
                + (500 / 1113) * k3[a]
                + (125 / 192) * k4[a]
                - (2187 / 6784) * k5[a]
                + (11 / 84) * k6[a]
            )
    call_batched(address, times, y_new, wide_u, wide_p, k7)


@inner
def into_lane(count, plain, wide, lane):
    """Copy a plain vector into a lane."""
    for i in range(count):
        wide[i * LANES + lane] = plain[i]


@inner
def out_of_lanes(count, wide, first, apart):
    """Copy the lanes into plain vectors that lie so many numbers apart."""
    second, third, fourth = shift(first, apart), shift(first, 2 * apart), shift(first, 3 * apart)
    for i in independent(count):
        first[i] = wide[LANES * i]
        second[i] = wide[LANES * i + 1]
        third[i] = wide[LANES * i + 2]
        fourth[i] = wide[LANES * i + 3]


@inner
def begin_step(c, clock, tally, lane, size, y, k, y_new, wide_k, rtol, atol, proposals, limits):
    """Propose a step for the run in a lane, and write the rates at its begin there."""
    if clock[STEP] == 0.0:
        first_step(c, clock, tally, size, size, y, k, y_new, shift(k, size), rtol, atol)
        tally[KNOWN] = 1
        into_lane(size, k, wide_k, lane)
    if tally[KNOWN] == 2:
        into_lane(size, shift(k, 6 * size), wide_k, lane)
        tally[KNOWN] = 1
    proposals[lane] = min(min(clock[STEP], clock[LARGEST]), feature_step(c, clock[T], y))
    limits[lane] = math.inf


@inner
def end_step(c, clock, tally, lane, size, y, k, y_new, errors, rtol, atol, h, t_new, how, proposals, limits, spans):
    """Accept the step of a lane and return True, or propose a smaller one."""
    retry = accept_or_shorten(
        c, clock, tally, h, t_new, how % 2 == 1, how >= 2, size, size, y, k, y_new, rtol, atol, errors, errors,
        proposals[lane], limits[lane],
    )  # fmt: skip
    if retry != 0.0:
        limits[lane], proposals[lane] = h, retry
        return False
    remember_step(clock, tally, spans)
    if tally[WATCH] != 0:
        watch(clock, tally, c[N], size, y, k, y_new, rtol, atol)
    return True


@inner
def take_run(c, lane, size, y, last, start, k, wide_y, wide_p):
    """Put a run into a lane."""
    for i in range(size):
        start[i] = y[i]
        k[6 * size + i] = last[i]
    into_lane(size, y, wide_y, lane)
    into_lane(c[N_P], floats(c[P]), wide_p, lane)


@inner
def give_back(size, start, k, y, last):
    """Write the state of a run, and the rates there if they are known, where it came from."""
    for i in range(size):
        y[i] = start[i]
        last[i] = k[6 * size + i]


@inner
def ended(ticks, counts):
    """Tell whether a run is not to be gone on with, and note how it stands."""
    status = state_before(ticks, counts, counts[WANTED])
    if status != GO_ON:
        counts[STATUS] = status
    return status != GO_ON


@entry
def advance_batched(
    address,
    numbers,
    clock,
    tally,
    y,
    last,
    work,
    store_t,
    store_y,
    store_k,
    rtol,
    atol,
    times,
    samples,
    place,
    wide,
    steps,
    lanes,
):
    """Integrate every run to its end, or as far as it goes by itself; how it stands goes into its tally.

    ``address`` is that of the equations in lanes. Runs are rows of numbers, clock, tally and y, as in `advance`, and of
    last, their rates at the end of the step before; ``place`` tells which row of samples is whose. Lanes are rows of
    store_t (·, 2), store_y (·, size) and store_k (·, 7, size), and columns of ``steps`` (6, ·) and ``lanes`` (4, ·),
    which hold what is known of their steps. ``wide`` has room for state, new state, stages, inputs and parameters in
    lanes: 9 size + n_u + n_p rows.
    """
    runs, size, rows = y.shape[0], y.shape[1], times.size
    fields, clocks, tallies, states, rates = pointer(numbers), pointer(clock), pointer(tally), pointer(y), pointer(last)
    sample_t, relative, absolute = pointer(times), pointer(rtol), pointer(atol)
    y_new, errors = pointer(work), shift(pointer(work), size)
    wide_y = pointer(wide)
    wide_new, wide_k = shift(wide_y, size * LANES), shift(wide_y, 2 * size * LANES)
    wide_u = shift(wide_y, 9 * size * LANES)
    wide_p = shift(wide_u, fields[N_U] * LANES)
    h, begins, ends = pointer(steps), shift(pointer(steps), LANES), shift(pointer(steps), 2 * LANES)
    whole, proposals = shift(pointer(steps), 3 * LANES), shift(pointer(steps), 4 * LANES)
    limits, at = shift(pointer(steps), 5 * LANES), shift(pointer(steps), 6 * LANES)
    run_of, busy = pointer(lanes), shift(pointer(lanes), LANES)
    again, how = shift(pointer(lanes), 2 * LANES), shift(pointer(lanes), 3 * LANES)
    running, following = 0, 0
    for lane in range(LANES):  # a lane without a run goes through the equations with the first one's numbers
        run_of[lane], busy[lane], again[lane], h[lane], begins[lane] = 0, 0, 0, 0.0, 0.0
        start, k = shift(pointer(store_y), lane * size), shift(pointer(store_k), lane * 7 * size)
        take_run(fields, lane, size, states, rates, start, k, wide_y, wide_p)
        for i in range(7 * size):
            wide_k[i * LANES + lane] = 0.0
    while True:
        for lane in range(LANES):
            r, start, k = run_of[lane], shift(pointer(store_y), lane * size), shift(pointer(store_k), lane * 7 * size)
            c, ticks, counts = shift(fields, r * SIZE), shift(clocks, r * TICKS), shift(tallies, r * COUNTS)
            if busy[lane] != 0 and again[lane] == 0 and ended(ticks, counts):
                give_back(size, start, k, shift(states, r * size), shift(rates, r * size))
                busy[lane], h[lane] = 0, 0.0
                running -= 1
            while busy[lane] == 0 and following < runs:
                r, run_of[lane], again[lane] = following, following, 0
                following += 1
                c, ticks, counts = shift(fields, r * SIZE), shift(clocks, r * TICKS), shift(tallies, r * COUNTS)
                take_run(c, lane, size, shift(states, r * size), shift(rates, r * size), start, k, wide_y, wide_p)
                counts[DONE] = 0
                if not ended(ticks, counts):
                    busy[lane] = 1
                    running += 1
        if running == 0:
            return
        for lane in range(LANES):
            if busy[lane] == 0:
                continue
            r, start, k = run_of[lane], shift(pointer(store_y), lane * size), shift(pointer(store_k), lane * 7 * size)
            c, ticks, counts = shift(fields, r * SIZE), shift(clocks, r * TICKS), shift(tallies, r * COUNTS)
            spans = shift(pointer(store_t), 2 * lane)
            sample_y = shift(pointer(samples), place[r] * rows * size)
            # Alone it is faster in plain numbers; every eighth step is one at which stiffness is looked for.
            if running == 1 and following == runs and again[lane] == 0 and counts[DONE] % 8 == 0:
                left, before = shift(states, r * size), counts[DONE]
                give_back(size, start, k, left, shift(rates, r * size))
                counts[WANTED] -= before
                counts[STATUS] = march(
                    c,
                    ticks,
                    counts,
                    size,
                    size,
                    left,
                    pointer(work),
                    1,
                    spans,
                    start,
                    k,
                    relative,
                    absolute,
                    rows,
                    sample_t,
                    rows,
                    sample_y,
                )
                counts[WANTED] += before
                counts[DONE] += before
                give_back(size, left, k, left, shift(rates, r * size))
                return
            if again[lane] == 0:
                begin_step(c, ticks, counts, lane, size, start, k, y_new, wide_k, relative, absolute, proposals, limits)
            whole[lane], ends[lane], clipped, jump = plan(c, ticks, proposals[lane])
            how[lane] = (1 if clipped else 0) + (2 if jump else 0)
            if whole[lane] == 0.0:
                counts[STATUS] = TOO_SMALL
                busy[lane], h[lane] = 0, 0.0
                running -= 1
                continue
            if counts[KNOWN] == 0:
                evaluate(ticks[T], start, k, c)
                counts[EVALUATIONS] += 1
                counts[KNOWN] = 1
                into_lane(size, k, wide_k, lane)
            begins[lane] = ticks[T]
            h[lane] = ends[lane] - ticks[T]
        batched_stages(address, fields, run_of, begins, h, size, at, wide_y, wide_k, wide_new, wide_u, wide_p)
        out_of_lanes(7 * size, wide_k, pointer(store_k), 7 * size)
        out_of_lanes(size, wide_new, shift(pointer(work), 3 * size), size)
        for lane in range(LANES):
            if busy[lane] == 0:
                continue
            r, start, k = run_of[lane], shift(pointer(store_y), lane * size), shift(pointer(store_k), lane * 7 * size)
            c, ticks, counts = shift(fields, r * SIZE), shift(clocks, r * TICKS), shift(tallies, r * COUNTS)
            y_new = shift(pointer(work), (3 + lane) * size)
            counts[EVALUATIONS] += 6
            accepted = end_step(
                c,
                ticks,
                counts,
                lane,
                size,
                start,
                k,
                y_new,
                errors,
                relative,
                absolute,
                whole[lane],
                ends[lane],
                how[lane],
                proposals,
                limits,
                shift(pointer(store_t), 2 * lane),
            )
            again[lane] = 0 if accepted else 1
            if accepted:
                sample_y = shift(pointer(samples), place[r] * rows * size)
                write_samples(ticks, counts, size, start, k, rows, sample_t, rows, sample_y)
                for i in independent(size):
                    start[i] = y_new[i]
                into_lane(size, y_new, wide_y, lane)
