"""Fixed steps of Dormand and Prince's formulas over many short intervals, for discrete transitions."""

from __future__ import annotations

from multibody.solvers.kernels.bundle import SHAPE_T, M, N
from multibody.solvers.kernels.calls import entry, floats, inner, pointer, shift
from multibody.solvers.kernels.dormand_prince import stages
from multibody.solvers.kernels.field import evaluate
from multibody.solvers.kernels.stepping import END, T, passing, plan


@inner
def cross(c, clock, substep, size, y, k, y_new):
    """Carry y from the clock's time to its end in steps of at most ``substep``; return their number."""
    count, known = 0, False
    last = shift(k, 6 * size)
    while clock[T] < clock[END]:
        h, t_new, _, jump = plan(c, clock, min(substep, passing(c, clock[T], y)))
        if h == 0.0:
            return count
        if known:
            for i in range(size):
                k[i] = last[i]
        else:
            evaluate(clock[T], y, k, c)
        stages(c, clock[T], t_new - clock[T], size, y, k, y_new)
        for i in range(size):
            y[i] = y_new[i]
        clock[T] = t_new
        known = not jump
        count += 1
    return count


@entry
def transition_blocks(numbers, clock, times, states, substep, y, k, y_new, start, out, ends):
    """Write the directions' columns that begin as ``start`` at the end of every interval into out.

    Steps in interval i are at most ``substep[i]``; where that is zero the interval is left out.  The inputs' tangents
    are given at the two ends of an interval, whose times go into the field's grid; ``ends`` gets the states.
    """
    c = pointer(numbers)
    n, size = c[N], c[N] * (c[M] + 1)
    grid, ticks, vector = floats(c[SHAPE_T]), pointer(clock), pointer(y)
    stage, result = pointer(k), pointer(y_new)
    for i in range(times.size - 1):
        if substep[i] == 0.0:
            continue
        grid[0], grid[1] = times[i], times[i + 1]
        clock[T], clock[END] = times[i], times[i + 1]
        for j in range(n):
            y[j] = states[i, j]
        for j in range(n, size):
            y[j] = start[j - n]
        cross(c, ticks, substep[i], size, vector, stage, result)
        for j in range(n):
            ends[i, j] = y[j]
        for j in range(n, size):
            out[i, j - n] = y[j]
