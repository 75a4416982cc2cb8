"""The virtual entity of the updating chain: a function from parameters and operating condition to vibration.

A healthy stage at constant speed and load repeats with the mesh.  A short settled run then holds everything: its
complex amplitudes at the mesh lines give the signal at any time, length and rate.  :class:`Run` keeps these, or the
signals themselves where the model does not repeat.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gearbox.files.operating_condition import OperatingCondition
from gearbox.signals.mesh_lines import fit_lines
from gearbox.signals.signal import Signal, SignalError

__all__ = ["Run", "Settings", "VibrationModel", "run_model"]

#: ``model(values, condition, duration)`` returns settled signals by sensor, ``duration`` s long.
VibrationModel = Callable[[Mapping[str, float], OperatingCondition, float], Mapping[str, Signal]]

#: Share of the signal's RMS that a run which is said to repeat with the mesh may hold off the mesh lines.
PERIODIC_LIMIT = 0.02


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How a virtual model is run.

    Parameters
    ----------
    driving_teeth : int
        z₁, from which the mesh frequency follows.
    periodic : bool
        The model repeats with the mesh: a short run is enough.
    periods : int
        Mesh periods of such a short run.
    harmonics : int
        Highest mesh order kept.
    duration : float, s
        Length of a run that is not periodic.
    """

    driving_teeth: int
    periodic: bool = True
    periods: int = 24
    harmonics: int = 24
    duration: float = 0.6

    def length(self, condition: OperatingCondition) -> float:
        """Length of signal wanted at a condition, s."""
        return self.periods / condition.mesh_frequency(self.driving_teeth) if self.periodic else self.duration


@dataclass(frozen=True, eq=False, kw_only=True)
class Run:
    """What a virtual model gave for one set of parameters at one condition.

    Parameters
    ----------
    values : mapping of str to float
        Parameters.
    condition : OperatingCondition
    mesh_frequency : float, Hz
    amplitudes : mapping of str to ndarray of complex, shape (m,)
        By sensor: mesh orders 1 … m, peak value and phase at time zero; empty if the run failed.
    units : mapping of str to str
    means : mapping of str to float
        By sensor, in its unit.
    off_mesh : float
        Largest share of a sensor's RMS that is not at mesh lines.
    seconds : float
        Computing time.
    error : str
        Why the run failed; empty if it did not.
    signals : mapping of str to Signal
        The signals themselves, if the model does not repeat with the mesh.
    """

    values: Mapping[str, float]
    condition: OperatingCondition
    mesh_frequency: float
    amplitudes: Mapping[str, NDArray[np.complex128]]
    units: Mapping[str, str]
    means: Mapping[str, float] = field(default_factory=dict)
    off_mesh: float = 0.0
    seconds: float = 0.0
    error: str = ""
    signals: Mapping[str, Signal] = field(default_factory=dict)

    @property
    def failed(self) -> bool:
        """Whether there is no signal."""
        return bool(self.error)

    def signal(self, sensor: str, rate: float, duration: float) -> Signal:
        """The sensor's signal, from its mesh lines or as it was simulated.

        Raises
        ------
        SignalError
            If there is no such sensor, or the run is too short.
        """
        if sensor in self.signals:
            return self.signals[sensor].cut(0.0, duration)
        if sensor not in self.amplitudes:
            raise SignalError(f"the model has no sensor '{sensor}'; it has {', '.join(self.amplitudes) or 'none'}")
        lines = self.amplitudes[sensor]
        orders = np.arange(1, lines.size + 1)
        kept = orders * self.mesh_frequency < 0.5 * rate
        t = np.arange(round(duration * rate)) / rate
        turned = np.exp(2j * np.pi * self.mesh_frequency * t)
        # Horner's scheme: one multiplication for each order instead of a cosine.
        total = np.zeros(t.size, dtype=complex)
        for a in lines[kept][::-1]:
            total = (total + a) * turned
        return Signal(total.real, rate, name=sensor, unit=self.units.get(sensor, ""))

    def to_dict(self) -> dict[str, Any]:
        """Plain content, for a line of JSON; signals are kept elsewhere."""
        return {
            "values": dict(self.values),
            "speed_rpm": self.condition.speed_rpm,
            "load_Nm": self.condition.load_Nm,
            "condition": self.condition.name,
            "mesh_frequency": self.mesh_frequency,
            "amplitudes": {s: [[float(a.real), float(a.imag)] for a in lines] for s, lines in self.amplitudes.items()},
            "units": dict(self.units),
            "means": dict(self.means),
            "off_mesh": self.off_mesh,
            "seconds": self.seconds,
            "error": self.error,
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any], signals: Mapping[str, Signal] | None = None) -> Run:
        """Read what :meth:`to_dict` wrote."""
        return cls(
            values=content["values"],
            condition=OperatingCondition(content["speed_rpm"], content["load_Nm"], content["condition"]),
            mesh_frequency=content["mesh_frequency"],
            amplitudes={s: np.array([complex(*a) for a in lines]) for s, lines in content["amplitudes"].items()},
            units=content["units"],
            means=content.get("means", {}),
            off_mesh=content["off_mesh"],
            seconds=content["seconds"],
            error=content["error"],
            signals=signals or {},
        )


def run_model(
    model: VibrationModel, values: Mapping[str, float], condition: OperatingCondition, settings: Settings
) -> Run:
    """Run a virtual model once and keep what the chain needs of it.

    A run that fails (no equilibrium, a step that will not converge, numbers that are not finite) is returned as failed
    with the reason: one bad corner of the parameters must not cost a whole design.
    """
    begun = time.perf_counter()
    mesh = condition.mesh_frequency(settings.driving_teeth)
    try:
        signals = dict(model(values, condition, settings.length(condition)))
        if not signals:
            raise SignalError("the model returned no signal")
        amplitudes, means, off = {}, {}, 0.0
        for sensor, signal in signals.items():
            highest = min(settings.harmonics, int(0.98 * signal.nyquist / mesh))
            if highest < 1:
                raise SignalError(
                    f"the model's signal '{sensor}' is sampled at {signal.rate:g} Hz, below twice the mesh frequency"
                )
            fit = fit_lines(signal, mesh * np.arange(1, highest + 1))
            amplitudes[sensor], means[sensor] = fit.amplitudes, fit.mean
            # Off the mesh is what no harmonic explains, those above the highest kept included.
            varying = float(np.std(signal.values))
            off = max(off, fit.residual_rms / varying if varying > 0.0 else 0.0)
        units = {sensor: signal.unit for sensor, signal in signals.items()}
    except (ValueError, ArithmeticError, RuntimeError) as error:
        text = f"{type(error).__name__}: {error}"
        return Run(
            values=dict(values),
            condition=condition,
            mesh_frequency=mesh,
            amplitudes={},
            units={},
            off_mesh=0.0,
            seconds=time.perf_counter() - begun,
            error=text,
        )
    spent = time.perf_counter() - begun
    kept = {} if settings.periodic else signals
    return Run(
        values=dict(values),
        condition=condition,
        mesh_frequency=mesh,
        amplitudes=amplitudes,
        units=units,
        means=means,
        off_mesh=off,
        seconds=spent,
        error="",
        signals=kept,
    )
