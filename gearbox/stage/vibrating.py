"""The gear stage as the updating chain sees it: parameters and operating condition in, vibration out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gearbox.files.operating_condition import OperatingCondition
from gearbox.signals.signal import Signal
from gearbox.stage.stage import Stage, Structure

__all__ = ["RATE", "VibratingStage", "build"]

#: Sampling rate of simulated signals, Hz: that of the paper's measurement.
RATE = 25_600.0
#: The vibration is within 2e-4 of its RMS of that at a tolerance of 1e-7, at Table 2's point, at the updated one and at
#: C_D 860 N s/mm with e_F 2.5 (docs, "Gear stage", Speed).
_METHOD: dict[str, Any] = {"method": "auto", "rtol": 3e-5, "atol": 3e-9}
#: Time for the start to die away, s: the rigid housing's slowest motion then leaves 0.1 % off the mesh lines.
SETTLE = 0.3


class VibratingStage(Stage):
    """A gear stage with a method that the updating chain calls."""

    def vibration(
        self, values: Mapping[str, float], condition: OperatingCondition, duration: float, rate: float = RATE
    ) -> dict[str, Signal]:
        """Return settled signals of the accelerometers.

        Parameters
        ----------
        values : mapping of str to float
            ``K`` (N at 1 mm), ``C_D`` (N s/m), ``e_F``, ``D_P`` (m), ``E`` (Pa), ``rho`` (kg/m³) or full names of model
            parameters, SI.  ``E`` acts through K, and therefore not where K is given.
        condition : OperatingCondition
        duration : float, s
        rate : float, Hz
        """
        run = self.simulate(
            condition.speed_rpm, condition.load_Nm, duration, rate=rate, settle=SETTLE,
            parameters=self.values(**values), **_METHOD)  # fmt: skip
        names = [name for name in self.outputs if name.startswith("a_")]
        return {name: Signal(run[name], rate, name, "m/s**2") for name in names}


def build(
    housing: str = "flexible", imperfect: bool = False, bearing_defects: bool = False, slices: int = 0
) -> VibratingStage:
    """Return the paper's stage; keywords are those of :class:`gearbox.stage.stage.Structure`.

    It is what ``[model] build = "gearbox.stage.vibrating:build"`` of a study file names.
    """
    structure = Structure(housing=housing, imperfect=imperfect, bearing_defects=bearing_defects, slices=slices)
    return VibratingStage(None, structure)
