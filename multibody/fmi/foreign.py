"""Foreign units at work: each runs in a process of its own, which equations ask for rates, outputs and derivatives."""

from __future__ import annotations

import atexit
import contextlib
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from functools import lru_cache
from multiprocessing import Pipe
from pathlib import Path

import numpy as np

from multibody.base.errors import SimulationError
from multibody.fmi.foreign_description import ForeignVariable, read_unit
from multibody.fmi.scratch_folder import ScratchFolder
from multibody.fmi.server import COLUMNS, EVALUATE, START
from multibody.fmi.stepping import BEGIN, STEPS

__all__ = ["TIMEOUT", "CoSimulation", "Refusal", "cosimulation", "evaluate", "start_states", "tangent"]

#: Seconds after which a unit that does not answer counts as hung; an evaluation takes microseconds.
TIMEOUT = 60.0
#: The same for the start of its process, which imports fmpy and loads the unit.
START_TIMEOUT = 120.0
#: Communication steps that one question asks for: an answer stays far below the time limit.
_STEPS_AT_ONCE = 500

_running: dict[tuple[str, str, int], _Process] = {}
_lock = threading.RLock()


class Refusal(SimulationError):
    """A unit answers, with an error: its process goes on."""


class _Process:
    """A unit's process, and what converts numbers between SI and the unit's own."""

    def __init__(self, path: str) -> None:
        self.path = Path(path)
        if os.name != "posix":
            raise SimulationError(
                f"the FMU '{self.path.name}' cannot run: its process inherits a pipe, as on Linux and macOS"
            )
        self.unit = unit = read_unit(path)
        self.connection, theirs = Pipe()
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
        self.folder = ScratchFolder()
        command = [sys.executable, "-m", "multibody.fmi.server", path, str(theirs.fileno()), str(self.folder.path)]
        self.process = subprocess.Popen(
            command,
            pass_fds=[fd for fd in (theirs.fileno(), self.folder.descriptor) if fd is not None],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            env=environment,
        )
        theirs.close()
        known = (*unit.states, *unit.inputs, *unit.parameters)
        self.known_factor, self.known_offset = _scales(known)
        rate_factor = np.array([v.factor for v in unit.states])
        out_factor, out_offset = _scales(unit.outputs)
        self.factor = np.concatenate([rate_factor, out_factor])
        self.offset = np.concatenate([np.zeros(rate_factor.size), out_offset])
        self.point = b""
        self.values = np.empty(0)
        self.columns: dict[int, np.ndarray] = {}
        self.used: set[int] = set()
        try:
            self._answer(START_TIMEOUT)
        except SimulationError:
            self.stop()
            raise

    def values_at(self, t: float, known: tuple[float, ...]) -> np.ndarray:
        """Return rates and outputs at a point, SI; the last point is remembered."""
        point = self._point(t, known)
        if point != self.point:
            self._arrive(point, self._ask(EVALUATE + point))
        return self.values

    def slopes_at(self, t: float, known: tuple[float, ...], along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rates and outputs at a point and their derivatives along a direction, SI.

        Integration along many directions asks for the same columns of the Jacobian at each point: those that the last
        point needed are fetched together, so that all directions cost one question.
        """
        point = self._point(t, known)
        moved = set(np.flatnonzero(along).tolist())
        before = self.used if point != self.point else set()
        have = self.columns if point == self.point else {}
        if point != self.point or not moved <= have.keys():
            wanted = sorted((moved | before) - have.keys())
            answer = self._ask(COLUMNS + point + np.array(wanted, dtype=float).tobytes())
            count = self.factor.size
            if point != self.point:
                self._arrive(point, answer[:count])
            for j, k in enumerate(wanted):
                self.columns[k] = answer[(1 + j) * count : (2 + j) * count] * self.factor / self.known_factor[k]
        self.used |= moved
        slopes = np.zeros(self.factor.size)
        for k in moved:
            slopes += self.columns[k] * along[k]
        return self.values, slopes

    def start(self) -> np.ndarray:
        """Return the states with which the unit starts, SI."""
        n = len(self.unit.states)
        factor, offset = _scales(self.unit.parameters)
        own = (np.array([v.start for v in self.unit.parameters]) - offset) / factor
        found = self._ask(START + own.tobytes())
        return found * self.known_factor[:n] + self.known_offset[:n]

    def ask_steps(self, request: bytes) -> np.ndarray:
        """Return the answer to a request of `multibody.fmi.stepping`: rows of outputs, SI."""
        answer = self._ask(request).reshape(-1, len(self.unit.outputs))
        return answer * self.factor + self.offset

    def _point(self, t: float, known: tuple[float, ...]) -> bytes:
        own = (np.array(known) - self.known_offset) / self.known_factor
        return np.concatenate([[t], own]).tobytes()

    def _arrive(self, point: bytes, answer: np.ndarray) -> None:
        self.point, self.values, self.columns = point, answer * self.factor + self.offset, {}
        self.used = set()

    def _ask(self, request: bytes) -> np.ndarray:
        try:
            self.connection.send_bytes(request)
            return self._answer(TIMEOUT)
        except (BrokenPipeError, ConnectionError) as error:
            raise self._died() from error

    def _answer(self, limit: float) -> np.ndarray:
        if not self.connection.poll(limit):
            self.stop()
            raise SimulationError(f"the FMU '{self.path.name}' has not answered for {limit:g} s: it was stopped")
        try:
            answer = self.connection.recv_bytes()
        except (EOFError, ConnectionError) as error:
            raise self._died() from error
        if answer[:1] == b"-":
            raise Refusal(f"the FMU '{self.path.name}' refuses: {answer[1:].decode(errors='replace')}")
        return np.frombuffer(answer, offset=1) if len(answer) > 1 else np.empty(0)

    def _died(self) -> SimulationError:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(5.0)
        code = self.process.poll()
        self.stop()
        how = f"by signal {-code}" if code is not None and code < 0 else f"with code {code}"
        return SimulationError(f"the process of the FMU '{self.path.name}' has ended {how}: the fault is in the unit")

    def stop(self) -> None:
        """End the process; the next question starts another."""
        with _lock:
            for key in [k for k, v in _running.items() if v is self]:
                del _running[key]
        with contextlib.suppress(OSError):
            self.connection.close()
        if self.process.poll() is None:
            self.process.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(5.0)
        self.folder.remove()


def _scales(variables: tuple[ForeignVariable, ...]) -> tuple[np.ndarray, np.ndarray]:
    return np.array([v.factor for v in variables]), np.array([v.offset for v in variables])


def _process(path: str, digest: str) -> _Process:
    key = path, digest, os.getpid()  # a forked process must not share a pipe
    with _lock:
        if key not in _running:
            _running[key] = _Process(path)
        return _running[key]


class CoSimulation:
    """A unit that is stepped, from one begin to the next; `cosimulation` gives it, to one thread at a time."""

    def __init__(self, process: _Process) -> None:
        self._process, self.unit = process, process.unit
        self._factor, self._offset = _scales(self.unit.inputs)

    def begin(self, start: float, end: float, inputs: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """Initialise the unit with inputs and parameters and return its outputs, all in SI."""
        factor, offset = _scales(self.unit.parameters)
        own = (inputs - self._offset) / self._factor, (parameters - offset) / factor
        return self._process.ask_steps(BEGIN + np.concatenate([[start, end], *own]).tobytes())[0]

    def steps(self, times: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Step from each time to the next and return the outputs at the later ones, shape (n - 1, n_y).

        Parameters
        ----------
        times : ndarray, shape (n,), s
        first, last : ndarray, shape (n - 1, n_u)
            Inputs at the beginning and at the end of each step, straight between; SI.
        """
        size = np.diff(times)[:, None]
        begin, end = (first - self._offset) / self._factor, (last - self._offset) / self._factor
        slopes = (end - begin) / size
        held = begin if self.unit.communication.slopes else 0.5 * (begin + end)  # whose mean is right
        rows = np.hstack([times[:-1, None], size, held, slopes, end])
        parts = range(0, len(rows), _STEPS_AT_ONCE)
        return np.concatenate([self._process.ask_steps(STEPS + rows[k : k + _STEPS_AT_ONCE].tobytes()) for k in parts])


@contextlib.contextmanager
def cosimulation(path: str, digest: str) -> Iterator[CoSimulation]:
    """Give a unit's process to be stepped; others wait.

    Raises
    ------
    SimulationError
        As `evaluate`.
    """
    with _lock:
        yield CoSimulation(_process(path, digest))


@atexit.register
def _stop_all() -> None:
    for (_, _, owner), one in list(_running.items()):
        if owner == os.getpid():
            one.stop()


@lru_cache(maxsize=16)
def start_states(path: str, digest: str) -> tuple[float, ...]:
    """Return the states that a unit has after its own initialization, SI, with the parameters of its description.

    Raises
    ------
    SimulationError
        As `evaluate`.
    """
    with _lock:
        return tuple(map(float, _process(path, digest).start()))


def evaluate(path: str, digest: str, wanted: tuple[int, ...], t: float, known: tuple[float, ...]) -> tuple[float, ...]:
    """Return rates and outputs of a unit, SI.

    Parameters
    ----------
    path, digest : str
        The file, and its digest when the model was built.
    wanted : tuple of int
        Places among rates and outputs.
    t : float, s
    known : tuple of float
        States, inputs and parameters, SI.

    Raises
    ------
    SimulationError
        If the unit refuses, does not answer, or its process has ended.
    """
    with _lock:
        values = _process(path, digest).values_at(t, known)
    return tuple(float(values[k]) for k in wanted)


def tangent(
    path: str, digest: str, wanted: tuple[int, ...], t: float, known: tuple[float, ...], known_dot: tuple[float, ...]
) -> tuple[float, ...]:
    """Return rates and outputs, and then their derivatives along a direction; otherwise as `evaluate`."""
    with _lock:
        values, slopes = _process(path, digest).slopes_at(t, known, np.array(known_dot))
    return tuple(float(values[k]) for k in wanted) + tuple(float(slopes[k]) for k in wanted)
