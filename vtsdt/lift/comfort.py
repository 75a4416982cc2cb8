"""Ride comfort after ISO 18738-1: peak-to-peak vibration, A95, acceleration and jerk of a ride.

Vibration is weighted (W_k along z, W_d across, ISO 2631-1 and ISO 8041); acceleration and jerk are those of the
signal below 10 Hz.  The definitions are this project's reading of the standard; an assessment under the standard needs
an instrument that fulfils ISO 8041.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from vtsdt.lift.vibration_weighting import weighted

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

__all__ = ["ComfortError", "RideComfort", "Vibration", "peak_to_peak", "ride_comfort"]

#: Low-pass for acceleration and jerk, Hz, and length of the line fitted for the jerk, s.
LOW_PASS, JERK_LENGTH = 10.0, 0.5
#: Share of the largest speed above which the lift counts as moving, and tolerance of a constant speed.
MOVING, CONSTANT = 0.02, 0.05
#: Settling time of the weighting's high-pass at 0.4 Hz after an acceleration ends, s.
SETTLING = 1.5
#: Weighted vibration below this does not count, m/s².
FLOOR = 2e-3


class ComfortError(ValueError):
    """The comfort of a ride cannot be evaluated; the message gives the reason."""


@dataclass(frozen=True, kw_only=True)
class Vibration:
    """Weighted vibration along one axis.

    Parameters
    ----------
    largest : float, m/s²
        Largest peak-to-peak value of the ride.
    a95 : float, m/s²
        95 % quantile of the peak-to-peak values.
    steady_largest, steady_a95 : float, m/s²
        The same at constant speed, from 1.5 s after it is reached to 0.5 s before it ends; NaN without such time.
    rms : float, m/s²
        Root mean square of the ride.
    """

    largest: float
    a95: float
    steady_largest: float
    steady_a95: float
    rms: float


@dataclass(frozen=True, eq=False, kw_only=True)
class RideComfort:
    """Comfort indicators of one ride.

    Parameters
    ----------
    name : str
    z : Vibration
        Along the travel, weighted with W_k.
    x, y : Vibration or None
        Across it, weighted with W_d.
    acceleration, deceleration : float, m/s²
        Largest, below 10 Hz.
    a95_acceleration, a95_deceleration : float, m/s²
        95 % quantiles between 5 and 95 % of the largest speed.
    jerk : float, m/s³
        Largest slope of a line fitted to half a second of the acceleration below 10 Hz.
    speed, distance : float, m/s and m
        Largest speed and distance, by integration.
    notes : tuple of str
        Limits of the record, and what was done to it.
    signals : dict of ndarray
        Of the evaluated ride by name: time, speed, slow (acceleration below 10 Hz), weighted, steady.
    """

    name: str
    z: Vibration
    x: Vibration | None
    y: Vibration | None
    acceleration: float
    deceleration: float
    a95_acceleration: float
    a95_deceleration: float
    jerk: float
    speed: float
    distance: float
    notes: tuple[str, ...] = ()
    signals: dict[str, np.ndarray] = field(default_factory=dict, repr=False)

    def rows(self) -> list[tuple[str, float, str]]:
        """Return indicator, value and unit."""
        vibration: list[tuple[str, float, str]] = []
        for axis in ("z", "x", "y"):
            v: Vibration | None = getattr(self, axis)
            if v is not None:
                vibration += [
                    (f"{axis}: largest peak-to-peak", v.largest, "m/s²"),
                    (f"{axis}: A95 peak-to-peak", v.a95, "m/s²"),
                    (f"{axis}: largest peak-to-peak at constant speed", v.steady_largest, "m/s²"),
                    (f"{axis}: A95 peak-to-peak at constant speed", v.steady_a95, "m/s²"),
                    (f"{axis}: weighted root mean square", v.rms, "m/s²"),
                ]
        return [
            *vibration,
            ("largest acceleration", self.acceleration, "m/s²"),
            ("largest deceleration", self.deceleration, "m/s²"),
            ("A95 acceleration", self.a95_acceleration, "m/s²"),
            ("A95 deceleration", self.a95_deceleration, "m/s²"),
            ("largest jerk", self.jerk, "m/s³"),
            ("largest speed", self.speed, "m/s"),
            ("distance", self.distance, "m"),
        ]

    def to_frame(self) -> pandas.DataFrame:
        """Return the indicators as a table."""
        import pandas

        return pandas.DataFrame(self.rows(), columns=["indicator", "value", "unit"])

    def to_json(self) -> dict[str, Any]:
        """Return the indicators by name; undefined ones are None."""
        values = {n: {"value": v if np.isfinite(v) else None, "unit": u} for n, v, u in self.rows()}
        return {"name": self.name, "indicators": values, "notes": list(self.notes)}

    def plot(self) -> Figure:
        """Draw speed, acceleration below 10 Hz and weighted vibration over time; returns the figure."""
        from matplotlib.figure import Figure

        s = self.signals
        figure = Figure(figsize=(7.2, 5.6), layout="constrained")
        rows = figure.subplots(3, 1, sharex=True)
        rows[0].plot(s["time"], s["speed"], color="#0072B2", linewidth=1.2)
        rows[0].set_ylabel("speed [m/s]")
        rows[1].plot(s["time"], s["slow"], color="#D55E00", linewidth=1.2)
        rows[1].set_ylabel("acceleration\nbelow 10 Hz [m/s²]")
        rows[2].plot(s["time"], s["weighted"], color="black", linewidth=0.8)
        rows[2].set_ylabel("vibration along z,\nW_k [m/s²]")
        rows[2].set_xlabel("time [s]")
        steady = s["steady"].astype(bool)
        for axis in rows:
            axis.fill_between(
                s["time"],
                0.0,
                1.0,
                where=steady,
                transform=axis.get_xaxis_transform(),
                color="#dddddd",
                zorder=0,
                linewidth=0,
            )
            axis.grid(color="#eeeeee")
        rows[0].set_title(f"{self.name} (grey: constant speed)", loc="left", fontsize=10)
        return figure


def ride_comfort(
    time: np.ndarray,
    a_z: np.ndarray,
    *,
    a_x: np.ndarray | None = None,
    a_y: np.ndarray | None = None,
    name: str = "ride",
) -> RideComfort:
    """Return comfort indicators of one ride from rest to rest.

    Parameters
    ----------
    time : ndarray, shape (n,), s
        Increasing; an uneven grid is resampled linearly to an even one of the median spacing.
    a_z : ndarray, shape (n,), m/s²
        Acceleration along the travel, with or without gravity: the reading at rest is subtracted.
    a_x, a_y : ndarray, optional
        Across it.
    name : str

    Raises
    ------
    ComfortError
        If the record is too short, has gaps, or the lift does not move in it.
    """
    t, rate, notes = _even(np.asarray(time, dtype=float))
    a = np.interp(t, time, np.asarray(a_z, dtype=float))
    a = a - _resting(a, rate)
    slow = _low_pass(a, rate)
    speed, tilt = _speed(t, slow)
    top = float(np.abs(speed).max())
    if top < 0.02 or top < 4.0 * abs(tilt):
        raise ComfortError(
            f"'{name}': the lift does not move in this record, or does not come back to rest: give one whole ride"
        )
    direction = 1.0 if abs(speed.max()) >= abs(speed.min()) else -1.0
    moving = _widened(np.abs(speed) > MOVING * top, int(0.5 * rate))
    steady = np.abs(speed) > (1.0 - CONSTANT) * top
    steady &= np.abs(slow) < max(0.15 * float(np.abs(slow).max()), 1e-12)
    steady = _shortened(steady, int(SETTLING * rate), int(0.5 * rate))
    along = direction * slow
    ramp = (np.abs(speed) > 0.05 * top) & (np.abs(speed) < 0.95 * top)
    axes = {"z": _vibration(weighted(a, rate, "Wk"), moving, steady, rate)}
    for axis, values in (("x", a_x), ("y", a_y)):
        if values is not None:
            across = np.interp(t, time, np.asarray(values, dtype=float))
            axes[axis] = _vibration(weighted(across - np.median(across), rate, "Wd"), moving, steady, rate)
    if rate < 200.0:
        notes.append(
            f"{rate:.3g} samples a second: the record has no vibration above {0.4 * rate:.3g} Hz, "
            "ISO 8041 asks for a band up to 80 Hz"
        )
    if not np.any(steady):
        notes.append(f"the speed is never constant for longer than {SETTLING + 0.5:g} s")
    up, down = along[ramp & (along > 0)], -along[ramp & (along < 0)]
    signals = {"time": t, "speed": speed, "slow": slow, "weighted": weighted(a, rate, "Wk"), "steady": steady}
    return RideComfort(
        name=name,
        z=axes["z"],
        x=axes.get("x"),
        y=axes.get("y"),
        acceleration=float(np.max(along, initial=0.0)),
        deceleration=float(np.max(-along, initial=0.0)),
        a95_acceleration=float(np.quantile(up, 0.95)) if up.size else float("nan"),
        a95_deceleration=float(np.quantile(down, 0.95)) if down.size else float("nan"),
        jerk=_jerk(slow, rate),
        speed=top,
        distance=float(abs(np.trapezoid(speed, t))),
        notes=tuple(notes),
        signals=signals,
    )


def peak_to_peak(values: np.ndarray, floor: float = FLOOR) -> np.ndarray:
    """Return the peak-to-peak values of a signal: the distances of neighbouring extremes of opposite sign.

    Values within ``floor`` of zero do not count as vibration; otherwise quiet parts of a ride would reduce its A95.

    Examples
    --------
    >>> peak_to_peak(np.array([0.0, 1.0, 0.5, -2.0, -1.0, 3.0, 0.0]))
    array([3., 5.])
    """
    x = np.asarray(values, dtype=float)
    x = x[np.abs(x) > floor]
    if x.size < 2:
        return np.zeros(0)
    cuts = np.flatnonzero(np.diff(np.sign(x))) + 1
    peaks = np.array([np.abs(part).max() for part in np.split(x, cuts)])
    return peaks[1:] + peaks[:-1]


def _vibration(values: np.ndarray, moving: np.ndarray, steady: np.ndarray, rate: float) -> Vibration:
    ride = values[moving]
    whole = peak_to_peak(ride)
    constant = peak_to_peak(values[steady]) if np.count_nonzero(steady) > rate else np.zeros(0)
    nan = float("nan")
    return Vibration(
        largest=float(whole.max()) if whole.size else nan,
        a95=float(np.quantile(whole, 0.95)) if whole.size else nan,
        steady_largest=float(constant.max()) if constant.size else nan,
        steady_a95=float(np.quantile(constant, 0.95)) if constant.size else nan,
        rms=float(np.sqrt(np.mean(ride**2))),
    )


def _even(time: np.ndarray) -> tuple[np.ndarray, float, list[str]]:
    if time.ndim != 1 or time.size < 50 or not np.all(np.isfinite(time)) or np.any(np.diff(time) <= 0):
        raise ComfortError("a ride needs 50 samples or more at increasing times")
    steps = np.diff(time)
    usual = float(np.median(steps))
    if steps.max() > 0.5:
        k = int(np.argmax(steps))
        raise ComfortError(
            f"nothing was recorded for {steps[k]:.2f} s after {time[k]:.2f} s: vibration in a gap is unknown"
        )
    notes = []
    if steps.max() > 1.5 * usual:
        notes.append(f"uneven sampling (longest step {1e3 * steps.max():.0f} ms) resampled to {1e3 * usual:.0f} ms")
    count = int(np.floor((time[-1] - time[0]) / usual + 1e-6)) + 1
    return time[0] + usual * np.arange(count), 1.0 / usual, notes


def _resting(a: np.ndarray, rate: float) -> float:
    """Return the sensor's reading at rest: the median of the quieter end."""
    size = max(int(0.3 * rate), 5)
    ends = (a[:size], a[-size:])
    return float(np.median(min(ends, key=np.std)))


def _low_pass(a: np.ndarray, rate: float) -> np.ndarray:
    from scipy.signal import butter, sosfiltfilt

    if rate <= 2.2 * LOW_PASS:
        return a
    # forwards and backwards the filter acts twice: the corner is shifted so that both together are 3 dB down at 10 Hz
    corner = LOW_PASS / (np.sqrt(2.0) - 1.0) ** 0.25
    if corner >= 0.45 * rate:
        return a
    return np.asarray(sosfiltfilt(butter(2, corner, fs=rate, output="sos"), a))


def _speed(t: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the speed, zero at both ends, and the drift that was removed for that."""
    v = np.concatenate([[0.0], np.cumsum(0.5 * (a[1:] + a[:-1]) * np.diff(t))])
    return v - v[-1] * (t - t[0]) / (t[-1] - t[0]), float(v[-1])


def _shortened(flags: np.ndarray, after: int, before: int) -> np.ndarray:
    """Return flags that have been set for a number of samples and stay set for another number."""
    kept = flags.copy()
    edges = np.diff(flags.astype(int), prepend=0, append=0)
    for begin, end in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
        kept[begin : begin + after] = False
        kept[max(end - before, 0) : end] = False
    return kept


def _widened(flags: np.ndarray, by: int) -> np.ndarray:
    wide = np.convolve(flags.astype(float), np.ones(2 * by + 1), mode="same")
    return np.asarray(wide > 0.5)


def _jerk(a: np.ndarray, rate: float) -> float:
    """Return the largest slope of least-squares lines through windows of half a second."""
    half = max(int(0.5 * JERK_LENGTH * rate), 1)
    offsets = np.arange(-half, half + 1) / rate
    kernel = offsets / np.sum(offsets**2)
    return float(np.abs(np.convolve(a, kernel[::-1], mode="valid")).max()) if a.size > 2 * half else float("nan")
