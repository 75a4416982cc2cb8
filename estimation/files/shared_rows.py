"""Recordings that hold the same measurement: a copy, a part of another file, the same noise under other numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimation.files.record import Record

__all__ = ["near_copies", "shared_rows"]

#: Rows in a run that must agree before two records count as sharing them.  Each must be able to change: with one
#: channel that toggles between two levels, a run of 32 agrees by chance once in 4e9 pairs of rows.
RUN = 32
#: Share of steps within such a run in which something changes: a machine at rest repeats itself.
CHANGING = 0.5
#: Share of the shorter record that must be shared: fewer rows are neither evidence nor a leak.
LEAST_SHARE = 0.01
#: Correlation of the third differences (which are mostly noise) above which two channels have the same noise.
SAME_NOISE = 0.8
#: Pairs of records times samples that are searched for equal noise; beyond that the search would take minutes.
MOST_SAMPLES = 200_000_000


@dataclass(frozen=True, kw_only=True)
class SharedRows:
    """Two records that hold the same rows.

    Attributes
    ----------
    first, second : int
        Places of the records.
    rows : int
        How many rows of the second are in the first.
    start, stop : float, s
        Where they are in the second, by its own time.
    """

    first: int
    second: int
    rows: int
    start: float
    stop: float


def shared_rows(
    records: Sequence[Record], signals: Sequence[str], pairs: Sequence[tuple[int, int]] | None = None
) -> list[SharedRows]:
    """Return the pairs of records that share rows, whatever their files, times and other columns are.

    Parameters
    ----------
    records : sequence of Record
    signals : sequence of str
        What was measured; what was commanded may well be the same twice.
    pairs : sequence of (int, int), optional
        Places of the records to compare; default: all.
    """
    runs = [_runs(_values(record, signals)) for record in records]
    if pairs is None:
        pairs = [(i, j) for j in range(len(records)) for i in range(j)]
    group = _groups(runs)
    shared = []
    for i, j in pairs:
        if group[i] != group[j]:
            continue
        same = np.flatnonzero(np.isin(runs[j], runs[i][runs[i] != 0]))
        covered = np.zeros(len(records[j].time), dtype=bool)
        for start in same:
            covered[start : start + RUN] = True
        rows = int(covered.sum())
        if rows < LEAST_SHARE * min(len(records[i].time), len(records[j].time)):
            continue
        where = records[j].time[covered]
        shared.append(SharedRows(first=i, second=j, rows=rows, start=float(where[0]), stop=float(where[-1])))
    return shared


def _groups(runs: Sequence[np.ndarray]) -> list[int]:
    """Return a number for each record, the same for those that share a run of rows, directly or through others."""
    owners = np.concatenate([np.full(len(run), place, dtype=np.int32) for place, run in enumerate(runs)])
    every = np.concatenate(list(runs))
    owners, every = owners[every != 0], every[every != 0]
    order = np.argsort(every, kind="stable")
    owners, every = owners[order], every[order]
    meet = np.flatnonzero((every[1:] == every[:-1]) & (owners[1:] != owners[:-1]))
    group = list(range(len(runs)))
    for i, j in np.unique(np.column_stack([owners[meet], owners[meet + 1]]), axis=0).tolist():
        group = [group[i] if g == group[j] else g for g in group]
    return group


def _values(record: Record, signals: Sequence[str]) -> np.ndarray:
    """Return the measured numbers in single precision, in which a change of units leaves no trace."""
    columns = [np.asarray(record.signals[name].values, dtype=np.float32) for name in signals]
    return np.column_stack(columns) + np.float32(0.0)  # no negative zeros


def _runs(values: np.ndarray) -> np.ndarray:
    """Return a number for each run of rows; zero where too little changes within it."""
    count = len(values) - RUN + 1
    if count < 1:
        return np.zeros(0, dtype=np.uint64)
    bits = np.ascontiguousarray(values).view(np.uint32).astype(np.uint64)
    rows = np.zeros(len(values), dtype=np.uint64)
    for column in bits.T:
        rows = _mixed(rows + column + np.uint64(0x9E3779B97F4A7C15))
    run = np.zeros(count, dtype=np.uint64)
    for k in range(RUN):
        run = run * np.uint64(0xD1342543DE82EF95) + rows[k : k + count]
    changes = np.concatenate(([0], np.cumsum(rows[1:] != rows[:-1])))
    changing = changes[RUN - 1 :] - changes[:count] >= CHANGING * (RUN - 1)
    return np.where(changing, run, np.uint64(0))


def _mixed(x: np.ndarray) -> np.ndarray:
    """Return well mixed 64-bit numbers (the finaliser of splitmix64, Steele et al. 2014)."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


def near_copies(
    records: Sequence[Record], signals: Sequence[str], pairs: Sequence[tuple[int, int]]
) -> list[tuple[int, int]] | None:
    """Return the pairs of records whose channels have the same noise: copies that were rounded, scaled or cut anew.

    Third differences of a channel are mostly its noise, and the noise of two measurements is unrelated.  So their
    largest correlation over all shifts tells a copy from a repetition.

    Parameters
    ----------
    records : sequence of Record
    signals : sequence of str
        What was measured.
    pairs : sequence of (int, int)
        Places of the records to compare.

    Returns
    -------
    list of (int, int), or None
        None where there are too many samples to search.
    """
    if sum(len(records[i].time) + len(records[j].time) for i, j in pairs) * len(signals) > MOST_SAMPLES:
        return None
    return [(i, j) for i, j in pairs if all(_same_noise(records[i], records[j], name) for name in signals)]


def _same_noise(a: Record, b: Record, name: str) -> bool:
    from scipy.signal import correlate

    x, y = (np.diff(np.asarray(r.signals[name].values, dtype=float), n=3) for r in (a, b))
    if len(y) > len(x):
        x, y = y, x
    if len(y) < RUN or not np.any(y) or not np.any(x):
        return False
    # the energy of each part of the longer one that the shorter one is laid over, whole overlaps only
    energy = _moving_sum(x**2, len(y))
    together = correlate(x, y, mode="valid", method="fft")
    return bool(np.max(np.abs(together) / np.sqrt(np.maximum(energy * (y @ y), 1e-300))) > SAME_NOISE)


def _moving_sum(values: np.ndarray, length: int) -> np.ndarray:
    total = np.concatenate(([0.0], np.cumsum(values)))
    return total[length:] - total[:-length]
