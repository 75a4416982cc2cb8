"""Measures of the error between a model and a record, and estimates of noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = [
    "LEAST_SAMPLES",
    "Agreement",
    "NoiseFloor",
    "agreement",
    "bias",
    "coherence",
    "cosine",
    "frequency_response",
    "max_error",
    "noise_floor",
    "nrmse",
    "pearson",
    "quantisation_step",
    "rmse",
    "share_above_noise",
    "spectral_density",
]

LEAST_SAMPLES = 8
"""Fewest samples for an estimate of noise: third differences over two spacings, and a median of a few of them."""


def _pair(measured: np.ndarray, model: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    a, b = np.asarray(measured, dtype=float), np.asarray(model, dtype=float)
    if a.shape != b.shape or a.ndim != 1 or a.size == 0:
        raise ValueError(f"measured {a.shape} and model {b.shape} must be two series of the same length")
    return a, b


def rmse(measured: np.ndarray, model: np.ndarray) -> float:
    """Root mean square of model minus measured, in the signal's unit.

    Examples
    --------
    >>> rmse([0.0, 0.0], [3.0, -3.0])
    3.0
    """
    a, b = _pair(measured, model)
    return float(np.sqrt(np.mean((b - a) ** 2)))


def nrmse(measured: np.ndarray, model: np.ndarray) -> float:
    """RMSE divided by the standard deviation of the measured signal (dimensionless).

    0 is perfect, 1 is as good as the signal's mean.  NaN where the measured signal is constant.
    """
    a, b = _pair(measured, model)
    spread = float(np.std(a))
    return rmse(a, b) / spread if spread > 0.0 else float("nan")


def pearson(measured: np.ndarray, model: np.ndarray) -> float:
    """Correlation coefficient; blind to offset and gain.  NaN where either signal is constant."""
    a, b = _pair(measured, model)
    return cosine(a - a.mean(), b - b.mean()) if np.ptp(a) > 0.0 and np.ptp(b) > 0.0 else float("nan")


def cosine(measured: np.ndarray, model: np.ndarray) -> float:
    """Cosine of the angle between the two series; blind to gain.  NaN where either is zero throughout."""
    a, b = _pair(measured, model)
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(np.clip(a @ b / size, -1.0, 1.0)) if size > 0.0 else float("nan")


def max_error(measured: np.ndarray, model: np.ndarray) -> float:
    """Largest absolute difference, in the signal's unit."""
    a, b = _pair(measured, model)
    return float(np.max(np.abs(b - a)))


def bias(measured: np.ndarray, model: np.ndarray) -> float:
    """Mean of model minus measured, in the signal's unit."""
    a, b = _pair(measured, model)
    return float(np.mean(b - a))


def share_above_noise(measured: np.ndarray, model: np.ndarray, noise: float) -> float:
    """Share of the mean squared error that noise does not account for, 0 to 1.

    Parameters
    ----------
    measured, model : ndarray, shape (n,)
    noise : float
        Standard deviation of the measurement noise, in the signal's unit.
    """
    error = rmse(measured, model)
    return max(0.0, 1.0 - (noise / error) ** 2) if error > 0.0 else 0.0


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """All measures of one signal; see the functions of the same names."""

    rmse: float
    nrmse: float
    pearson: float
    cosine: float
    max_error: float
    bias: float
    share_above_noise: float | None = None


def agreement(measured: np.ndarray, model: np.ndarray, noise: float | None = None) -> Agreement:
    """Compare two series of the same length.

    Parameters
    ----------
    measured, model : ndarray, shape (n,)
    noise : float, optional
        Standard deviation of the measurement noise, in the signal's unit.
    """
    a, b = _pair(measured, model)
    share = None if noise is None else share_above_noise(a, b, noise)
    return Agreement(
        rmse=rmse(a, b),
        nrmse=nrmse(a, b),
        pearson=pearson(a, b),
        cosine=cosine(a, b),
        max_error=max_error(a, b),
        bias=bias(a, b),
        share_above_noise=share,
    )


def _segment(count: int, rate: float, resolution: float | None) -> int:
    wanted = count // 8 if resolution is None else round(rate / resolution)
    return int(min(max(wanted, 16), count))


def spectral_density(values: np.ndarray, rate: float, resolution: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """One-sided power spectral density by Welch's method, mean removed from each segment.

    Parameters
    ----------
    values : ndarray, shape (n,)
    rate : float, Hz
        Sampling rate.
    resolution : float, optional, Hz
        Width of a frequency line before windowing; default gives eight segment lengths.

    Returns
    -------
    frequency : ndarray, Hz
    density : ndarray, unit² / Hz
    """
    from scipy.signal import welch

    frequency, density = welch(values, fs=rate, nperseg=_segment(len(values), rate, resolution), detrend="constant")
    return np.asarray(frequency), np.asarray(density)


def coherence(
    x: np.ndarray, y: np.ndarray, rate: float, resolution: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Magnitude-squared coherence of two series, 0 to 1, by Welch's method.

    A high value says that a linear relation to ``x`` explains ``y`` at that frequency.  With few segments
    it is biased upwards: about one over the number of independent segments where nothing is shared.
    """
    from scipy.signal import coherence as welch_coherence

    if len(x) != len(y):
        raise ValueError(f"series of {len(x)} and {len(y)} samples cannot be compared")
    frequency, value = welch_coherence(x, y, fs=rate, nperseg=_segment(len(x), rate, resolution), detrend="constant")
    return np.asarray(frequency), np.asarray(value)


def frequency_response(
    x: np.ndarray, y: np.ndarray, rate: float, resolution: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Frequency response from ``x`` to ``y`` by Welch's method: cross spectrum over the spectrum of ``x`` (H1).

    Parameters
    ----------
    x, y : ndarray, shape (n,)
    rate : float, Hz
    resolution : float, optional, Hz
        As of `spectral_density`.

    Returns
    -------
    frequency : ndarray, Hz
    response : ndarray of complex, unit of ``y`` per unit of ``x``
        Not a number where ``x`` has no power.
    """
    from scipy.signal import csd

    if len(x) != len(y):
        raise ValueError(f"series of {len(x)} and {len(y)} samples cannot be compared")
    segment = _segment(len(x), rate, resolution)
    frequency, cross = csd(x, y, fs=rate, nperseg=segment, detrend="constant")
    power = spectral_density(x, rate, resolution)[1]
    return np.asarray(frequency), np.where(power > 0.0, cross, np.nan) / np.where(power > 0.0, power, 1.0)


@dataclass(frozen=True)
class NoiseFloor:
    """Estimated noise of a channel.

    Attributes
    ----------
    std : float
        Standard deviation in the signal's unit.
    quantisation : float
        Step between two levels of the channel; 0 where there is none.
    source : str
        ``"differences"`` or ``"quantisation"``: the basis of the estimate.
    """

    std: float
    quantisation: float
    source: str


def quantisation_step(values: np.ndarray) -> float:
    """Step between the levels of a channel, or 0 where its values are not on a grid.

    A grid is believed where values appear twice on average; printed decimals of a finely resolved channel
    do not count as one.
    """
    values = np.asarray(values, dtype=float)
    levels = np.unique(values)
    if len(levels) < 3 or len(levels) > 0.5 * len(values):
        return 0.0
    steps = np.diff(levels)
    # Rounding in the file splits one level into several that are almost equal.
    step = float(np.median(steps[steps > 1e-3 * np.median(steps)]))
    turns = steps / step
    return step if np.mean(np.abs(turns - np.round(turns)) < 0.1) > 0.9 else 0.0


_ONSET = 5.0
"""A resolved signal's third difference grows eightfold when the spacing is doubled, noise hardly at all."""
_FLAT = 1.5
"""Growth per doubling up to which a level counts as noise; white noise scatters up to 1.2."""
_FALL = 0.5
"""A fall per doubling below which the level before was a motion that repeats in about the larger spacing."""
_PLATEAU = 0.25
"""Share of the channel's own deviation above which a flat stretch is the motion itself, beyond its memory."""


def _difference_levels(values: np.ndarray) -> np.ndarray:
    """Noise level that third differences over 1, 2, 4, … samples suggest, by their median absolute value."""
    levels = []
    spacing = 1
    while spacing == 1 or 24 * spacing <= len(values):
        k = spacing
        third = values[3 * k :] - 3.0 * values[2 * k : -k] + 3.0 * values[k : -2 * k] - values[: -3 * k]
        levels.append(np.median(np.abs(third)) / 0.6744897501960817 / np.sqrt(20.0))
        spacing *= 2
    return np.array(levels)


def noise_floor(values: np.ndarray) -> NoiseFloor:
    """Estimate the noise of a channel from its third differences over growing spacings.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Evenly sampled.

    Raises
    ------
    ValueError
        With fewer than eight samples.

    Notes
    -----
    Assumed is a signal that a parabola follows over a few samples, and noise that is white from some
    spacing on: then the third difference has the variance 20 σ² there.  At the sampling rate itself many
    channels are smoother than white (averaging, anti-aliasing), so the spacing is doubled until the signal
    shows (growth by more than 5 per doubling, or a fall to less than half, as of a motion that repeats), and
    the beginning of the last flat stretch before that is taken, or the first level where there is none. A motion
    that is random itself is flat beyond its memory, at the size of the whole channel: such stretches do not count.
    Medians are used, so that jumps do not count.
    Vibration that is not resolved, or a disturbance that looks like noise, is counted as noise: give the noise
    in the study where it is known.  A quantised channel has at least step/√12, the deviation of an even
    rounding error.

    The limits of growth were set by looking at real channels (EMPS force and position, lead-screw torque, lift
    acceleration); beyond these and synthetic signals they are untested.
    """
    values = np.asarray(values, dtype=float)
    if len(values) < LEAST_SAMPLES:
        raise ValueError(
            f"{len(values)} samples are too few for an estimate of noise: at least {LEAST_SAMPLES} are needed"
        )
    step = quantisation_step(values)
    levels = _difference_levels(values)
    rounding = step / np.sqrt(12.0)
    # Below one step the median only counts which levels were hit.
    if step > 0.0 and levels[0] < step:
        std = float(np.sqrt(np.mean(np.diff(values, n=3) ** 2) / 20.0))
        std = std if levels[0] == 0.0 else min(std, float(levels[0]))
    else:
        tiny = np.finfo(float).tiny
        growth = levels[1:] / np.maximum(levels[:-1], tiny)
        shows = (growth > _ONSET) | (growth < _FALL)
        onset = int(np.argmax(shows)) if shows.any() else len(growth)
        flat = np.flatnonzero((growth[:onset] < _FLAT) & (levels[:onset] < _PLATEAU * np.std(values)))
        place = 0
        if len(flat):
            place = int(flat[-1])
            while place > 0 and growth[place - 1] < _FLAT:
                place -= 1
        std = float(levels[place])
    # Third differences of rounding errors alone come out up to a fifth above step/√12: those are not white.
    if std <= 1.2 * rounding:
        return NoiseFloor(float(rounding), step, "quantisation")
    return NoiseFloor(std, step, "differences")
