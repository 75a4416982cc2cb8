"""Order tracking and time-synchronous averaging.

A tracked signal is sampled evenly in shaft angle: its ``rate`` is in samples per revolution and its "frequencies" are
orders, so that everything that works on signals over time works on it too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gearbox.signals.figures import plot_average
from gearbox.signals.signal import Signal, SignalError, value_at

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "SynchronousAverage",
    "order_track",
    "revolutions_at_speed",
    "revolutions_from_mesh",
    "revolutions_from_pulses",
    "synchronous_average",
]

Array = NDArray[np.float64]


def revolutions_at_speed(signal: Signal, speed_hz: float) -> Array:
    """Shaft angle in revolutions at each sample for a constant speed, shape (n,).

    Parameters
    ----------
    signal : Signal
    speed_hz : float
        Rotation frequency of the shaft, Hz.
    """
    if not speed_hz > 0.0:
        raise SignalError(f"a rotation frequency of {speed_hz} Hz gives no angle: give a number above zero")
    return np.asarray(np.arange(len(signal)) * (speed_hz / signal.rate))


def revolutions_from_pulses(signal: Signal, pulses: ArrayLike, per_revolution: int = 1) -> Array:
    """Shaft angle in revolutions at each sample from the instants of tachometer pulses.

    Parameters
    ----------
    signal : Signal
    pulses : array_like, shape (m,), s
        Rising instants, counted from the signal's first sample; they must cover the signal.
    per_revolution : int
        Pulses in one revolution.

    Raises
    ------
    SignalError
        If there are fewer than four pulses, they do not rise, or do not cover the signal.
    """
    from scipy.interpolate import PchipInterpolator

    at = np.asarray(pulses, dtype=float)
    if at.ndim != 1 or at.size < 4 or not (np.diff(at) > 0.0).all():
        raise SignalError("tachometer pulses must be at least four instants that rise")
    last = (len(signal) - 1) / signal.rate
    if at[0] > 0.0 or at[-1] < last:
        raise SignalError(
            f"tachometer pulses cover {at[0]:.4g} to {at[-1]:.4g} s and the signal lasts from 0 to {last:.4g} s: cut "
            "the signal to the time between two pulses"
        )
    turns = np.arange(at.size) / per_revolution
    return np.asarray(PchipInterpolator(at, turns)(np.arange(len(signal)) / signal.rate))


def revolutions_from_mesh(
    signal: Signal, mesh_frequency: float, teeth: int, *, bandwidth: float, harmonic: int = 1
) -> Array:
    """Shaft angle in revolutions at each sample from the phase of a mesh line, without a tachometer.

    Parameters
    ----------
    signal : Signal
    mesh_frequency : float, Hz
    teeth : int
        Of the gear on the shaft whose angle is wanted.
    bandwidth : float, Hz
        Half the band around the line that is demodulated.  It must stay below the slowest shaft's frequency, or the
        sidebands' own swing is taken for a change of speed.
    harmonic : int
        Which multiple of the mesh frequency to take: a strong one.

    Returns
    -------
    ndarray, shape (n,)
        Rises evenly but for the slow changes of speed; the zero is that of the mesh line's phase.

    Raises
    ------
    SignalError
        If the line lies outside the signal's band or sinks into the noise, where a phase cannot be followed.
    """
    from scipy.signal import butter, sosfiltfilt

    centre = harmonic * mesh_frequency
    if not 0.0 < bandwidth < centre < signal.nyquist - bandwidth:
        raise SignalError(
            f"a line at {centre:.5g} Hz ± {bandwidth:.3g} Hz cannot be demodulated in '{signal.name}' sampled at "
            f"{signal.rate:g} Hz"
        )
    t = np.arange(len(signal)) / signal.rate
    turned = (signal.values - signal.values.mean()) * np.exp(-2j * np.pi * centre * t)
    sos = butter(2, bandwidth / signal.nyquist, output="sos")
    pad = min(len(signal) - 1, int(2.0 * signal.rate / bandwidth))
    slow = sosfiltfilt(sos, turned.real, padlen=pad) + 1j * sosfiltfilt(sos, turned.imag, padlen=pad)
    size = np.abs(slow)
    if size.min() < 0.1 * size.mean():
        raise SignalError(
            f"the line at {centre:.5g} Hz in '{signal.name}' fades at {t[size.argmin()]:.3g} s, so that its phase "
            "cannot be followed: take another harmonic or channel"
        )
    return np.asarray((centre * t + np.unwrap(np.angle(slow)) / (2.0 * np.pi)) / (harmonic * teeth))


def order_track(signal: Signal, revolutions: ArrayLike, per_revolution: int) -> Signal:
    """Resample a signal evenly in shaft angle.

    Parameters
    ----------
    signal : Signal
    revolutions : array_like, shape (n,)
        Shaft angle at each sample, rising.
    per_revolution : int
        Samples per revolution wanted; enough for the highest order: what lies above half of it is filtered out.

    Returns
    -------
    Signal
        ``rate`` in samples per revolution, ``start`` in revolutions; starts at the next whole sample of angle.
    """
    from scipy.interpolate import CubicSpline
    from scipy.signal import butter, sosfiltfilt

    turns = np.asarray(revolutions, dtype=float)
    if turns.shape != (len(signal),):
        raise SignalError(f"{turns.size} angles for {len(signal)} samples of '{signal.name}'")
    if not (np.diff(turns) > 0.0).all():
        raise SignalError(f"the shaft angle of '{signal.name}' does not rise everywhere: is the speed's sign right?")
    if per_revolution < 4:
        raise SignalError(f"{per_revolution} samples per revolution hold no order: give 4 or more")
    fastest = float(np.diff(turns).max()) * signal.rate
    cutoff = 0.45 * per_revolution * fastest
    if cutoff < signal.nyquist:
        sos = butter(8, cutoff / signal.nyquist, output="sos")
        signal = signal.with_values(sosfiltfilt(sos, signal.values))
    first, last = np.ceil(turns[0] * per_revolution), np.floor(turns[-1] * per_revolution)
    grid = np.arange(first, last + 1.0) / per_revolution
    times = CubicSpline(turns, np.arange(turns.size) / signal.rate)(grid)
    times = np.clip(times, 0.0, (len(signal) - 1) / signal.rate)
    return Signal(
        value_at(signal, times), float(per_revolution), name=signal.name, unit=signal.unit, start=float(grid[0])
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class SynchronousAverage:
    """What repeats with a shaft, and what does not.

    Parameters
    ----------
    values : ndarray, shape (m,)
        The average over one period, without the mean.
    per_revolution : float
        Samples per revolution.
    count : int
        Periods averaged.
    share : float
        Share of the signal's variance that repeats; what noise alone would leave (1/count) is taken off.
    std_error : float
        Of one value of the average, in the signal's unit.
    unit : str
    """

    values: Array
    per_revolution: float
    count: int
    share: float
    std_error: float
    unit: str = ""

    def __repr__(self) -> str:
        return f"SynchronousAverage({self.count} periods; {100 * self.share:.1f} % of the energy repeats)"

    @property
    def angle(self) -> Array:
        """Angle of each value, shape (m,), revolutions."""
        return np.arange(self.values.size) / self.per_revolution

    def to_frame(self) -> pd.DataFrame:
        """Angle and value as a table."""
        import pandas as pd

        return pd.DataFrame({"angle [rev]": self.angle, f"average [{self.unit or '-'}]": self.values})

    def plot(self) -> Any:
        """The average over the shaft's angle; returns the figure."""
        return plot_average(self)


def synchronous_average(tracked: Signal, revolutions: int = 1) -> SynchronousAverage:
    """Average a tracked signal over whole periods of a shaft.

    Parameters
    ----------
    tracked : Signal
        From :func:`order_track`.
    revolutions : int
        Revolutions in one period, such as 2 for the slower of two shafts with ratio 2.

    Raises
    ------
    SignalError
        If the signal has fewer than two whole periods.
    """
    length = round(tracked.rate * revolutions)
    count = len(tracked) // length
    if count < 2:
        raise SignalError(
            f"'{tracked.name}' has {len(tracked) / tracked.rate:.3g} revolutions, fewer than two periods of "
            f"{revolutions}"
        )
    blocks = tracked.values[: count * length].reshape(count, length)
    blocks = blocks - blocks.mean()
    mean = blocks.mean(axis=0)
    total = float((blocks**2).mean())
    left = float(((blocks - mean) ** 2).sum() / ((count - 1) * length))
    share = max(1.0 - left / total, 0.0) if total > 0.0 else 0.0
    return SynchronousAverage(
        values=mean,
        per_revolution=tracked.rate,
        count=count,
        share=share,
        std_error=float(np.sqrt(left / count)),
        unit=tracked.unit,
    )
