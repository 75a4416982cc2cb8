"""The process in which a foreign unit runs: it loads the unit, answers questions, and may crash alone.

Started by `multibody.fmi.foreign` as ``python -m multibody.fmi.server FMU IN OUT`` with two file descriptors.  All that
passes through them is float64 numbers in SI.  A question is its kind, time, states, inputs and parameters, and one
along a direction goes on with the direction in these.  The answer is 0 and what was asked for, or the length of a text
that follows, which says why there is no answer.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from multibody.fmi.errors import FmuError
from multibody.fmi.foreign_description import ForeignUnit, ForeignVariable, read_unit

__all__ = ["EVALUATE", "SLOPES", "START", "serve"]

#: Kinds of questions: rates and outputs; these, and their derivatives along a direction; states at the start.
EVALUATE, SLOPES, START = 0.0, 1.0, 2.0
_STEP = float(np.finfo(float).eps) ** (1 / 3)  # relative step of central differences: truncation against rounding
_WARNING, _DISCARD = 1, 2  # states of both versions of the standard


def serve(path: str, source: int, sink: int) -> None:
    """Answer questions until the other side closes its end.

    Parameters
    ----------
    path : str
        The unit.
    source, sink : int
        File descriptors.
    """
    folder = tempfile.mkdtemp(prefix="vtsdt_fmu_")
    try:
        try:
            running = Running(read_unit(path), folder)
        except Exception as error:
            _refuse(sink, 1, error)
            return
        _send(sink, np.zeros(1))
        size, count = running.now.size, running.result.size
        request = np.empty(2 * size)
        answers: dict[float, tuple[int, Callable[[np.ndarray], np.ndarray]]] = {
            EVALUATE: (count, running.evaluate),
            SLOPES: (2 * count, running.slopes),
            START: (running.states, running.start),
        }
        memory = request.data.cast("B")
        while _receive(source, memory, 8 * (1 + size)):
            if request[0] == SLOPES and not _receive(source, memory[8 * (1 + size) :], 8 * (size - 1)):
                return
            length, answer = answers[float(request[0])]
            try:
                numbers = np.empty(1 + length)
                numbers[0], numbers[1:] = 0.0, answer(request[1:])
                _send(sink, numbers)
            except Exception as error:
                _refuse(sink, 1 + length, error)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _receive(source: int, memory: memoryview, count: int) -> bool:
    at = 0
    while at < count:
        got = os.readv(source, [memory[at:count]])
        if not got:
            return False
        at += got
    return True


def _send(sink: int, numbers: np.ndarray) -> None:
    data = numbers.data.cast("B")
    while data:
        data = data[os.write(sink, data) :]


def _refuse(sink: int, count: int, error: Exception) -> None:
    text = (f"{error}" or type(error).__name__).encode()
    _send(sink, np.array([float(len(text))] + [0.0] * (count - 1)))
    _send(sink, np.frombuffer(text, dtype=np.uint8))


class Running:
    """One instance of a unit in Model Exchange, in continuous-time mode between questions.

    Parameters
    ----------
    unit : ForeignUnit
    folder : str
        Where its files are unpacked.
    """

    def __init__(self, unit: ForeignUnit, folder: str) -> None:
        import fmpy

        self.unit = unit
        fmpy.extract(str(unit.path), folder)
        described = fmpy.read_model_description(folder, validate=False)
        self.fmu: Any = fmpy.instantiate_fmu(folder, described, fmi_type="ModelExchange")
        self.second = unit.fmi_version == "2.0"
        known = (*unit.states, *unit.inputs, *unit.parameters)
        self.states = len(unit.states)
        self.first_input, self.first_parameter = 1 + self.states, 1 + self.states + len(unit.inputs)
        self.factor, self.offset = _scales(known, 1)
        self.out_factor, self.out_offset = _scales(unit.outputs, self.states)
        self.out_factor[: self.states] = [v.factor for v in unit.states]
        self.result_in_si = bool(np.all(self.out_factor == 1.0) and np.all(self.out_offset == 0.0))
        self.known_in_si = bool(np.all(self.factor == 1.0) and np.all(self.offset == 0.0))
        self.nominal = np.array([1.0, *(abs((v.start - v.offset) / v.factor) or 1.0 for v in known)])
        self.now = np.full(1 + len(known), np.nan)
        self.result = np.empty(self.states + len(unit.outputs))
        self.references = [0, *(v.reference for v in known)]
        self.parameters = b""
        self.point = b""  # where `result` and `columns` hold
        self.columns: dict[int, np.ndarray] = {}
        # of how many of what is known, from the first state on, the unit gives derivatives itself
        self.exact = len(known) if unit.exact_parameters else self.first_parameter - 1 if unit.derivatives else 0
        self.along, self.exactly = np.zeros(len(known)), np.empty(self.result.size)
        self.fresh = True
        self._bind()

    def _bind(self) -> None:
        """Prepare the calls that every question makes: FMPy's own take ten times as long as the unit."""
        unit, second, component = self.unit, self.second, ctypes.c_void_p(self._component())
        prefix = "fmi2" if second else "fmi3"

        def call(name: str, *types: Any) -> Any:
            function = self.fmu.dll[f"{prefix}{name}"]
            function.restype, function.argtypes = ctypes.c_int, [ctypes.c_void_p, *types]

            def called(*given: Any) -> int:
                status = int(function(component, *given))
                if status > _DISCARD:
                    raise FmuError(f"{prefix}{name} answers with status {status}")
                return status

            return called

        at, size, references = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p
        self._keep: list[Any] = [
            (ctypes.c_uint32 * max(1, len(group)))(*(v.reference for v in group))
            for group in (unit.inputs, unit.outputs, unit.parameters)
        ]
        of_inputs, of_outputs, of_parameters = map(ctypes.addressof, tuple(self._keep))
        x = self.now.ctypes.data + 8
        u, p = x + 8 * self.states, self.now.ctypes.data + 8 * self.first_parameter
        dx = self.result.ctypes.data
        y, n = dx + 8 * self.states, self.states
        n_u, n_y, n_p = len(unit.inputs), len(unit.outputs), len(unit.parameters)
        kind = "Real" if second else "Float64"
        numbers: tuple[Any, ...] = (references, size, at) if second else (references, size, at, size)

        def of(count: int) -> tuple[int, ...]:
            return () if second else (count,)  # the third version asks for the number of values once more

        set_values, get_values = call(f"Set{kind}", *numbers), call(f"Get{kind}", *numbers)
        set_states = call("SetContinuousStates", at, size)
        get_rates = call("GetDerivatives" if second else "GetContinuousStateDerivatives", at, size)
        self._set_time = call("SetTime", ctypes.c_double)
        self._set_states = lambda: set_states(x, n) if n else 0
        self._set_inputs = lambda: set_values(of_inputs, n_u, u, *of(n_u)) if n_u else 0
        self._set_parameters = lambda: set_values(of_parameters, n_p, p, *of(n_p)) if n_p else 0
        self._get_rates = lambda: get_rates(dx, n) if n else 0
        self._get_outputs = lambda: get_values(of_outputs, n_y, y, *of(n_y)) if n_y else 0
        if unit.derivatives:
            many: tuple[Any, ...] = (references, size, references, size, at, *(() if second else (size,)), at)
            self._derivative = call("GetDirectionalDerivative", *many, *(() if second else (size,)))
        unknown = (*unit.rates, *(v.reference for v in unit.outputs))
        of_unknown = np.array([*unknown, 0], dtype=np.uint32)
        of_known = np.array([*self.references[1:], 0], dtype=np.uint32)
        self._keep += [of_unknown, of_known]
        self._derivative_arguments = (
            of_unknown.ctypes.data, len(unknown), of_known.ctypes.data, self.exact,
            self.along.ctypes.data, *of(self.exact), self.exactly.ctypes.data, *of(len(unknown)),
        )  # fmt: skip

    def _component(self) -> int:
        given = self.fmu.component
        return int(getattr(given, "value", given) or 0)

    def _start(self) -> None:
        """Initialise the instance with the parameters that are now given."""
        fmu = self.fmu
        if not self.fresh:
            fmu.reset()
        self.fresh = False
        if self.second:
            fmu.setupExperiment(startTime=0.0)
            self._set_parameters()
            fmu.enterInitializationMode()
        else:
            self._set_parameters()
            fmu.enterInitializationMode(startTime=0.0)
        fmu.exitInitializationMode()
        self._settle()
        self.parameters = self._parameter_bytes()

    def _settle(self) -> None:
        """Leave event mode for continuous time."""
        again = True
        while again:
            again = (self.fmu.newDiscreteStates if self.second else self.fmu.updateDiscreteStates)()[0]
        self.fmu.enterContinuousTimeMode()

    def _parameter_bytes(self) -> bytes:
        return self.now[self.first_parameter :].tobytes()

    def _take(self, given: np.ndarray) -> None:
        """Take time, states, inputs and parameters, SI."""
        if self.known_in_si:
            self.now[:] = given
        else:
            np.subtract(given, self.offset, out=self.now)
            self.now /= self.factor

    def start(self, given: np.ndarray) -> np.ndarray:
        """Return the states, SI, after the unit's own initialization with the given parameters."""
        self._take(given[: self.now.size])
        self.point = b""
        self._start()
        references = [v.reference for v in self.unit.states]
        found = np.array((self.fmu.getReal if self.second else self.fmu.getFloat64)(references), dtype=float)
        n = 1 + self.states
        return found * self.factor[1:n] + self.offset[1:n]

    def evaluate(self, given: np.ndarray) -> np.ndarray:
        """Return rates and outputs, SI, at time, states, inputs, parameters; nan where the unit discards the point."""
        self._arrive(given[: self.now.size])
        return self._in_si(self.result)

    def _in_si(self, result: np.ndarray) -> np.ndarray:
        return result if self.result_in_si else result * self.out_factor + self.out_offset

    def _arrive(self, given: np.ndarray) -> None:
        point = given.tobytes()
        if point != self.point:
            self._take(given)
            self._evaluate()
            self.point, self.columns = point, {}

    def _evaluate(self) -> None:
        """Compute `result` at what is now given."""
        parameters = self._parameter_bytes()
        if parameters != self.parameters:
            if self.fresh or not self._only_tunable_changed():
                self._start()
            else:
                self.fmu.enterEventMode()
                self._set_parameters()
                self._settle()
                self.parameters = parameters
        elif self.fresh:
            self._start()
        status = self._set_time(self.now[0])
        status = max(status, self._set_states(), self._set_inputs())
        if max(status, self._get_rates(), self._get_outputs()) > _WARNING:
            self.result[:] = np.nan

    def _only_tunable_changed(self) -> bool:
        changed = np.flatnonzero(self.now[self.first_parameter :] != np.frombuffer(self.parameters))
        return all(self.unit.parameters[k].tunable for k in changed.tolist())

    def slopes(self, given: np.ndarray) -> np.ndarray:
        """Return rates and outputs, and then their derivatives along a direction in states, inputs and parameters."""
        size = self.now.size
        self._arrive(given[:size])
        along = self.along
        np.divide(given[size : 2 * size - 1], self.factor[1:], out=along)
        slopes = np.zeros(self.result.size)
        if self.exact:
            if self._derivative(*self._derivative_arguments) > _WARNING:
                self.exactly[:] = np.nan
            slopes += self.exactly
        for k in (np.flatnonzero(along[self.exact :]) + self.exact).tolist():
            # at one point many directions are asked for: each column is taken once
            if k not in self.columns:
                self.columns[k] = self._difference(1 + k)
            slopes += self.columns[k] * along[k]
        return np.concatenate([self._in_si(self.result), slopes * self.out_factor])

    def _difference(self, k: int) -> np.ndarray:
        """Return a column of the Jacobian by central differences, in the unit's own numbers."""
        here, value = self.now[k], self.result.copy()
        h = _STEP * max(abs(here), self.nominal[k])
        sides = []
        for side in (here + h, here - h):
            self.now[k] = side
            self._evaluate()
            sides.append(self.result.copy())
        self.now[k] = here
        self._evaluate()
        self.result[:] = value
        return (sides[0] - sides[1]) / ((here + h) - (here - h))


def _scales(variables: tuple[ForeignVariable, ...], before: int) -> tuple[np.ndarray, np.ndarray]:
    """Return factors and offsets of variables that stand behind some numbers in SI."""
    factor, offset = np.ones(before + len(variables)), np.zeros(before + len(variables))
    factor[before:], offset[before:] = [v.factor for v in variables], [v.offset for v in variables]
    return factor, offset


def _end_with_parent() -> None:
    """End this process when its parent has ended: a unit that hangs sees no closed pipe."""
    parent = os.getppid()
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(1)


def _main() -> None:
    os.dup2(2, 1)  # what the unit prints is no answer
    threading.Thread(target=_end_with_parent, daemon=True).start()
    serve(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))


if __name__ == "__main__":
    try:
        _main()
    except (BrokenPipeError, KeyboardInterrupt, FmuError):
        os._exit(1)
