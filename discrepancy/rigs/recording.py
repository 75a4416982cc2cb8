"""What any virtual rig adds to a model: a disturbance, wrong parameters, sensors and a logger.

A rig is a model richer than the one under test.  It runs with another integrator at other tolerances, a coloured force
disturbs it, its parameters differ from the nominal ones, and its signals pass through sensors and a logger.
`discrepancy.rigs.hidden_effects` puts effects into it; `discrepancy.rigs.axis` is the rig of a linear axis, and the
rigs of other machines are made of the same parts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from estimation.files.record import Record, RecordedSignal
from estimation.fit.calibrate import UncertainParameter
from estimation.response.sensors import lagged

if TYPE_CHECKING:
    from estimation.response.sensors import SensorError

__all__ = [
    "BenchError",
    "Channel",
    "Logger",
    "RigDisturbance",
    "perturb",
    "record_of",
]


class BenchError(ValueError):
    """Settings that a virtual rig refuses; ``faults`` holds one sentence for each fault."""

    def __init__(self, faults: Sequence[str]) -> None:
        self.faults: tuple[str, ...] = tuple(dict.fromkeys(faults))
        head = "" if len(self.faults) == 1 else f"{len(self.faults)} faults:\n  - "
        super().__init__(head + "\n  - ".join(self.faults))


@dataclass(frozen=True)
class RigDisturbance:
    """A coloured force that no model describes: a resonance of second order and a slow drift, equal in power.

    Parameters
    ----------
    size : float
        Root mean square, N or N m; 0 for none.
    frequency : float, Hz
        Of the resonance, an AR(2) process.
    damping : float
        Its damping ratio.
    time : float, s
        Correlation time of the drift, an Ornstein-Uhlenbeck process.
    """

    size: float = 3.0
    frequency: float = 5.0
    damping: float = 0.3
    time: float = 0.5

    def __post_init__(self) -> None:
        faults = (
            []
            if np.isfinite(self.size) and self.size >= 0.0
            else [f"the disturbance is {self.size}: give its root mean square, zero or more"]
        )
        faults += [
            f"{name} of the disturbance is {value}: give a number above zero"
            for name, value in (("frequency", self.frequency), ("damping", self.damping), ("time", self.time))
            if not (np.isfinite(value) and value > 0.0)
        ]
        if faults:
            raise BenchError(faults)

    def draw(self, count: int, step: float, rng: np.random.Generator) -> np.ndarray:
        """Return a realisation, shape (count,), sampled every ``step`` s, stationary from the start."""
        from scipy.signal import lfilter

        r = np.exp(-self.damping * 2.0 * np.pi * self.frequency * step)
        turn = 2.0 * np.pi * self.frequency * np.sqrt(max(1.0 - self.damping**2, 0.0)) * step
        a1, a2 = -2.0 * r * np.cos(turn), r * r
        # Variance of an AR(2) process with unit innovations: Box, Jenkins: Time Series Analysis, 3.2.4.
        variance = (1.0 + a2) / ((1.0 - a2) * ((1.0 + a2) ** 2 - a1 * a1))
        phi = np.exp(-step / self.time)
        warm = int(8.0 * max(self.time, 1.0 / (2.0 * np.pi * self.frequency * self.damping)) / step)
        white = rng.standard_normal((2, count + warm))
        swing = lfilter([1.0], [1.0, a1, a2], white[0])[warm:] / np.sqrt(variance)
        drift = lfilter([np.sqrt(1.0 - phi * phi)], [1.0, -phi], white[1])[warm:]
        return np.asarray(self.size * np.sqrt(0.5) * (swing + drift))


@dataclass(frozen=True, kw_only=True)
class Channel:
    """How a rig records one quantity.

    Parameters
    ----------
    signal : str
        Output or input of the model.
    column : str
        Column in the file.
    unit, measured_unit : str
        SI unit, and unit of the numbers in the file.
    noise : float
        Standard deviation of white noise, SI.
    resolution : float
        Step of the digital reading, in the unit of the file.
    analogue : bool
        The channel has an anti-alias filter; digital ones (encoders) are read as they are.
    exact : bool
        The logger takes the value from the controller's memory: no noise and no jitter.
    """

    signal: str
    column: str
    unit: str
    measured_unit: str
    noise: float = 0.0
    resolution: float = 0.0
    analogue: bool = False
    exact: bool = False


@dataclass(frozen=True)
class Logger:
    """The logger of a rig.

    Parameters
    ----------
    rate : float, Hz
        At which rows are written; their time stamps are even.
    fine : int
        Samples of the simulation for each row.
    jitter : float, s
        Standard deviation of the true instants about the time stamps.
    cutoff : float
        Anti-alias cutoff (−6 dB) as a share of half the rate; linear phase, delay taken out.
    """

    rate: float = 500.0
    fine: int = 8
    jitter: float = 5e-6
    cutoff: float = 0.8

    @property
    def margin(self) -> float:
        """Time before and after the record that the filter needs, s."""
        return 24.0 / self.rate

    def stamps(self, duration: float) -> np.ndarray:
        """Return the time stamps of a record, s."""
        return np.arange(round(duration * self.rate) + 1) / self.rate

    def fine_grid(self, duration: float, before: float) -> np.ndarray:
        """Return the instants at which the rig is to be simulated, from ``-before`` to past the end, s."""
        step = 1.0 / (self.rate * self.fine)
        return np.arange(-round(before / step), round((duration + self.margin) / step) + 1) * step

    def read(
        self,
        channel: Channel,
        time: np.ndarray,
        values: np.ndarray,
        stamps: np.ndarray,
        rng: np.random.Generator,
        errors: Sequence[SensorError] = (),
    ) -> np.ndarray:
        """Return what is written for a channel, in the unit of the file.

        Parameters
        ----------
        channel : Channel
        time, values : ndarray, shape (n_fine,)
            The true signal, SI, on the fine grid.
        stamps : ndarray, shape (n,), s
        rng : Generator
        errors : sequence of SensorError
            Errors of the sensors: ``(1 + gain)·y(t − delay) + offset + drift·t``, y behind the lag.
        """
        from multibody.base.units import convert

        size: dict[str, float] = {}
        for error in errors:
            if error.output == channel.signal:
                size[error.kind] = size.get(error.kind, 0.0) + error.value
        # Always drawn, so that hiding an effect changes nothing else.
        shake, noise = rng.standard_normal((2, stamps.size))
        if lag := size.get("lag", 0.0):
            values = lagged(time, values, lag)
        if channel.analogue:
            values = self._low_pass(values)
        instants = stamps - size.get("delay", 0.0)
        if not channel.exact:
            instants = instants + self.jitter * shake
        read = (1.0 + size.get("gain", 0.0)) * np.interp(instants, time, values)
        read = read + size.get("offset", 0.0) + size.get("drift", 0.0) * (stamps - stamps[0])
        read = convert(read + channel.noise * noise, channel.unit, channel.measured_unit)
        if channel.resolution:
            read = np.round(read / channel.resolution) * channel.resolution
        return np.asarray(read)

    def _low_pass(self, values: np.ndarray) -> np.ndarray:
        from scipy.signal import fftconvolve, firwin

        taps = firwin(32 * self.fine + 1, self.cutoff / self.fine)
        half = taps.size // 2
        return np.asarray(fftconvolve(np.pad(values, half, mode="edge"), taps, mode="valid"))


def perturb(priors: Sequence[UncertainParameter], rng: np.random.Generator, reach: float = 2.0) -> dict[str, float]:
    """Return true values of uncertain parameters: their priors, cut at ``reach`` standard deviations."""
    values = {}
    for parameter in priors:
        z = rng.standard_normal()
        while abs(z) > reach:
            z = rng.standard_normal()
        values[parameter.name] = float(np.clip(parameter.value + parameter.std * z, parameter.min, parameter.max))
    return values


def record_of(
    name: str, path: Path, stamps: np.ndarray, columns: Mapping[str, np.ndarray], channels: Sequence[Channel]
) -> Record:
    """Return recorded columns as a record in SI, as a reader would make it from the file."""
    from multibody.base.units import convert

    signals = {
        c.signal: RecordedSignal(
            values=convert(columns[c.column], c.measured_unit, c.unit),
            unit=c.unit,
            column=c.column,
            measured_unit=c.measured_unit,
        )
        for c in channels
    }
    return Record(name=name, path=path, time=stamps, signals=signals, log=("made by a virtual rig",))
