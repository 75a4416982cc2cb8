"""Foreign units at work: each runs in a process of its own, which equations ask for rates, outputs and derivatives.

A question takes some hundred microseconds.  Work that asks often, an integration or Jacobians along a trajectory, is
done in the process of the unit, where the equations around it are compiled as those of any model are.
"""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import os
import pickle
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import lru_cache
from multiprocessing import Pipe
from pathlib import Path
from typing import Any

import numpy as np

from multibody.base.errors import SimulationError
from multibody.base.stopping import raise_if_stopped
from multibody.compile.hosts import Host
from multibody.fmi.answering import Answer
from multibody.fmi.foreign_description import ForeignVariable, read_unit
from multibody.fmi.messages import ANSWER, FAILURE, PIECE, PULSE, REFUSAL, unpacked
from multibody.fmi.scratch_folder import ScratchFolder
from multibody.fmi.server import EVALUATE, GO_ON, START, WORK, WORK_IN_PIECES
from multibody.fmi.stepping import BEGIN, STEPS

__all__ = ["TIMEOUT", "CoSimulation", "Refusal", "ask", "cosimulation", "host_of", "key_of", "start_states"]

#: Seconds without an answer and without a sign of life, after which a unit counts as hung.
TIMEOUT = 60.0
#: The same for the start of its process, which imports fmpy and loads the unit.
START_TIMEOUT = 120.0
#: Communication steps that one question asks for: an answer stays far below the time limit.
_STEPS_AT_ONCE = 500

_running: dict[tuple[str, str, int], _Process] = {}
_files: dict[int, tuple[str, str]] = {}
_lock = threading.RLock()
#: Seconds after which a thread that waits for an answer looks whether the command is to end.
_LOOK = 0.5


class Refusal(SimulationError):
    """A unit answers, with an error: its process goes on."""


class _Process:
    """A unit's process; what passes through its connection is said in `multibody.fmi.server`."""

    def __init__(self, path: str) -> None:
        self.path = Path(path)
        if os.name != "posix":
            raise SimulationError(
                f"the FMU '{self.path.name}' cannot run: its process inherits a pipe, as on Linux and macOS"
            )
        self.unit = read_unit(path)
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
        try:
            with self._one_exchange():
                self._answer(START_TIMEOUT)
        except Refusal:  # to begin
            self.stop()
            raise

    def evaluate(self, wanted: int, given: np.ndarray) -> np.ndarray:
        """Return what is asked for at a point, SI; see `multibody.fmi.asking`."""
        return np.frombuffer(self.ask(EVALUATE + np.concatenate([[wanted], given]).tobytes()))

    def work(self, function: Callable[..., Any], given: tuple[Any, ...], receive: Callable[..., None] | None) -> Any:
        """Return what a function returns, which runs in the process; see `multibody.compile.hosts.Host.do`."""
        data = pickle.dumps((function, given))
        return unpacked(self.ask((WORK if receive is None else WORK_IN_PIECES) + data, receive))

    def start(self) -> np.ndarray:
        """Return the states with which the unit starts, SI."""
        factor, offset = _scales(self.unit.parameters)
        own = (np.array([v.start for v in self.unit.parameters]) - offset) / factor
        factor, offset = _scales(self.unit.states)
        return np.frombuffer(self.ask(START + own.tobytes())) * factor + offset

    def ask_steps(self, request: bytes) -> np.ndarray:
        """Return the answer to a request of `multibody.fmi.stepping`: rows of outputs, SI."""
        factor, offset = _scales(self.unit.outputs)
        return np.frombuffer(self.ask(request)).reshape(-1, factor.size) * factor + offset

    def ask(self, request: bytes, receive: Callable[..., None] | None = None) -> bytes:
        """Return the answer to a request.

        Raises
        ------
        Refusal
            If the unit answers with an error.
        SimulationError
            If the work fails, the process does not answer, or has ended.
        """
        with self._one_exchange():
            self.connection.send_bytes(request)
            while True:
                kind, answer = self._answer(TIMEOUT)
                if kind != PIECE:
                    return answer
                if receive is not None:
                    receive(*unpacked(answer))
                self.connection.send_bytes(GO_ON)

    @contextlib.contextmanager
    def _one_exchange(self) -> Iterator[None]:
        """End the process where an exchange is broken off: what is left of it would be taken for the next answer."""
        try:
            yield
        except (BrokenPipeError, ConnectionError, EOFError) as error:
            raise self._died() from error
        except (Refusal, _Failure):
            raise  # which is an answer
        except BaseException:
            self.stop()
            raise

    def _answer(self, limit: float) -> tuple[bytes, bytes]:
        waited_since = time.monotonic()
        while True:
            if not self.connection.poll(_LOOK):
                raise_if_stopped()
                if time.monotonic() - waited_since > limit:
                    raise SimulationError(
                        f"the FMU '{self.path.name}' has not answered for {limit:g} s: it was stopped"
                    )
                continue
            answer = self.connection.recv_bytes()
            kind, rest = answer[:1], answer[1:]
            if kind in (ANSWER, PIECE):
                return kind, rest
            if kind == REFUSAL:
                raise Refusal(f"the FMU '{self.path.name}' refuses: {rest.decode(errors='replace')}")
            if kind == FAILURE:
                raise _Failure(rest.decode(errors="replace"))
            if kind == PULSE:
                waited_since = time.monotonic()

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


class _Failure(SimulationError):
    """Work in the process of a unit fails; the unit is not to blame."""


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
        As `ask`.
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
        As `ask`.
    """
    with _lock:
        return tuple(map(float, _process(path, digest).start()))


def key_of(path: str, digest: str) -> int:
    """Return the number under which equations ask a unit."""
    key = int(hashlib.sha256(f"{digest} {path}".encode()).hexdigest()[:15], 16)
    _files[key] = path, digest
    return key


def ask(key: int, wanted: int, place: int, given: np.ndarray) -> Answer:
    """Return what a unit answers; arguments as of `multibody.fmi.asking`.

    Raises
    ------
    SimulationError
        If the unit refuses, does not answer, or its process has ended.
    """
    with _lock:
        return Answer(_process(*_files[key]).evaluate(wanted, given))


class _Host:
    """The process of one file, whenever it runs."""

    def __init__(self, path: str, digest: str) -> None:
        self.path, self.digest = path, digest

    def do(self, work: Callable[..., Any], *given: Any, receive: Callable[..., None] | None = None) -> Any:
        """Do work in it: see `multibody.compile.hosts.Host`."""
        with _lock:
            return _process(self.path, self.digest).work(work, given, receive)


@lru_cache(maxsize=64)
def host_of(path: str, digest: str) -> Host:
    """Return the process in which equations with a unit are compiled."""
    return _Host(path, digest)


def _after_fork() -> None:
    """Take a new lock: a thread that had the old one is not in this process."""
    global _lock
    _lock = threading.RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
