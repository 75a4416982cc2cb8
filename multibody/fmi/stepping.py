"""A unit that is stepped (Co-Simulation), inside its own process: begun with its parameters, and taken step by step.

`multibody.fmi.server` answers `BEGIN` and `STEPS` with it; `multibody.fmi.communication` asks.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from multibody.fmi.foreign_description import ForeignUnit, ForeignVariable

__all__ = ["BEGIN", "STEPS", "SteppedUnit", "references", "values_of"]

#: Requests.  BEGIN: time, end, inputs, parameters; the answer is the outputs.  STEPS: of each step its begin and size,
#: the inputs in it, their slopes, and the inputs at its end; the answer is the outputs after each step.
BEGIN, STEPS = b"B", b"D"


def references(variables: Sequence[ForeignVariable]) -> list[int]:
    """Return the references of variables; the elements of an array have one, and stand together."""
    return [v.reference for v in variables if v.element == 0]


def values_of(fmu: Any, which: list[int], count: int) -> np.ndarray:
    """Return the values under some references, those of arrays element by element."""
    if not which:
        return np.empty(0)
    return np.array(fmu.getReal(which) if hasattr(fmu, "getReal") else fmu.getFloat64(which, count), dtype=float)


class SteppedUnit:
    """One instance of a unit in Co-Simulation."""

    def __init__(self, unit: ForeignUnit, folder: str) -> None:
        import fmpy

        self.unit = unit
        fmpy.extract(str(unit.path), folder)
        described = fmpy.read_model_description(folder, validate=False)
        self.fmu: Any = fmpy.instantiate_fmu(folder, described, fmi_type="CoSimulation")
        self.second = unit.fmi_version == "2.0"
        self.inputs, self.parameters, self.outputs = (
            references(g) for g in (unit.inputs, unit.parameters, unit.outputs)
        )
        self.fresh = True

    def begin(self, numbers: np.ndarray) -> np.ndarray:
        """Initialise the instance and return its outputs."""
        fmu, end = self.fmu, len(self.unit.inputs) + 2
        start, stop = float(numbers[0]), float(numbers[1])
        if not self.fresh:
            fmu.reset()
        self.fresh = False
        if self.second:
            fmu.setupExperiment(startTime=start, stopTime=stop)
        self._set(self.parameters, numbers[end:])
        self._set(self.inputs, numbers[2:end])
        if self.second:
            fmu.enterInitializationMode()
        else:
            fmu.enterInitializationMode(startTime=start, stopTime=stop)
        self._set(self.inputs, numbers[2:end])
        fmu.exitInitializationMode()
        return self._shown()

    def steps(self, numbers: np.ndarray) -> np.ndarray:
        """Take communication steps and return the outputs after each, one after another."""
        n, fmu = len(self.unit.inputs), self.fmu
        shown = []
        for row in numbers.reshape(-1, 2 + 3 * n):
            self._set(self.inputs, row[2 : 2 + n])
            if n and self.unit.communication.slopes:
                fmu.setRealInputDerivatives(self.inputs, [1] * n, row[2 + n : 2 + 2 * n].tolist())
            try:
                fmu.doStep(currentCommunicationPoint=float(row[0]), communicationStepSize=float(row[1]))
            except Exception as error:
                raise RuntimeError(f"the communication step of {row[1]:g} s at t = {row[0]:g} s: {error}") from error
            self._set(self.inputs, row[2 + 2 * n :])
            shown.append(self._shown())
        return np.concatenate(shown)

    def _set(self, which: list[int], values: np.ndarray) -> None:
        if which:
            (self.fmu.setReal if self.second else self.fmu.setFloat64)(which, values.tolist())

    def _shown(self) -> np.ndarray:
        return values_of(self.fmu, self.outputs, len(self.unit.outputs))
