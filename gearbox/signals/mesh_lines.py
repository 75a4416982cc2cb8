"""Spectral lines at known frequencies: least squares, the energy that they hold, and the mesh frequency itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gearbox.signals.signal import Signal, SignalError

__all__ = ["energy_share", "find_mesh_frequency", "fit_lines", "harmonics_in"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class LineFit:
    """Lines fitted to a signal: y(t) = mean + Σ Re(a_k e^{2πi f_k t}), t from the signal's first sample.

    Parameters
    ----------
    frequencies : ndarray, shape (m,), Hz
    amplitudes : ndarray of complex, shape (m,)
        Peak value and phase, in the signal's unit.
    mean : float
    share : float
        Share of the signal's variance in the lines, 0 to 1.
    residual_rms : float
        Root mean square of what is left.
    """

    frequencies: Array
    amplitudes: NDArray[np.complex128]
    mean: float
    share: float
    residual_rms: float

    def values_at(self, times: ArrayLike) -> Array:
        """The fitted lines at times from the first sample (s), without the mean."""
        t = np.asarray(times, dtype=float)
        values = np.zeros(t.shape)
        for f, a in zip(self.frequencies, self.amplitudes, strict=True):
            values += a.real * np.cos(2.0 * np.pi * f * t) - a.imag * np.sin(2.0 * np.pi * f * t)
        return values


def fit_lines(signal: Signal, frequencies: ArrayLike) -> LineFit:
    """Fit lines of given frequencies by least squares.

    Parameters
    ----------
    signal : Signal
    frequencies : array_like, shape (m,), Hz
        Above zero, below the Nyquist frequency, further apart than the signal can resolve.

    Raises
    ------
    SignalError
        If a frequency is outside or two cannot be told apart in the signal's length.
    """
    f = np.atleast_1d(np.asarray(frequencies, dtype=float))
    wrong = f[(f <= 0.0) | (f >= signal.nyquist)]
    if wrong.size:
        raise SignalError(
            f"no line at {wrong[0]:g} Hz can be fitted to '{signal.name}' sampled at {signal.rate:g} Hz: lines must "
            f"lie between 0 and {signal.nyquist:g} Hz"
        )
    if f.size > 1 and np.diff(np.sort(f)).min() < 0.5 / signal.duration:
        close = np.sort(f)[np.diff(np.sort(f)).argmin()]
        raise SignalError(
            f"lines near {close:g} Hz lie closer than {0.5 / signal.duration:.3g} Hz, which a signal of "
            f"{signal.duration:.3g} s cannot tell apart: leave one out or take a longer signal"
        )
    t = np.arange(len(signal)) / signal.rate
    phase = 2.0 * np.pi * t[:, None] * f
    columns = np.hstack([np.ones((t.size, 1)), np.cos(phase), -np.sin(phase)])
    # The columns are almost orthogonal, so that the normal equations lose nothing, at a fraction of the cost of a QR.
    solution = np.linalg.solve(columns.T @ columns, columns.T @ signal.values)
    residual = signal.values - columns @ solution
    centred = signal.values - signal.values.mean()
    total = float(centred @ centred)
    share = 1.0 - float(residual @ residual) / total if total > 0.0 else 0.0
    amplitudes = solution[1 : 1 + f.size] + 1j * solution[1 + f.size :]
    return LineFit(
        frequencies=f,
        amplitudes=amplitudes,
        mean=float(solution[0]),
        share=max(share, 0.0),
        residual_rms=float(np.sqrt(np.mean(residual**2))),
    )


def harmonics_in(fundamental: float, low: float, high: float) -> Array:
    """Multiples of a frequency within a band, Hz.

    Examples
    --------
    >>> harmonics_in(533.33, 300.0, 1200.0)
    array([ 533.33, 1066.66])
    """
    if not fundamental > 0.0:
        raise SignalError(f"a mesh frequency of {fundamental} Hz has no harmonics: give a number above zero")
    orders = np.arange(max(1, int(np.ceil(low / fundamental))), int(np.floor(high / fundamental)) + 1)
    return np.asarray(orders * fundamental)


def energy_share(signal: Signal, frequencies: ArrayLike) -> float:
    """Share of a signal's variance that stands at the given frequencies, 0 to 1."""
    return fit_lines(signal, frequencies).share


def find_mesh_frequency(
    signal: Signal, nominal: float, *, within: float = 0.02, harmonics: Sequence[int] = (1, 2, 3, 4, 5)
) -> float:
    """Find the mesh frequency near its nominal value: where harmonics hold the most energy.

    Parameters
    ----------
    signal : Signal
    nominal : float, Hz
        z₁ times the nominal shaft frequency.
    within : float
        Search range as a share of the nominal value.
    harmonics : sequence of int
        Orders that are looked at together; those above the Nyquist frequency are left out.

    Returns
    -------
    float
        Hz; resolved to about a hundredth of 1/duration where the lines stand out of the noise.

    Raises
    ------
    SignalError
        If not even one harmonic lies below the Nyquist frequency.
    """
    from scipy.optimize import minimize_scalar

    orders = np.array([k for k in harmonics if k * nominal * (1.0 + within) < signal.nyquist])
    if not orders.size or not nominal > 0.0:
        raise SignalError(
            f"a mesh frequency of {nominal:g} Hz cannot be looked for in '{signal.name}' sampled at {signal.rate:g} Hz"
        )
    centred = signal.values - signal.values.mean()
    window = np.hanning(centred.size + 2)[1:-1]
    padded = 8 * 2 ** int(np.ceil(np.log2(centred.size)))
    power = np.abs(np.fft.rfft(centred * window, padded)) ** 2
    step = signal.rate / padded
    grid = np.arange(nominal * (1.0 - within), nominal * (1.0 + within), step / orders.max() / 2.0)
    bins = np.rint(np.multiply.outer(grid, orders) / step).astype(int)
    guess = grid[int(power[np.minimum(bins, power.size - 1)].sum(axis=1).argmax())]

    # The lines are turned to rest once and summed in blocks, over which the small rest of the search hardly turns them.
    blocks = min(256, centred.size // 8)
    edges = np.linspace(0, centred.size, blocks + 1).astype(int)[:-1]
    t = np.arange(centred.size) / signal.rate
    resting = np.array([np.add.reduceat(centred * window * np.exp(-2j * np.pi * k * guess * t), edges) for k in orders])
    middle = np.add.reduceat(t, edges) / np.add.reduceat(np.ones_like(t), edges)

    def loss(f: float) -> float:
        turn = np.exp(-2j * np.pi * np.multiply.outer(orders * (f - guess), middle))
        return -float((np.abs((resting * turn).sum(axis=1)) ** 2).sum())

    reach = 1.0 / signal.duration
    bounds = (guess - reach / orders.max(), guess + reach / orders.max())
    optimum = minimize_scalar(loss, bounds=bounds, method="bounded", options={"xatol": 1e-5 * reach})
    return float(optimum.x)
