"""The process in which a foreign unit runs: it loads the unit, answers requests, and may crash alone.

Started by `multibody.fmi.foreign` as ``python -m multibody.fmi.server FMU FD FOLDER``; the unit is unpacked into the
folder, which this process removes unless it is killed (then its parent does).  A request is one byte and float64
numbers: time, states, inputs, parameters, and then, of a Jacobian, the places of the columns wanted among the last
three; of the start the parameters alone.  Those to a unit that is stepped: see `multibody.fmi.stepping`.  The answer is
one byte, ``+`` and float64 numbers or ``-`` and a text.  Numbers are those of the unit, not SI.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import sys
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from multibody.fmi.errors import FmuError
from multibody.fmi.foreign_description import ForeignUnit, read_unit
from multibody.fmi.stepping import BEGIN, STEPS, SteppedUnit, references, values_of

__all__ = ["COLUMNS", "EVALUATE", "START", "serve"]

EVALUATE, COLUMNS, START = b"E", b"C", b"S"
_STEP = float(np.finfo(float).eps) ** (1 / 3)  # relative step of central differences: truncation against rounding


def serve(path: str, connection: Connection, folder: str) -> None:
    """Answer requests until the other side closes the connection."""
    try:
        try:
            answers = _answers(read_unit(path), folder)
            connection.send_bytes(b"+")
        except Exception as error:
            connection.send_bytes(b"-" + f"{error}".encode())
            return
        while True:
            try:
                request = connection.recv_bytes()
            except EOFError:
                return
            try:
                numbers = np.frombuffer(request, offset=1) if len(request) > 1 else np.empty(0)
                connection.send_bytes(b"+" + answers[request[:1]](numbers).tobytes())
            except Exception as error:
                connection.send_bytes(b"-" + f"{error}".encode())
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _answers(unit: ForeignUnit, folder: str) -> dict[bytes, Callable[[np.ndarray], np.ndarray]]:
    """Return what answers each request."""
    if unit.stepped:
        stepped = SteppedUnit(unit, folder)
        return {BEGIN: stepped.begin, STEPS: stepped.steps}
    running = _Running(unit, folder)
    return {EVALUATE: running.evaluate, COLUMNS: running.columns, START: running.start}


class _Running:
    """One instance of a unit in Model Exchange, in continuous-time mode between requests."""

    def __init__(self, unit: ForeignUnit, folder: str) -> None:
        import fmpy

        self.unit = unit
        fmpy.extract(str(unit.path), folder)
        self.described = fmpy.read_model_description(folder, validate=False)
        self.fmu: Any = fmpy.instantiate_fmu(folder, self.described, fmi_type="ModelExchange")
        self.second = unit.fmi_version == "2.0"
        self.sizes = [len(g) for g in (unit.states, unit.inputs, unit.parameters)]
        self.ends = np.cumsum([1, *self.sizes])
        self.inputs, self.parameters, self.outputs, self.states = (
            references(g) for g in (unit.inputs, unit.parameters, unit.outputs, unit.states)
        )
        groups = (unit.states, unit.inputs, unit.parameters)
        self.nominal = np.concatenate([[abs(v.start) or 1.0 for v in g] for g in groups])
        self.p = np.full(len(unit.parameters), np.nan)
        self.rates, self.x, self.u, self.y = (
            np.empty(len(g)) for g in (unit.states, unit.states, unit.inputs, unit.outputs)
        )
        self.unknown = (ctypes.c_uint32 * (len(unit.rates) + len(self.outputs)))(*unit.rates, *self.outputs)
        self.known = [v for g in groups for v in g]
        self.fresh = True

    def _start(self, p: np.ndarray) -> None:
        """Initialise the instance with these parameters."""
        fmu = self.fmu
        if not self.fresh:
            fmu.reset()
        self.fresh = False
        if self.second:
            fmu.setupExperiment(startTime=0.0)
            self._set(self.parameters, p)
            fmu.enterInitializationMode()
            fmu.exitInitializationMode()
            again = True
            while again:
                again = fmu.newDiscreteStates()[0]
        else:
            self._set(self.parameters, p)
            fmu.enterInitializationMode(startTime=0.0)
            fmu.exitInitializationMode()
            again = True
            while again:
                again = fmu.updateDiscreteStates()[0]
        fmu.enterContinuousTimeMode()
        self.p = p.copy()

    def _set(self, references: list[int], values: np.ndarray) -> None:
        if references:
            (self.fmu.setReal if self.second else self.fmu.setFloat64)(references, list(map(float, values)))

    def _go_to(self, numbers: np.ndarray) -> None:
        """Set time, states, inputs and parameters."""
        a, b, c, _ = self.ends
        p = numbers[c:]
        changed = np.flatnonzero(p != self.p)
        if self.fresh or any(not self.unit.parameters[k].tunable for k in changed):
            self._start(p)
        elif changed.size:
            self.fmu.enterEventMode()
            moved = {self.unit.parameters[k].reference for k in changed}  # an array is set as a whole
            chosen = [k for k, v in enumerate(self.unit.parameters) if v.reference in moved]
            self._set(references([self.unit.parameters[k] for k in chosen]), p[chosen])
            again = True
            while again:
                again = (self.fmu.newDiscreteStates if self.second else self.fmu.updateDiscreteStates)()[0]
            self.fmu.enterContinuousTimeMode()
            self.p = p.copy()
        self.fmu.setTime(float(numbers[0]))
        self.x[:] = numbers[a:b]
        if self.x.size:
            self.fmu.setContinuousStates(_pointer(self.x), self.x.size)
        self._set(self.inputs, numbers[b:c])

    def start(self, p: np.ndarray) -> np.ndarray:
        """Return the states after the unit's own initialization with these parameters."""
        self._start(p)
        return values_of(self.fmu, self.states, len(self.unit.states))

    def evaluate(self, numbers: np.ndarray) -> np.ndarray:
        """Return rates and outputs at time, states, inputs, parameters."""
        self._go_to(numbers)
        fmu = self.fmu
        if self.outputs:  # before the rates: units by OpenModelica compute no outputs once they have computed rates
            self.y[:] = values_of(fmu, self.outputs, self.y.size)
        if self.rates.size:
            (fmu.getDerivatives if self.second else fmu.getContinuousStateDerivatives)(
                _pointer(self.rates), self.rates.size
            )
        return np.concatenate([self.rates, self.y])

    def columns(self, numbers: np.ndarray) -> np.ndarray:
        """Return rates and outputs, and then columns of their Jacobian one after another."""
        size = int(self.ends[-1])
        at, wanted = numbers[:size], numbers[size:].astype(int)
        first_parameter = int(self.ends[2]) - 1
        exact = [self.unit.exact_parameters if k >= first_parameter else self.unit.derivatives for k in wanted]
        differences = {k: self._difference(at, k) for k, e in zip(wanted, exact, strict=True) if not e}
        value = self.evaluate(at)
        parts = [self._derivative(k) if e else differences[k] for k, e in zip(wanted, exact, strict=True)]
        return np.concatenate([value, *parts])

    def _derivative(self, k: int) -> np.ndarray:
        """Return a column by the unit's own directional derivatives."""
        out, fmu, n, v = np.empty(self.rates.size + self.y.size), self.fmu, len(self.unknown), self.known[k]
        known, seed = (ctypes.c_uint32 * 1)(v.reference), (ctypes.c_double * v.size)()
        seed[v.element] = 1.0
        if self.second:
            fmu.fmi2GetDirectionalDerivative(fmu.component, self.unknown, n, known, 1, seed, _pointer(out))
        else:
            result = _pointer(out), out.size
            fmu.fmi3GetDirectionalDerivative(fmu.component, self.unknown, n, known, 1, seed, v.size, *result)
        return out

    def _difference(self, at: np.ndarray, k: int) -> np.ndarray:
        """Return a column by central differences."""
        h = _STEP * max(abs(at[1 + k]), self.nominal[k])
        above, below = at.copy(), at.copy()
        above[1 + k] += h
        below[1 + k] -= h
        return (self.evaluate(above) - self.evaluate(below)) / (above[1 + k] - below[1 + k])


def _pointer(array: np.ndarray) -> Any:
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


def _end_with_parent(folder: str) -> None:
    """End this process when its parent has ended: a unit that hangs sees no closed connection."""
    parent = os.getppid()
    while os.getppid() == parent:
        time.sleep(1.0)
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)


def _main() -> None:
    os.dup2(2, 1)  # what the unit prints is no answer
    path, descriptor, folder = sys.argv[1:]
    threading.Thread(target=_end_with_parent, args=(folder,), daemon=True).start()
    serve(path, Connection(int(descriptor)), folder)


if __name__ == "__main__":
    try:
        _main()
    except (BrokenPipeError, KeyboardInterrupt, FmuError):
        os._exit(1)
