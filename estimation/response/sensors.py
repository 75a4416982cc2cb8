"""Errors of the sensors: offset, gain, drift, delay and lag of an output, and the derivatives by them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["SensorError", "apply_sensors", "lagged"]

SENSOR_KINDS = ("offset", "gain", "drift", "delay", "lag")


@dataclass(frozen=True)
class SensorError:
    """An error of the sensor of one output: ``y = (1 + gain)·ŷ(t − delay) + offset + drift·t``, ŷ behind the lag.

    Parameters
    ----------
    output : str
    kind : {"offset", "gain", "drift", "delay", "lag"}
        Unit: that of the output, 1, that of the output per s, s, and s (time constant of a low-pass of first order).
    value : float
    """

    output: str
    kind: str
    value: float = 0.0

    @property
    def name(self) -> str:
        """Parameter name, such as ``"sensor.carriage.position.offset"``."""
        return f"sensor.{self.output}.{self.kind}"


def apply_sensors(
    outputs: Sequence[str],
    time: np.ndarray,
    y: np.ndarray,
    dy: np.ndarray,
    sensors: Sequence[SensorError],
    parameters: Sequence[str],
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Apply sensor errors to outputs and derivatives, and differentiate by the errors themselves.

    Parameters
    ----------
    outputs : sequence of str
        Names of the c outputs.
    time : ndarray, shape (nt,), s
    y : ndarray, shape (nt, c)
    dy : ndarray, shape (nt, c, m)
    sensors : sequence of SensorError
        Of an output that is late, the cubic spline through the samples is read between them.
    parameters : sequence of str
        Names of the sensor errors to differentiate by, such as ``"sensor.carriage.position.offset"``.

    Returns
    -------
    y, dy : ndarray
        As given, with the errors applied.
    by_sensors : dict of str to ndarray, shape (nt, c)
        Derivative of the outputs by each of ``parameters``.
    """
    if not sensors and not parameters:
        return y, dy, {}
    y, dy = y.copy(), dy if not sensors else dy.copy()
    value = {s.name: s.value for s in sensors}
    by_sensors = {name: np.zeros_like(y) for name in parameters}
    elapsed = time - time[0]
    for c, output in enumerate(outputs):
        offset, gain, drift, delay, lag = (value.get(f"sensor.{output}.{kind}", 0.0) for kind in SENSOR_KINDS)
        by_lag = _by_lag(time, y[:, c], lag) if f"sensor.{output}.lag" in by_sensors else None
        if lag:
            y[:, c] = lagged(time, y[:, c], lag)
            dy[:, c] = lagged(time, dy[:, c], lag)
        rate = None
        if delay or f"sensor.{output}.delay" in by_sensors:
            seen, rate = _late(time, y[:, c], delay)
            if delay:
                y[:, c] = seen
                dy[:, c] = _late(time, dy[:, c], delay)[0]
                by_lag = _late(time, by_lag, delay)[0] if by_lag is not None else None
        derivatives = {
            "offset": np.ones_like(time),
            "gain": y[:, c],
            "drift": elapsed,
            "delay": -(1.0 + gain) * rate if rate is not None else None,
            "lag": (1.0 + gain) * by_lag if by_lag is not None else None,
        }
        for kind, derivative in derivatives.items():
            if derivative is not None and f"sensor.{output}.{kind}" in by_sensors:
                by_sensors[f"sensor.{output}.{kind}"][:, c] = derivative
        y[:, c] = (1.0 + gain) * y[:, c] + offset + drift * elapsed
        dy[:, c] *= 1.0 + gain
    return y, dy, by_sensors


def _late(time: np.ndarray, u: np.ndarray, delay: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a signal and its rate ``delay`` earlier, shape (nt, ...) each; beyond both ends it is constant.

    Between samples it is the cubic spline through them: polygons shift a sine of a tenth of the sampling rate by 0.3 %
    of a sample and take 3 % of its size, monotone cubics (PCHIP) shift it by 1 %, the spline by 0.01 %.  It is linear
    in the signal, so that the derivative of the late signal is the late derivative.
    """
    from scipy.interpolate import CubicSpline

    at = time - delay
    if time.size < 2 or not np.isfinite(u).all():  # a run that broke off: nothing to draw a curve through
        return np.full_like(u, np.nan) if delay else u, np.full_like(u, np.nan)
    spline = CubicSpline(time, u, axis=0)
    inside = ((at >= time[0]) & (at <= time[-1])).reshape(-1, *[1] * (u.ndim - 1))
    return spline(np.clip(at, time[0], time[-1])), np.where(inside, spline(at, 1), 0.0)


def lagged(time: np.ndarray, u: np.ndarray, lag: float) -> np.ndarray:
    """Return a signal behind a low-pass of first order, exact for a signal that is straight between its points.

    The filter starts at rest at the first value.

    Parameters
    ----------
    time : ndarray, shape (nt,), s
    u : ndarray, shape (nt, ...)
    lag : float, s
        Time constant, positive.

    Examples
    --------
    >>> t = np.linspace(0.0, 3.0, 4)
    >>> lagged(t, t, 1.0).round(3)  # t - 1 + exp(-t)
    array([0.   , 0.368, 1.135, 2.05 ])
    """
    steps = np.diff(time) / lag
    keep = np.exp(-steps)
    slope = (1.0 - keep) / steps  # of a ramp from 0 to 1 within the step, 1 - slope reaches the output at its end
    shape = (-1, *[1] * (u.ndim - 1))
    gain_old, gain_new = (slope - keep).reshape(shape), (1.0 - slope).reshape(shape)
    driven = gain_old * u[:-1] + gain_new * u[1:]
    z = np.empty_like(u, dtype=float)
    z[0] = u[0]
    if steps.size and np.ptp(steps) <= 1e-6 * steps[0]:
        from scipy.signal import lfilter

        z[1:] = lfilter([1.0], [1.0, -keep[0]], driven, axis=0, zi=keep[0] * z[:1])[0]
    else:
        for k in range(steps.size):
            z[k + 1] = keep[k] * z[k] + driven[k]
    return z


def _by_lag(time: np.ndarray, u: np.ndarray, lag: float) -> np.ndarray:
    """Return the derivative of a lagged signal by its time constant; at zero that of a delay."""
    if not lag:
        return -np.gradient(u, time)
    return -lagged(time, (u - lagged(time, u, lag)) / lag, lag)
