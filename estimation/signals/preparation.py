"""Preparing signals: window, zero-phase low-pass, decimation, smoothed derivatives and blocks.

Everything here is linear in the values and treats record and model alike, so that a residual of prepared
signals is the prepared residual.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

__all__ = ["Preparation", "SignalError", "cut_blocks", "edge_time", "low_pass", "smooth_derivative"]

_ORDER = 4
_DECIMATION_MARGIN = 0.8
"""Share of the new Nyquist frequency at which the low-pass of a decimation is set when none is given."""

_MANY, _ROWS = 256, 32  # columns from which matrices replace the filter, and the rows of each
_SHORT = (1024, 2048, 4096)  # samples of which matrices are made, if the filter's reach allows it; chosen
_LEAST_WEIGHT = 1e-13


class SignalError(ValueError):
    """A signal cannot be prepared with these settings."""


def _step(time: np.ndarray) -> float:
    """Step of an evenly sampled time axis, s."""
    if len(time) < 2:
        raise SignalError("a signal needs at least two samples")
    steps = np.diff(time)
    step = float((time[-1] - time[0]) / (len(time) - 1))
    if not (step > 0.0 and np.all(np.abs(steps / step - 1.0) <= 0.25)):
        raise SignalError(
            f"time is not evenly sampled (steps from {steps.min():.4g} to {steps.max():.4g} s): resample it first"
        )
    return step


def _design(cutoff_hz: float, step: float) -> np.ndarray:
    nyquist = 0.5 / step
    if not 0.0 < cutoff_hz < nyquist:
        raise SignalError(
            f"low_pass_hz = {cutoff_hz:g} Hz must lie between 0 and half the sampling rate, {nyquist:g} Hz"
        )
    return _butterworth(cutoff_hz / nyquist)


@lru_cache(maxsize=32)
def _butterworth(relative: float) -> np.ndarray:
    from scipy.signal import butter

    return np.asarray(butter(_ORDER, relative, output="sos"))


def edge_time(cutoff_hz: float) -> float:
    """Time at each end that the low-pass's padding may touch by more than 1 %, s.

    The slowest pole of a Butterworth low-pass of order 4 has the real part −2π f_c sin(π/8); the padding's
    influence has decayed to 1 % after ln(100) of its time constants.
    """
    return float(np.log(100.0) / (2.0 * np.pi * cutoff_hz * np.sin(np.pi / (2 * _ORDER))))


def low_pass(time: np.ndarray, values: np.ndarray, cutoff_hz: float) -> np.ndarray:
    """Filter forwards and backwards with a Butterworth low-pass, without shift in time.

    Run twice, the order is 8 and the gain at ``cutoff_hz`` is 1/2 (−6 dB).

    Parameters
    ----------
    time : ndarray, shape (n,), s
        Even time stamps.
    values : ndarray, shape (n,) or (n, k)
    cutoff_hz : float, Hz

    Raises
    ------
    SignalError
        If the cutoff is not below half the sampling rate, or time is uneven.
    """
    from scipy.signal import sosfiltfilt

    step = _step(time)
    sos = _design(cutoff_hz, step)
    # Long enough for the padding to settle, as far as there are samples to mirror.
    pad = min(len(time) - 1, int(np.ceil(2.0 * edge_time(cutoff_hz) / step)))
    return np.asarray(sosfiltfilt(sos, values, axis=0, padtype="odd", padlen=pad))


@lru_cache(maxsize=32)
def _decimation(count: int, cutoff: float, edge: int, decimate: int) -> list[tuple[slice, np.ndarray]] | None:
    """Return low-pass and decimation of ``count`` samples as matrices, each with the samples that it takes.

    Filtering is linear: for hundreds of columns, of which one sample in several is kept, products with what the filter
    does to single samples are many times cheaper.  Far from both ends that is the same everywhere, so that the matrices
    of a short signal are those of a long one, the middle one repeated.

    None where the filter reaches too far for that.

    Parameters
    ----------
    count, edge, decimate : int
    cutoff : float
        As a share of half the sampling rate.
    """
    step = _ROWS * decimate
    for most in _SHORT:
        repeated = max(0, -(-(count - most) // step))
        short = count - repeated * step
        if short <= 2 * edge + step:
            continue
        parts = _matrices(short, cutoff, edge, decimate)
        middle = len(parts) // 2
        rows, weights = parts[middle]
        if not repeated:
            return parts
        if rows.start > 0 and rows.stop < short:
            between = [(_later(rows, k * step), weights) for k in range(repeated)]
            return [*parts[:middle], *between, *((_later(r, repeated * step), w) for r, w in parts[middle:])]
    return None


def _later(rows: slice, samples: int) -> slice:
    return slice(rows.start + samples, rows.stop + samples)


def _matrices(count: int, cutoff: float, edge: int, decimate: int) -> list[tuple[slice, np.ndarray]]:
    """Return the same of a short signal, `_ROWS` rows each, from the filter's response to every sample.

    Samples from which less than `_LEAST_WEIGHT` of the largest share comes are left out.
    """
    time, kept = np.arange(count, dtype=float), slice(edge, count - edge, decimate)
    # few at a time: the filter makes copies
    units = (np.eye(count, min(_MANY, count - a), -a) for a in range(0, count, _MANY))
    whole = np.hstack([low_pass(time, some, 0.5 * cutoff)[kept] for some in units])
    counts = np.abs(whole) > _LEAST_WEIGHT * np.max(np.abs(whole))
    first, last = np.argmax(counts, axis=1), count - np.argmax(counts[:, ::-1], axis=1)
    parts = []
    for a in range(0, len(whole), _ROWS):
        part = slice(a, min(a + _ROWS, len(whole)))
        rows = slice(int(first[part].min()), int(last[part].max()))
        parts.append((rows, np.ascontiguousarray(whole[part, rows])))
    return parts


@dataclass(frozen=True, kw_only=True)
class Preparation:
    """Window, low-pass and decimation of a signal before it is compared, the same for record and model.

    The order is: window, low-pass, removal of the edges, decimation, averaging.

    Attributes
    ----------
    start, stop : float, optional, s
        Window, in the record's own time, both ends included.
    low_pass_hz : float, optional, Hz
        Cutoff of the zero-phase low-pass; see :func:`low_pass`.
    decimate : int
        Keep every such sample.  Without ``low_pass_hz`` a low-pass at 0.8 of the new Nyquist frequency is
        applied.
    edge : float, optional, s
        Time left out at each end after filtering; default is :func:`edge_time`, or none without a filter.
    average : int
        Replace so many samples that follow each other by their mean.  Nothing is left out, white noise stays white,
        and what changes slowly is known as well as from all samples.

    Raises
    ------
    SignalError
        If the settings contradict each other.
    """

    start: float | None = None
    stop: float | None = None
    low_pass_hz: float | None = None
    decimate: int = 1
    edge: float | None = None
    average: int = 1

    def __post_init__(self) -> None:
        faults = []
        if self.average != int(self.average) or self.average < 1:
            faults.append(f"average = {self.average} must be a whole number, 1 or more")
        if self.start is not None and self.stop is not None and not self.start < self.stop:
            faults.append(f"start = {self.start:g} s must come before stop = {self.stop:g} s")
        if self.decimate != int(self.decimate) or self.decimate < 1:
            faults.append(f"decimate = {self.decimate} must be a whole number, 1 or more")
        if self.low_pass_hz is not None and not self.low_pass_hz > 0.0:
            faults.append(f"low_pass_hz = {self.low_pass_hz:g} must be positive")
        if self.edge is not None and not self.edge >= 0.0:
            faults.append(f"edge = {self.edge:g} s must not be negative")
        if faults:
            raise SignalError("; ".join(faults))

    def cutoff(self, rate: float) -> float | None:
        """Cutoff that is applied at a sampling rate, Hz; None without a filter.

        Raises
        ------
        SignalError
            If decimation would fold frequencies that the low-pass lets through.
        """
        if self.decimate == 1:
            return self.low_pass_hz
        nyquist = 0.5 * rate / self.decimate
        if self.low_pass_hz is None:
            return _DECIMATION_MARGIN * nyquist
        if self.low_pass_hz > nyquist * (1.0 + 1e-6):
            raise SignalError(
                f"decimate = {self.decimate} leaves {2.0 * nyquist:.4g} Hz, and low_pass_hz = "
                f"{self.low_pass_hz:g} lets more than half of that through (aliasing): use low_pass_hz ≤ "
                f"{nyquist:.4g} or decimate less"
            )
        return self.low_pass_hz

    def edge_samples(self, rate: float) -> int:
        """Samples left out at each end, before decimation, at a sampling rate in Hz."""
        cutoff = self.cutoff(rate)
        edge = self.edge if self.edge is not None else (0.0 if cutoff is None else edge_time(cutoff))
        return int(np.ceil(edge * rate - 1e-9))

    def apply(self, time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Prepare a signal.

        Parameters
        ----------
        time : ndarray, shape (n,), s
        values : ndarray, shape (n,) or (n, k)

        Returns
        -------
        tuple of ndarray
            Time and values that are left.

        Raises
        ------
        SignalError
            If nothing is left, sampling is uneven where a filter is asked for, or decimation would alias.
        """
        time, values = self._filtered(time, values)
        if self.average == 1:
            return time, values
        count = len(time) // self.average
        if count < 2:
            raise SignalError(f"{len(time)} samples are too few for means over {self.average}")
        used = count * self.average
        return (
            time[:used].reshape(count, -1).mean(axis=1),
            values[:used].reshape(count, self.average, *values.shape[1:]).mean(axis=1),
        )

    def _filtered(self, time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Apply everything but the averaging."""
        inside = np.ones(len(time), dtype=bool)
        # Half a microstep of slack, so that 'stop = 0.3' keeps a stamp that was summed to
        # 0.30000000000000004.
        slack = 1e-6 * float(np.median(np.diff(time))) if len(time) > 1 else 0.0
        if self.start is not None:
            inside &= time >= self.start - slack
        if self.stop is not None:
            inside &= time <= self.stop + slack
        time, values = np.asarray(time, dtype=float), np.asarray(values, dtype=float)
        if not np.all(inside):
            time, values = time[inside], values[inside]
        if len(time) < 2:
            raise SignalError(f"fewer than two samples between start = {self.start} and stop = {self.stop} s")
        if self.low_pass_hz is None and self.decimate == 1 and self.edge is None:
            return time.copy(), values.copy()
        rate = 1.0 / _step(time)
        cutoff = self.cutoff(rate)
        edge = self.edge_samples(rate)
        kept = slice(edge, len(time) - edge, self.decimate)
        if len(time) - 2 * edge < 2 * self.decimate:
            if cutoff is not None:
                low_pass(time, values, cutoff)  # raises where the filter itself is at fault
            raise SignalError(
                f"{len(time)} samples are too few: {edge} are left out at each end and one in {self.decimate} kept"
            )
        if cutoff is None:
            return time[kept].copy(), values[kept].copy()
        if values.ndim == 2 and values.shape[1] > _MANY and self.decimate > 1:
            parts = _decimation(len(time), round(2.0 * cutoff / rate, 12), edge, self.decimate)
            if parts is not None:
                return time[kept], np.concatenate([weights @ values[rows] for rows, weights in parts])
        return time[kept], low_pass(time, values, cutoff)[kept]

    def describe(self, rate: float) -> tuple[str, ...]:
        """Describe the steps for a record of this sampling rate (Hz), for its log."""
        lines = []
        if self.start is not None or self.stop is not None:
            lines.append(
                f"window from {self.start if self.start is not None else 'start'} to "
                f"{self.stop if self.stop is not None else 'end'} s"
            )
        if (cutoff := self.cutoff(rate)) is not None:
            lines.append(f"low-pass at {cutoff:.4g} Hz (Butterworth, zero phase)")
        if (edge := self.edge_samples(rate)) > 0:
            lines.append(f"{edge} samples ({edge / rate:.3g} s) left out at each end")
        if self.decimate > 1:
            lines.append(f"every {self.decimate}th sample kept, {rate / self.decimate:.6g} Hz")
        if self.average > 1:
            lines.append(f"means of {self.average} samples, {rate / self.decimate / self.average:.6g} Hz")
        return tuple(lines)


def smooth_derivative(
    time: np.ndarray, values: np.ndarray, bandwidth_hz: float, order: int = 1
) -> tuple[np.ndarray, slice]:
    """Differentiate with a Savitzky–Golay filter of a given bandwidth.

    Parameters
    ----------
    time : ndarray, shape (n,), s
        Even time stamps.
    values : ndarray, shape (n,) or (n, k)
    bandwidth_hz : float, Hz
        −3 dB frequency of the smoothing.
    order : int
        1 or 2: first or second derivative; 0 smooths only, for what the derivatives are compared with.

    Returns
    -------
    derivative : ndarray, shape of ``values``, per s or per s²
    inside : slice
        Samples that a full window stands behind; drop the others.

    Raises
    ------
    SignalError
        If the bandwidth is too large for the sampling rate, or the signal too short for it.

    Notes
    -----
    A cubic over 2M + 1 samples has its −3 dB point at (p + 1)/(3.2 M − 4.6) of the Nyquist frequency, p = 3:
    R. W. Schafer, "What is a Savitzky-Golay filter?", IEEE Signal Processing Magazine 28(4), 2011.
    """
    from scipy.signal import savgol_filter

    if order not in (0, 1, 2):
        raise SignalError(f"order = {order}: only smoothing (0), first and second derivatives are offered")
    step, degree = _step(time), 3
    share = bandwidth_hz * 2.0 * step
    if not 0.0 < share <= 0.5:
        raise SignalError(f"bandwidth {bandwidth_hz:g} Hz must be positive and at most {0.25 / step:g} Hz at this rate")
    half = max(2, round(((degree + 1) / share + 4.6) / 3.2))
    if len(time) < 4 * half + 2:
        raise SignalError(
            f"{len(time)} samples are too few for a bandwidth of {bandwidth_hz:g} Hz, which needs {4 * half + 2}"
        )
    result = savgol_filter(values, 2 * half + 1, degree, deriv=order, delta=step, axis=0, mode="interp")
    return np.asarray(result), slice(half, len(time) - half)


def cut_blocks(time: np.ndarray, shortest: float, most: int | None = None) -> tuple[slice, ...]:
    """Cut a record into adjoining blocks of nearly equal length.

    Parameters
    ----------
    time : ndarray, shape (n,), s
    shortest : float, s
        Least length of a block; take more than the residual's correlation time.
    most : int, optional
        Not more blocks than this.

    Returns
    -------
    tuple of slice
        At least one block; one alone where the record is shorter than two blocks.

    Raises
    ------
    SignalError
        If the record is shorter than one block.
    """
    step = _step(time)
    span = step * len(time)
    if not shortest > 0.0 or (most is not None and most < 1):
        raise SignalError("blocks need a positive length and a number of at least 1")
    if span < shortest * (1.0 - 1e-9):
        raise SignalError(f"a record of {span:.4g} s is shorter than one block of {shortest:.4g} s")
    count = max(1, int(len(time) // np.ceil(shortest / step - 1e-9)))
    count = count if most is None else min(count, most)
    bounds = np.linspace(0, len(time), count + 1).round().astype(int)
    return tuple(slice(int(a), int(b)) for a, b in itertools.pairwise(bounds))
