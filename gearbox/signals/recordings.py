"""Measured recordings of a gear stage: the signals of one run with the condition that it was made at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gearbox.files.operating_condition import OperatingCondition
from gearbox.signals.mesh_lines import find_mesh_frequency
from gearbox.signals.signal import Signal, SignalError

if TYPE_CHECKING:
    from estimation.files.record import Record

__all__ = ["Recording"]


@dataclass(frozen=True, eq=False)
class Recording:
    """Signals of one run.

    Parameters
    ----------
    condition : OperatingCondition
        As the rig reports it; the speed is refined from the mesh lines by :meth:`matched`.
    signals : mapping of str to Signal
        By sensor.
    nominal : OperatingCondition, optional
        What the rig reported, after the speed was refined.
    """

    condition: OperatingCondition
    signals: Mapping[str, Signal]
    nominal: OperatingCondition | None = None

    @property
    def name(self) -> str:
        """What the recording is called."""
        return self.condition.label

    def __repr__(self) -> str:
        return f"Recording({self.name}; {', '.join(self.signals)})"

    def signal(self, sensor: str) -> Signal:
        """The signal of a sensor."""
        if sensor not in self.signals:
            raise SignalError(
                f"recording '{self.name}' has no sensor '{sensor}'; it has {', '.join(self.signals) or 'none'}"
            )
        return self.signals[sensor]

    def matched(self, driving_teeth: int, within: float = 0.02) -> Recording:
        """The recording with its speed from the mesh lines of all sensors, not from the speed that was reported.

        The model is then simulated at this speed, so that no stretching in time is needed.
        """
        nominal = self.condition.mesh_frequency(driving_teeth)
        frequencies, weights = [], []
        for signal in self.signals.values():
            mesh = find_mesh_frequency(signal, nominal, within=within)
            frequencies.append(mesh)
            weights.append(signal.rms**2)
        # All sensors see the same shaft: the median keeps one with poor lines from spoiling it.
        order = np.argsort(frequencies)
        share = np.cumsum(np.array(weights)[order]) / np.sum(weights)
        mesh = float(np.array(frequencies)[order][int(np.searchsorted(share, 0.5))])
        speed = 60.0 * mesh / driving_teeth
        return Recording(self.condition.at_speed(speed), self.signals, self.nominal or self.condition)

    @classmethod
    def from_record(cls, record: Record, sensors: Sequence[str], speed: str, load: str, name: str = "") -> Recording:
        """Make a recording from a record in SI.

        Parameters
        ----------
        record : Record
            Evenly sampled.
        sensors : sequence of str
            Signals of the record that are vibration.
        speed, load : str
            Signals that hold the input shaft's speed, rad/s, and the load torque on the output, N m; their means are
            taken.
        name : str
            By default the record's.
        """
        time = np.asarray(record.time)
        steps = np.diff(time)
        step = float(steps.mean())
        if np.abs(steps / step - 1.0).max() > 0.05:
            raise SignalError(f"recording '{record.name}' is not evenly sampled: resample it first")
        rpm = float(np.mean(record.signals[speed].values)) * 30.0 / np.pi
        torque = float(np.mean(record.signals[load].values))
        signals = {
            sensor: Signal(record.signals[sensor].values, 1.0 / step, name=sensor, unit=record.signals[sensor].unit)
            for sensor in sensors
        }
        return cls(OperatingCondition(abs(rpm), torque, name or record.name), signals)
