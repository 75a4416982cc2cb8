"""Readings and inputs on one time axis: several rates, gaps and delays."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estimation.filters.errors import FilterError

__all__ = ["FilterSamples", "TimeSeries"]


@dataclass(frozen=True)
class TimeSeries:
    """Readings of one output, or values of one input, with their own instants.

    Parameters
    ----------
    times : ndarray, shape (k,), s
        Increasing stamps.
    values : ndarray, shape (k,)
        NaN where a reading is missing.
    delay : float, s
        Delay of the values: those stamped t belong to t − delay.
    """

    times: np.ndarray
    values: np.ndarray
    delay: float = 0.0


@dataclass(frozen=True, eq=False)
class FilterSamples:
    """Instants, inputs and readings for a filter, one row each.

    Parameters
    ----------
    times : ndarray, shape (k,), s
        Increasing; steps may differ.
    inputs : ndarray, shape (k, n_u)
    readings : ndarray, shape (k, m)
        NaN where nothing was read.

    Raises
    ------
    FilterError
        With every fault.
    """

    times: np.ndarray
    inputs: np.ndarray
    readings: np.ndarray

    def __post_init__(self) -> None:
        arrays = {
            "times": np.ascontiguousarray(self.times, dtype=float),
            "inputs": np.ascontiguousarray(self.inputs, dtype=float),
            "readings": np.ascontiguousarray(self.readings, dtype=float),
        }
        for name in ("inputs", "readings"):
            if arrays[name].ndim == 1:
                arrays[name] = arrays[name][:, None]
        faults = []
        times = arrays["times"]
        if times.ndim != 1 or times.size < 1:
            faults.append("times must be one row of instants")
        else:
            wrong = np.flatnonzero(~(np.diff(times) > 0.0))
            if wrong.size:
                k = int(wrong[0])
                faults.append(
                    f"time does not go on from row {k} ({times[k]:.6g} s) to row {k + 1} ({times[k + 1]:.6g} s): "
                    "sort the rows and leave repeated ones out"
                )
            for name in ("inputs", "readings"):
                if len(arrays[name]) != times.size:
                    faults.append(f"{name} has {len(arrays[name])} rows, there are {times.size} instants")
        missing = np.flatnonzero(~np.isfinite(arrays["inputs"]).all(axis=1))
        if missing.size:
            faults.append(
                f"an input is missing in {missing.size} rows, the first row {missing[0]}: an input must be known "
                "everywhere; fill it in, or make it a latent quantity"
            )
        if np.isinf(arrays["readings"]).any():
            faults.append("a reading is infinite: write NaN for a reading that is missing")
        if faults:
            raise FilterError("samples", faults)
        for name, value in arrays.items():
            object.__setattr__(self, name, value)

    @classmethod
    def merged(
        cls,
        channels: Mapping[str, TimeSeries],
        inputs: Mapping[str, TimeSeries] | None = None,
        *,
        every: float | None = None,
    ) -> FilterSamples:
        """Bring channels of different rates and delays onto one time axis: the union of their instants.

        A delayed reading moves to its stamp minus its delay; inputs are interpolated
        linearly.  This is exact for a known, constant delay as long as the record is filtered afterwards, not
        while it is being made.

        Parameters
        ----------
        channels, inputs : mapping of str to TimeSeries
            In the order of the measured outputs, and of the machine's inputs.
        every : float, s, optional
            Longest step: instants without readings are put in between.

        Examples
        --------
        >>> fast = TimeSeries(np.arange(4) * 0.1, np.zeros(4))
        >>> slow = TimeSeries(np.array([0.12, 0.32]), np.ones(2), delay=0.02)
        >>> FilterSamples.merged({"a": fast, "b": slow}).readings.T
        array([[ 0.,  0.,  0.,  0.],
               [nan,  1., nan,  1.]])
        """
        own = [(np.asarray(c.times, float) - c.delay, np.asarray(c.values, float)) for c in channels.values()]
        given = [(np.asarray(c.times, float) - c.delay, np.asarray(c.values, float)) for c in (inputs or {}).values()]
        low = max((t[0] for t, _ in given), default=-np.inf)
        high = min((t[-1] for t, _ in given), default=np.inf)
        stamps = np.sort(np.concatenate([t for t, _ in own]))
        steps = np.diff(stamps)
        near = 1e-6 * float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else 0.0
        times = stamps[np.append(True, steps > near)]
        times = times[(times >= low - near) & (times <= high + near)]
        if times.size == 0:
            raise FilterError("samples", ["inputs and readings have no time in common"])
        if every is not None:
            parts = [
                np.linspace(a, b, int(np.ceil((b - a) / every - 1e-9)), endpoint=False)
                for a, b in itertools.pairwise(times)
            ]
            times = np.concatenate([*parts, times[-1:]])
        readings = np.full((times.size, len(own)), np.nan)
        for column, (t, values) in enumerate(own):
            row = np.searchsorted(times, t - near)
            inside = row < times.size
            inside[inside] &= np.abs(times[row[inside]] - t[inside]) <= near
            readings[row[inside], column] = values[inside]
        columns = [np.interp(times, t, values) for t, values in given]
        table = np.column_stack(columns) if columns else np.zeros((times.size, 0))
        return cls(times, table, readings)

    @property
    def count(self) -> int:
        """Number of rows."""
        return int(self.times.size)
