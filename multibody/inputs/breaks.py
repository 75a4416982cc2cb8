"""Where a step has to end because of an input: jumps, corners and bends of a table."""

from __future__ import annotations

import numpy as np

__all__ = ["breaks", "rough"]

SMOOTH = 0.1
NONE = 0.1
STRIDE, LEVELS = 10, 5


def _uneven(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Tell where two slopes differ by more than rounding."""
    return np.abs(after - before) > 1e-9 * (np.abs(after) + np.abs(before))


def rough(
    times: np.ndarray, values: np.ndarray, slopes: np.ndarray, kinds: np.ndarray, tolerance: float = 0.0
) -> np.ndarray:
    """Mark the samples, shape (nt, n_u), where an input jumps or one of its first two derivatives does.

    With a tolerance, those of them at which a step of that accuracy must end.
    """
    marks = np.zeros(values.shape, dtype=bool)
    if len(times) < 2:
        return marks
    width = np.diff(times)
    even = bool(np.all(np.abs(width - width[0]) <= 1e-6 * width[0]))
    for c, kind in enumerate(kinds):
        column = np.ascontiguousarray(values[:, c])
        if kind == 0:
            marks[1:, c] = column[1:] != column[:-1]
            continue
        rise = np.diff(column) / width
        if not rise.any():
            continue
        if kind == 1:
            marks[:, c] = _uneven(np.append(0.0, rise), np.append(rise, 0.0))
            if tolerance > 0.0 and even and np.count_nonzero(marks[:, c]) > STRIDE:
                marks[:, c] &= ~_passed_over(column, tolerance)
        else:
            # Second derivatives of the cubic at the left and the right end of each interval.
            first, last = slopes[:-1, c], slopes[1:, c]
            left = (6.0 * rise - 4.0 * first - 2.0 * last) / width
            right = (2.0 * first + 4.0 * last - 6.0 * rise) / width
            marks[:, c] = _uneven(np.append(0.0, right), np.append(left, 0.0))
            marks[[0, -1], c] |= slopes[[0, -1], c] != 0.0
    return marks


def _passed_over(values: np.ndarray, tolerance: float) -> np.ndarray:
    """Mark the kinks of linear interpolation, shape (nt,), at which a step of a relative tolerance need not end.

    Where a smooth signal is sampled finely its kinks are only those of the interpolation, and a smooth curve
    through the samples is as good as the polygon. They may be passed over if the two differ by less than the
    tolerance, as a share of the signal's range. Finely means that a sine in the signal has at least ``2 π /
    sqrt(SMOOTH)`` samples to a period, which shows in fourth differences that are small compared with the second;
    noise, spikes, corners and bends do not look like that. One of ``STRIDE`` samples, half a period of that sine,
    still ends a step, so that no step jumps over a motion of the signal. The same holds for every second sample,
    every fourth and so on, as long as they too are fine: then steps end twice, four times as far apart. A motion
    counts as none where every sample lies within ``NONE`` times the tolerance of the cubic through samples half a
    stride and a stride away.
    """
    n = len(values)
    marks, row = np.zeros(n, dtype=bool), np.arange(n)
    smooth = np.ones(n, dtype=bool)
    extent = float(np.ptp(values))
    apart = np.abs(values[2:] - 2.0 * values[1:-1] + values[:-2]) / 8.0  # polygon and curve, in the middle of a side
    smooth[1:-1] = apart <= tolerance * extent
    for level in range(LEVELS):
        d = 2**level
        if 8 * d > n:
            break
        second, fourth = _differences(values, d)
        size = second.copy()  # the second difference passes through zero where the slope turns: the largest near by
        for shift in (d, 2 * d, 3 * d):
            np.maximum(size[shift:], second[:-shift], out=size[shift:])
            np.maximum(size[:-shift], second[shift:], out=size[:-shift])
        still = fourth <= SMOOTH * size
        if 2 * STRIDE * d < n:
            _, across = _differences(values, STRIDE * d // 2)
            still |= np.maximum(fourth, across) / 6.0 <= NONE * tolerance * extent
        fine = smooth & still
        smooth = fine.copy()  # on both sides as well
        smooth[d:] &= fine[:-d]
        smooth[:-d] &= fine[d:]
        if not smooth.any():
            break
        marks[smooth] = row[smooth] % (STRIDE * d) != 0
    return marks


def _differences(values: np.ndarray, d: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the sizes of second and fourth differences of every d-th value, centred, shape (nt,) each."""
    second, fourth = np.zeros(len(values)), np.full(len(values), np.inf)
    rise = values[d:] - values[:-d]
    bend = rise[d:] - rise[:-d]
    second[d:-d] = np.abs(bend)
    fourth[2 * d : -2 * d] = np.abs(bend[2 * d :] - 2.0 * bend[d:-d] + bend[: -2 * d])
    return second, fourth


def breaks(times: np.ndarray, marks: np.ndarray, kinds: np.ndarray, delays: np.ndarray) -> dict[str, np.ndarray]:
    """Collect for each delay the times at which a step must end."""
    instants, jumps, start, owner = [], [], [0], []
    for delay in np.unique(delays):
        own = marks[:, delays == delay]
        rows = np.flatnonzero(own.any(axis=1))
        if rows.size:
            instants.append(times[rows])
            jumps.append(own[rows][:, kinds[delays == delay] == 0].any(axis=1))
            start.append(start[-1] + rows.size)
            owner.append(delay)
    return {
        "breaks": np.concatenate(instants) if instants else np.zeros(0),
        "jumps": np.concatenate(jumps).astype(np.int64) if jumps else np.zeros(0, dtype=np.int64),
        "break_start": np.array(start, dtype=np.int64),
        "break_delay": np.array(owner, dtype=np.int64),
    }
