"""What a gear stage runs at: the speed of its input shaft and the load on its output shaft."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from estimation.signals.preparation import SignalError

__all__ = ["OperatingCondition"]


@dataclass(frozen=True)
class OperatingCondition:
    """Speed of the input shaft and torque on the output shaft.

    Parameters
    ----------
    speed_rpm : float
        r/min, above zero.
    load_Nm : float
        Load torque on the output shaft, N m.
    name : str
        What it is called in tables.

    Examples
    --------
    >>> OperatingCondition(1000.0, 150.0, "base").mesh_frequency(32)
    533.33...
    """

    speed_rpm: float
    load_Nm: float
    name: str = ""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.speed_rpm) and self.speed_rpm > 0.0):
            raise SignalError(f"speed {self.speed_rpm} r/min of condition '{self.name}': give a number above zero")
        if not np.isfinite(self.load_Nm):
            raise SignalError(f"load {self.load_Nm} N m of condition '{self.name}' is not a number")

    @property
    def shaft_frequency(self) -> float:
        """Rotation frequency of the input shaft, Hz."""
        return self.speed_rpm / 60.0

    def mesh_frequency(self, driving_teeth: int) -> float:
        """Tooth mesh frequency f_z = z₁ f_n1, Hz (gearbox paper, Eq. 3)."""
        return driving_teeth * self.shaft_frequency

    def at_speed(self, speed_rpm: float) -> OperatingCondition:
        """The same load at another speed."""
        return replace(self, speed_rpm=float(speed_rpm))

    @property
    def label(self) -> str:
        """Name, or speed and load."""
        return self.name or f"{self.speed_rpm:g} r/min, {self.load_Nm:g} N·m"
