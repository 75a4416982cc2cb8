"""Frequency weighting of vibration for people: W_k along the spine, W_d across it.

Band limits, transition and step are those of ISO 8041:2005, Table 3, for the weightings of ISO 2631-1:1997.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

__all__ = ["WEIGHTINGS", "Weighting", "weighted"]


@dataclass(frozen=True, kw_only=True)
class Weighting:
    """A weighting as ISO 8041 states it: frequencies in Hz and quality factors.

    Parameters
    ----------
    f_1, f_2 : float, Hz
        High-pass and low-pass of the band, both of second order with Q = 1/√2.
    f_3, f_4, q_4 : float
        Transition from acceleration to velocity.
    f_5, q_5, f_6, q_6 : float
        Upward step; left out with infinite frequencies.
    """

    f_1: float
    f_2: float
    f_3: float
    f_4: float
    q_4: float
    f_5: float = math.inf
    q_5: float = 1.0
    f_6: float = math.inf
    q_6: float = 1.0

    def response(self, frequency: np.ndarray) -> np.ndarray:
        """Return the complex response at frequencies in Hz.

        Examples
        --------
        >>> np.round(np.abs(WEIGHTINGS["Wk"].response(np.array([1.0, 4.0, 16.0]))), 2)
        array([0.48, 0.97, 0.77])
        """
        s = 2j * math.pi * np.asarray(frequency, dtype=float)
        w = [2.0 * math.pi * f for f in (self.f_1, self.f_2, self.f_3, self.f_4)]
        h = s**2 / (s**2 + math.sqrt(2.0) * w[0] * s + w[0] ** 2)
        h = h / (1.0 + math.sqrt(2.0) * s / w[1] + (s / w[1]) ** 2)
        h = h * (1.0 + s / w[2]) / (1.0 + s / (self.q_4 * w[3]) + (s / w[3]) ** 2)
        if math.isfinite(self.f_5):
            a, b = 2.0 * math.pi * self.f_5, 2.0 * math.pi * self.f_6
            rise = (1.0 + s / (self.q_5 * a) + (s / a) ** 2) * (a / b) ** 2
            h = h * rise / (1.0 + s / (self.q_6 * b) + (s / b) ** 2)
        return np.asarray(h)


WEIGHTINGS = {
    "Wk": Weighting(f_1=0.4, f_2=100.0, f_3=12.5, f_4=12.5, q_4=0.63, f_5=2.37, q_5=0.91, f_6=3.35, q_6=0.91),
    "Wd": Weighting(f_1=0.4, f_2=100.0, f_3=2.0, f_4=2.0, q_4=0.63),
}


def weighted(values: np.ndarray, rate: float, weighting: str = "Wk") -> np.ndarray:
    """Return the weighted signal.

    The response of ISO 8041 is applied exactly, including phase, by Fourier transform; before its start the signal is
    assumed to have its first value.

    Parameters
    ----------
    values : ndarray, shape (n,)
    rate : float, Hz
    weighting : {"Wk", "Wd"}

    Examples
    --------
    >>> t = np.arange(4000) / 200.0
    >>> float(np.round(np.sqrt(2.0) * np.std(weighted(np.sin(2 * np.pi * 8.0 * t), 200.0)[2000:]), 2))
    1.04
    """
    x = np.asarray(values, dtype=float)
    pad = max(int(10.0 * rate), 16)  # the high-pass at 0.4 Hz settles within this time
    whole = np.concatenate([np.full(pad, x[0]), x, np.full(pad, x[-1])]) - x[0]
    frequency = np.fft.rfftfreq(whole.size, 1.0 / rate)
    response = WEIGHTINGS[weighting].response(frequency)
    response[0] = 0.0
    return np.asarray(np.fft.irfft(np.fft.rfft(whole) * response, whole.size)[pad : pad + x.size])
