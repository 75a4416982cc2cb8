"""Many runs of a machine at once: every quantity has an entry for each run, which shares NumPy's cost per call."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from discrepancy.validation.machines.machine import Channel, Drive, Machine

__all__ = ["rk4", "simulate"]

Array = NDArray[np.float64]

END = 1.0 - 1e-9  # of a step: a drive that is held still has its value there


def rk4(rates: Callable[..., Any]) -> Callable[..., Array]:
    """Return a step of the classical Runge–Kutta method for ``rates(x, u, w, p)``; drives move along the step."""

    def step(x: Array, drives: Callable[[float], Any], w: Any, p: Any, h: float) -> Array:
        begin, middle, end = (drives(part) for part in (0.0, 0.5, 1.0))
        k_1 = np.stack(rates(x, begin, w, p))
        k_2 = np.stack(rates(x + 0.5 * h * k_1, middle, w, p))
        k_3 = np.stack(rates(x + 0.5 * h * k_2, middle, w, p))
        k_4 = np.stack(rates(x + h * k_3, end, w, p))
        return x + h / 6.0 * (k_1 + 2.0 * (k_2 + k_3) + k_4)

    return step


def _blank_values(machine: Machine) -> dict[str, float]:
    """Return all quantities of the equations: stated parameters, constants, and every effect absent."""
    values: dict[str, float] = {**machine.constants}
    values |= {start.name: 0.0 for start in machine.starts}
    values |= {p.name: p.stated for p in machine.parameters}
    for signal in (*(c.name for c in machine.channels), *(d.name for d in machine.drives)):
        values |= {f"{signal}_{error}": 0.0 for error in ("offset", "gain", "delay", "drift")}
    for effect in machine.effects:
        values[effect.strength] = 0.0
        values |= {name: 0.5 * (low + high) for name, (low, high) in effect.shape.items()}
    return values


def simulate(
    machine: Machine,
    values: Mapping[str, Any],
    drives: Mapping[str, Array],
    disturbance: Mapping[str, Array] | None = None,
    noise: Mapping[str, Array] | None = None,
) -> dict[str, Array]:
    """Run a machine and return what its sensors record.

    Parameters
    ----------
    machine : Machine
    values : mapping of str to float or ndarray, shape (runs,)
        Quantities of the equations that differ from the stated ones.
    drives : mapping of str to ndarray, shape (rows, runs)
    disturbance : mapping of str to ndarray, shape (rows, runs), optional
        Unrecorded forces by place.
    noise : mapping of str to ndarray, shape (rows, runs), optional
        Noise by channel.  Without it nothing is quantised either.

    Returns
    -------
    dict of str to ndarray, shape (rows, runs)
        By channel, SI.

    Raises
    ------
    FloatingPointError
        If a run leaves the finite numbers.
    """
    rows, runs = next(iter(drives.values())).shape
    p = SimpleNamespace(**{k: np.broadcast_to(v, runs) for k, v in ({**_blank_values(machine), **values}).items()})
    x = np.stack([np.broadcast_to(each, runs).astype(float) for each in machine.start(p)])
    silence = np.zeros(runs)
    signals = {d.name: _Received(d, np.asarray(drives[d.name]), p, machine.dt) for d in machine.drives}
    true: dict[str, list[Array]] = {c.name: [] for c in machine.channels}
    memory: Any = None
    given: dict[str, Array] = {}
    h = machine.dt / machine.substeps
    for row in range(rows):
        u = {name: s(row, 0.0) for name, s in signals.items()}
        if machine.control is not None:
            seen = machine.observe(x, {**u, **given}, p)
            measured = {
                c.name: _read(c, seen[c.name], None if noise is None else noise[c.name][row]) for c in machine.channels
            }
            memory, given = machine.control(memory, measured, u, p)
        now = machine.observe(x, {**u, **given}, p)
        for name, column in true.items():
            column.append(now[name])
        w = {place: silence if disturbance is None else disturbance.get(place, _NONE)[row] for place in machine.places}
        for k in range(machine.substeps if row + 1 < rows else 0):

            def along(part: float, row: int = row, k: int = k, given: dict[str, Array] = given) -> dict[str, Array]:
                now = (k + min(part, END)) / machine.substeps
                return {name: s(row, now) for name, s in signals.items()} | given

            x = machine.step(x, along, w, p, h)
    if not np.isfinite(x).all():
        raise FloatingPointError(f"{machine.name}: a run left the finite numbers; give it more substeps")
    t = np.asarray(machine.dt * np.arange(rows), dtype=np.float64)[:, None]
    recorded = {}
    for c in machine.channels:
        exact = _with_errors(np.stack([np.broadcast_to(v, runs) for v in true[c.name]]), c, p, t)
        recorded[c.name] = _read(c, exact, None if noise is None else noise[c.name])
    return recorded


class _Silent:
    """A disturbance that is not there, at any row."""

    def __getitem__(self, row: int) -> float:
        return 0.0


_NONE: Any = _Silent()


class _Received:
    """What reaches the machine of a drive, with the input's errors."""

    def __init__(self, drive: Drive, column: Array, p: SimpleNamespace, dt: float) -> None:
        gain, offset = (getattr(p, f"{drive.name}_{error}") for error in ("gain", "offset"))
        self.column, self.hold = column * (1.0 + gain) + offset, drive.hold
        self.late = getattr(p, f"{drive.name}_delay") / dt
        self.is_late = bool(np.any(self.late != 0.0))
        self.runs = np.arange(column.shape[1])

    def __call__(self, row: int, part: float) -> Array:
        last = len(self.column) - 1
        if not self.is_late:
            here = self.column[row]
            return here if self.hold or part == 0.0 else here + part * (self.column[min(row + 1, last)] - here)
        place = np.clip(row + part - self.late, 0.0, last)
        below = np.floor(place).astype(int)
        here = self.column[below, self.runs]
        if self.hold:
            return here
        return here + (place - below) * (self.column[np.minimum(below + 1, last), self.runs] - here)


def _with_errors(column: Array, channel: Channel, p: SimpleNamespace, t: Array) -> Array:
    """Return a channel's true values with the errors of its sensor.

    A late one is read between the samples from the spline through them: a polygon would also smooth, as a lag does.
    """
    gain, offset, delay, drift = (getattr(p, f"{channel.name}_{e}") for e in ("gain", "offset", "delay", "drift"))
    if np.any(delay != 0.0):
        time = t[:, 0]
        late = [
            CubicSpline(time, column[:, k])(np.clip(time - d, time[0], time[-1]))
            for k, d in enumerate(np.broadcast_to(delay, column.shape[1]))
        ]
        column = np.column_stack(late)
    return column * (1.0 + gain) + offset + drift * t


def _read(channel: Channel, true: Array, noise: Array | None) -> Array:
    """Return what a sensor reads; without noise the true value."""
    if noise is None:
        return true
    value = true + noise
    return np.round(value / channel.quantum) * channel.quantum if channel.quantum else value
