"""Errors of the sensors: offset, gain, drift and delay of an output, and the derivatives by them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["SensorError", "apply_sensors"]

SENSOR_KINDS = ("offset", "gain", "drift", "delay")


@dataclass(frozen=True)
class SensorError:
    """An error of the sensor of one output: ``y = (1 + gain)·ŷ(t − delay) + offset + drift·t``.

    Parameters
    ----------
    output : str
    kind : {"offset", "gain", "drift", "delay"}
        Unit: that of the output, 1, that of the output per s, and s.
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
        offset, gain, drift, delay = (value.get(f"sensor.{output}.{kind}", 0.0) for kind in SENSOR_KINDS)
        rate = np.gradient(y[:, c], time) if f"sensor.{output}.delay" in by_sensors or delay else None
        if delay:
            late = time - delay
            y[:, c] = np.interp(late, time, y[:, c])
            for k in range(dy.shape[2]):
                dy[:, c, k] = np.interp(late, time, dy[:, c, k])
        derivatives = {
            "offset": np.ones_like(time),
            "gain": y[:, c],
            "drift": elapsed,
            "delay": -(1.0 + gain) * rate if rate is not None else None,
        }
        for kind, derivative in derivatives.items():
            if derivative is not None and f"sensor.{output}.{kind}" in by_sensors:
                by_sensors[f"sensor.{output}.{kind}"][:, c] = derivative
        y[:, c] = (1.0 + gain) * y[:, c] + offset + drift * elapsed
        dy[:, c] *= 1.0 + gain
    return y, dy, by_sensors
