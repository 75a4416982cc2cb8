"""Vibration signals of a gear stage: resampling, normalisation, band-pass, window.

The order is that of the paper (section 4.3): resample to a common rate, normalise, band-pass, take a window.
Measured and simulated signals go through the same :class:`Processing`.
"""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimation.signals.preparation import SignalError

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "Processing",
    "Signal",
    "SignalError",
    "band_pass",
    "normalise",
    "resample",
    "value_at",
]

Array = NDArray[np.float64]

_ORDER = 4
#: Samples after which a filter of given lowest edge has forgotten its start to 1 %, times that edge's period.
_SETTLING_PERIODS = 3.0


@dataclass(frozen=True, eq=False)
class Signal:
    """An evenly sampled signal.

    Parameters
    ----------
    values : array_like, shape (n,)
        At least 16 finite numbers.
    rate : float
        Sampling rate, Hz.
    name : str
        Sensor and direction.
    unit : str
        Unit of the values; ``""`` after normalisation.
    start : float
        Time of the first sample, s.

    Raises
    ------
    SignalError
        With every fault in one message.
    """

    values: Array
    rate: float
    _: KW_ONLY
    name: str = "acceleration"
    unit: str = "m/s**2"
    start: float = 0.0

    def __post_init__(self) -> None:
        values = np.array(self.values, dtype=float)
        faults = []
        if values.ndim != 1 or values.size < 16:
            faults.append(f"has shape {values.shape}: give one row of at least 16 samples")
        elif not np.isfinite(values).all():
            rows = np.flatnonzero(~np.isfinite(values))
            faults.append(f"has {rows.size} values that are no numbers, the first is sample {rows[0]}: leave them out")
        if not (np.isfinite(self.rate) and self.rate > 0.0):
            faults.append(f"has a sampling rate of {self.rate} Hz: give a number above zero")
        if faults:
            raise SignalError("; ".join(f"signal '{self.name}' {fault}" for fault in faults))
        values.setflags(write=False)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "rate", float(self.rate))

    def __len__(self) -> int:
        return int(self.values.size)

    def __repr__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        return f"Signal({self.name}: {len(self)} samples at {self.rate:g} Hz, RMS {self.rms:.4g}{unit})"

    @property
    def time(self) -> Array:
        """Time stamps, shape (n,), s."""
        return self.start + np.arange(len(self)) / self.rate

    @property
    def duration(self) -> float:
        """Number of samples over the sampling rate, s."""
        return len(self) / self.rate

    @property
    def nyquist(self) -> float:
        """Half the sampling rate, Hz."""
        return 0.5 * self.rate

    @property
    def rms(self) -> float:
        """Root mean square, in the signal's unit."""
        return float(np.sqrt(np.mean(self.values**2)))

    def with_values(self, values: ArrayLike, **changes: Any) -> Signal:
        """The same signal with other values (and ``rate``, ``unit``, ``start``, ``name`` if given)."""
        return replace(self, values=np.asarray(values, dtype=float), **changes)

    def cut(self, start: float, duration: float) -> Signal:
        """A window of the signal, from ``start`` s after its first sample.

        Raises
        ------
        SignalError
            If the signal does not cover the window.
        """
        first, count = round(start * self.rate), round(duration * self.rate)
        if first < 0 or first + count > len(self):
            raise SignalError(
                f"signal '{self.name}' of {self.duration:.4g} s has no window from {start:.4g} s that lasts "
                f"{duration:.4g} s: record or simulate longer, or take a shorter window"
            )
        return self.with_values(self.values[first : first + count], start=self.start + first / self.rate)

    def to_frame(self) -> pd.DataFrame:
        """Time and values as a table."""
        import pandas as pd

        return pd.DataFrame({"time [s]": self.time, f"{self.name} [{self.unit or '-'}]": self.values})


# -------------------------------------------------------------------- steps


def resample(signal: Signal, rate: float) -> Signal:
    """Resample to another rate, with a low-pass below the lower of the two Nyquist frequencies.

    Parameters
    ----------
    signal : Signal
    rate : float, Hz

    Raises
    ------
    SignalError
        If the rate is not a positive number, or too few samples would be left.
    """
    from scipy.signal import resample_poly

    if not (np.isfinite(rate) and rate > 0.0):
        raise SignalError(f"cannot resample '{signal.name}' to {rate} Hz: give a rate above zero")
    if rate == signal.rate:
        return signal
    ratio = Fraction(rate / signal.rate).limit_denominator(4000)
    mean = float(signal.values.mean())
    if ratio > 0 and abs(float(ratio) * signal.rate / rate - 1.0) < 1e-12:
        values = resample_poly(signal.values - mean, ratio.numerator, ratio.denominator) + mean
        return signal.with_values(values, rate=rate)
    slow = signal
    if rate < signal.rate:
        slow = _low_pass(signal, 0.45 * rate)
    count = int(np.floor((len(signal) - 1) / signal.rate * rate + 1e-9)) + 1
    return signal.with_values(value_at(slow, np.arange(count) / rate), rate=rate)


def _low_pass(signal: Signal, cutoff: float) -> Signal:
    from scipy.signal import butter, sosfiltfilt

    sos = butter(8, cutoff / signal.nyquist, output="sos")
    return signal.with_values(sosfiltfilt(sos, signal.values))


def value_at(signal: Signal, times: ArrayLike) -> Array:
    """Values between the samples, by band-limited interpolation.

    Eightfold oversampling (Fourier) and a cubic through that: for content below 0.4 of the sampling rate the error is
    below 1e-4 of the amplitude some 30 samples away from the ends, where the signal is mirrored.

    Parameters
    ----------
    signal : Signal
    times : array_like, shape (m,), s
        Counted from the first sample, within the signal.

    Returns
    -------
    ndarray, shape (m,)
    """
    from scipy.interpolate import CubicSpline
    from scipy.signal import resample_poly

    t = np.asarray(times, dtype=float)
    last = (len(signal) - 1) / signal.rate
    if t.size and (t.min() < -1e-9 or t.max() > last + 1e-9):
        raise SignalError(
            f"signal '{signal.name}' lasts from 0 to {last:.6g} s; asked for {t.min():.6g} to {t.max():.6g} s"
        )
    factor, pad = 8, min(64, len(signal) - 1)
    padded = np.pad(signal.values, pad, mode="reflect", reflect_type="odd")
    fine = resample_poly(padded, factor, 1, window=("kaiser", 9.0))
    grid = (np.arange(fine.size) / factor - pad) / signal.rate
    return np.asarray(CubicSpline(grid, fine)(t))


def normalise(signal: Signal) -> Signal:
    """Take the mean away and divide by the standard deviation.

    The paper says "normalized" and not how.  Cosine similarity does not depend on the factor.

    Raises
    ------
    SignalError
        If the signal does not vary.
    """
    centred = signal.values - signal.values.mean()
    size = float(np.sqrt(np.mean(centred**2)))
    if not size > 1e-12 * max(1e-300, float(np.abs(signal.values).max())):
        raise SignalError(
            f"signal '{signal.name}' does not vary (zero variance): check the sensor, its column and the window"
        )
    return signal.with_values(centred / size, unit="")


def band_pass(signal: Signal, low: float, high: float, order: int = _ORDER) -> Signal:
    """Filter forwards and backwards with a Butterworth band-pass, without shift in time.

    Parameters
    ----------
    signal : Signal
    low, high : float, Hz
        Edges, where the gain is 1/2 (−6 dB) after both passes.
    order : int
        Of one pass at each edge.

    Raises
    ------
    SignalError
        If the band is empty or reaches the Nyquist frequency, or the signal is too short for it.

    Examples
    --------
    >>> import numpy as np
    >>> slow = Signal(np.sin(np.arange(4000)), 2000.0)
    >>> band_pass(slow, 300.0, 1200.0)
    Traceback (most recent call last):
    ...
    estimation.signals.preparation.SignalError: band-pass from 300 to 1200 Hz: ...
    """
    from scipy.signal import sosfiltfilt

    if not 0.0 < low < high < signal.nyquist:
        raise SignalError(
            f"band-pass from {low:g} to {high:g} Hz: signal '{signal.name}' is sampled at {signal.rate:g} Hz, so the "
            f"edges must rise and lie between 0 and {signal.nyquist:g} Hz: take a lower band or a higher rate"
        )
    pad = int(np.ceil(_SETTLING_PERIODS * signal.rate / min(low, high - low)))
    if len(signal) <= 2 * pad:
        raise SignalError(
            f"signal '{signal.name}' has {len(signal)} samples; a band-pass from {low:g} to {high:g} Hz needs more "
            f"than {2 * pad} at {signal.rate:g} Hz"
        )
    sos = _design(order, low / signal.nyquist, high / signal.nyquist)
    return signal.with_values(sosfiltfilt(sos, signal.values, padtype="odd", padlen=pad))


@lru_cache(maxsize=32)
def _design(order: int, low: float, high: float) -> Array:
    """Butterworth band-pass with edges in shares of the Nyquist frequency; designing it costs more than using it."""
    from scipy.signal import butter

    return np.asarray(butter(order, (low, high), btype="bandpass", output="sos"))


@dataclass(frozen=True, kw_only=True)
class Processing:
    """What is done to measured and simulated signals alike before they are compared.

    Parameters
    ----------
    rate : float, Hz
        Both are resampled to it.
    band : (float, float), Hz
        Of the band-pass.
    duration : float, s
        Of the window.
    start : float, optional, s
        Where the window begins after the first sample; by default where the filter has settled.
    scaled : bool
        Whether both are scaled to the same size first.

    Examples
    --------
    >>> Processing().start_time
    0.01
    """

    rate: float = 10_000.0
    band: tuple[float, float] = (300.0, 1200.0)
    duration: float = 0.5
    start: float | None = None
    scaled: bool = True

    def __post_init__(self) -> None:
        faults = []
        if not self.rate > 0.0:
            faults.append(f"rate = {self.rate:g} Hz must be above zero")
        if len(self.band) != 2 or not 0.0 < self.band[0] < self.band[1] < 0.5 * self.rate:
            faults.append(
                f"band = {list(self.band)} Hz must rise and lie between 0 and half of rate = {self.rate:g} Hz, "
                f"which is {0.5 * self.rate:g} Hz: take a lower band or a higher rate"
            )
        if not self.duration > 0.0:
            faults.append(f"duration = {self.duration:g} s must be above zero")
        if self.start is not None and not self.start >= 0.0:
            faults.append(f"start = {self.start:g} s must be zero or more")
        if faults:
            raise SignalError("; ".join(faults))

    @property
    def settling(self) -> float:
        """Time that the filter takes at each end, s."""
        return _SETTLING_PERIODS / min(self.band[0], self.band[1] - self.band[0])

    @property
    def start_time(self) -> float:
        """Where the window begins after the first sample, s."""
        return self.settling if self.start is None else self.start

    @property
    def needed(self) -> float:
        """Shortest signal that can be processed, s."""
        return self.start_time + self.duration + self.settling

    def apply(self, signal: Signal) -> Signal:
        """Resample, scale, band-pass and cut the window out.

        Raises
        ------
        SignalError
            If the band lies above half of the signal's own sampling rate, the signal does not vary or is too short.
        """
        if self.band[1] >= signal.nyquist:
            raise SignalError(
                f"signal '{signal.name}' is sampled at {signal.rate:g} Hz and holds nothing above {signal.nyquist:g} "
                f"Hz: a band up to {self.band[1]:g} Hz is above its Nyquist frequency"
            )
        even = resample(signal, self.rate)
        even = band_pass(normalise(even) if self.scaled else even, *self.band)
        return even.cut(self.start_time, self.duration)

    def describe(self) -> str:
        """What is done, in a sentence."""
        scaled = "normalised, " if self.scaled else ""
        return (
            f"resampled to {self.rate:g} Hz, {scaled}band-pass {self.band[0]:g} to {self.band[1]:g} Hz "
            f"(Butterworth of order {_ORDER}, forwards and backwards), window of {self.duration:g} s from "
            f"{self.start_time:g} s"
        )
