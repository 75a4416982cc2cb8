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
        rate = np.gradient(y[:, c], time) if f"sensor.{output}.delay" in by_sensors or delay else None
        if delay:
            late = time - delay
            y[:, c] = np.interp(late, time, y[:, c])
            for k in range(dy.shape[2]):
                dy[:, c, k] = np.interp(late, time, dy[:, c, k])
            by_lag = np.interp(late, time, by_lag) if by_lag is not None else None
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
