"""Sampling and digitising of simulated signals, for virtual benches.

Noise and quantisation are no differential equations, so they act on arrays after a simulation.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

__all__ = ["Measurement"]


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """A sensor with its acquisition: delay and jitter, gain and offset, noise, quantisation, in that order.

    Parameters
    ----------
    gain : float
        Factor; 1 is right.
    offset : float
        Reading at zero, in the signal's unit.
    delay : float, s
        Delay of the reading.
    noise : float
        Standard deviation of white noise, in the signal's unit.
    quantisation : float
        Step of the digital reading, in the signal's unit; 0 for none.
    jitter : float, s
        Standard deviation of the instants of sampling about their time stamps.

    Raises
    ------
    ValueError
        With every value that is not finite or is negative where that has no meaning.

    Examples
    --------
    >>> encoder = Measurement(quantisation=0.1)
    >>> encoder.apply([0.0, 1.0, 2.0], [0.0, 0.26, 0.51], rng=0)
    array([0. , 0.3, 0.5])
    """

    gain: float = 1.0
    offset: float = 0.0
    delay: float = 0.0
    noise: float = 0.0
    quantisation: float = 0.0
    jitter: float = 0.0

    def __post_init__(self) -> None:
        faults = []
        for item in fields(self):
            value = getattr(self, item.name)
            if not np.isfinite(value):
                faults.append(f"{item.name} is {value}: give a finite number")
            elif value < 0.0 and item.name not in ("gain", "offset"):
                faults.append(f"{item.name} is {value:g}: it cannot be negative")
        if faults:
            raise ValueError("a measurement that cannot be: " + "; ".join(faults))

    def apply(self, times: np.ndarray, values: np.ndarray, rng: np.random.Generator | int) -> np.ndarray:
        """Return the readings at the time stamps ``times``.

        Parameters
        ----------
        times : ndarray, shape (nt,), s
            Increasing time stamps; the signal is a cubic spline between them and constant beyond them.
        values : ndarray, shape (nt,)
            The true signal at these times.
        rng : Generator or int
            Random numbers, or their seed.

        Returns
        -------
        ndarray, shape (nt,)

        Raises
        ------
        ValueError
            If times and values differ in length, times do not increase, or a value is not finite.
        """
        t, v = np.asarray(times, dtype=float), np.asarray(values, dtype=float)
        if t.ndim != 1 or t.shape != v.shape:
            raise ValueError(f"there are {t.shape} times and {v.shape} values: give one value per time")
        if np.any(np.diff(t) <= 0):
            raise ValueError(f"times must increase, but row {int(np.argmax(np.diff(t) <= 0)) + 1} does not")
        if not np.isfinite(v).all():
            raise ValueError(f"the value in row {int(np.argmin(np.isfinite(v)))} is not finite")
        generator = np.random.default_rng(rng)
        instants = t - self.delay
        if self.jitter:
            instants = instants + self.jitter * generator.standard_normal(t.size)
        if (self.delay or self.jitter) and t.size > 1:
            from scipy.interpolate import CubicSpline

            v = CubicSpline(t, v)(np.clip(instants, t[0], t[-1]))
        read = self.gain * v + self.offset
        if self.noise:
            read = read + self.noise * generator.standard_normal(t.size)
        return np.round(read / self.quantisation) * self.quantisation if self.quantisation else read
