"""Foreign units at work: each runs in a process of its own, which equations ask for rates, outputs and derivatives."""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import hashlib
import os
import select
import subprocess
import sys
import threading
from functools import lru_cache
from pathlib import Path

import numpy as np

from multibody.base.errors import SimulationError
from multibody.fmi.foreign_description import read_unit
from multibody.fmi.server import EVALUATE, SLOPES, START

__all__ = ["EVALUATE", "SLOPES", "TABLE", "TIMEOUT", "handle", "key_of", "process_of", "start_states"]

#: Seconds after which a unit that does not answer counts as hung; an evaluation takes microseconds.
TIMEOUT = 60.0
#: The same for the start of its process, which imports fmpy and loads the unit.
START_TIMEOUT = 120.0

#: What compiled code knows of the processes (see `multibody.fmi.asking`): a row for each, zeros where there is none.
#: Its columns are key, file descriptors, addresses of memory, whether the answer in memory is that to the question in
#: memory, and how many milliseconds to wait.
TABLE = np.zeros((32, 9), dtype=np.int64)
KEY, OUT, IN, REQUEST, ANSWER, MUTEX, POLL, KNOWN, LIMIT = range(TABLE.shape[1])

#: What compiled code calls `handle` for.
INTERRUPTED, HUNG, DIED, REFUSED = range(4)

_MUTEX_BYTES = 64  # of a pthread_mutex_t; 40 on 64-bit Linux, 64 on macOS
_READABLE = 1  # POLLIN

_units: dict[int, tuple[str, str]] = {}
_running: dict[int, _Process] = {}
_ended: list[_Process] = []  # another thread may still look into their memory
_lock = threading.RLock()


def key_of(path: str, digest: str) -> int:
    """Return the number under which equations ask for a unit, and remember its file; its process starts when asked.

    Parameters
    ----------
    path, digest : str
        The file, and its digest when the model was built.
    """
    key = int(hashlib.sha256(f"{digest} {path}".encode()).hexdigest()[:15], 16) + 1
    _units[key] = path, digest
    return key


class _Process:
    """A unit's process, and the memory that questions and answers pass through."""

    def __init__(self, key: int, slot: int) -> None:
        path, _ = _units[key]
        self.path, self.slot = Path(path), slot
        if os.name != "posix":
            raise SimulationError(
                f"the FMU '{self.path.name}' cannot run: its process inherits pipes, as on Linux and macOS"
            )
        unit = read_unit(path)
        self.states = len(unit.states)
        self.size = 1 + self.states + len(unit.inputs) + len(unit.parameters)
        self.count = self.states + len(unit.outputs)
        theirs_in, self.out = os.pipe()
        self.back, theirs_out = os.pipe()
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
        command = [sys.executable, "-m", "multibody.fmi.server", str(path), str(theirs_in), str(theirs_out)]
        self.process = subprocess.Popen(
            command,
            pass_fds=[theirs_in, theirs_out],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            env=environment,
        )
        os.close(theirs_in)
        os.close(theirs_out)
        self.request, self.answer = np.empty(2 * self.size), np.empty(1 + 2 * self.count)
        self.waits = np.array([self.back, _READABLE], dtype=np.int32)  # a struct pollfd
        self.mutex = np.zeros(_MUTEX_BYTES, dtype=np.uint8)
        _c_library().pthread_mutex_init(ctypes.c_void_p(self.mutex.ctypes.data), None)
        row = TABLE[slot]
        row[OUT], row[IN], row[KNOWN], row[LIMIT] = self.out, self.back, 0, int(1000 * TIMEOUT)
        row[REQUEST], row[ANSWER] = self.request.ctypes.data, self.answer.ctypes.data
        row[MUTEX], row[POLL] = self.mutex.ctypes.data, self.waits.ctypes.data
        if length := int(self._received(1, START_TIMEOUT)[0]):
            refusal = self._refusal(length)
            self.stop()
            raise refusal
        row[KEY] = key

    def exchange(self, kind: float, given: np.ndarray, values: np.ndarray) -> None:
        """Ask from Python, as `multibody.fmi.asking.ask` does from compiled code.

        Raises
        ------
        SimulationError
            If the unit refuses, does not answer, or its process has ended.
        """
        mutex = ctypes.c_void_p(self.mutex.ctypes.data)
        _c_library().pthread_mutex_lock(mutex)
        try:
            TABLE[self.slot, KNOWN] = 0
            data = memoryview(np.concatenate([[kind], given]).tobytes())
            try:
                while data:
                    data = data[os.write(self.out, data) :]
            except OSError as error:
                raise self._died() from error
            answer = self._received(1 + values.size, TIMEOUT)
            if answer[0] != 0.0:
                raise self._refusal(int(answer[0]))
            values[:] = answer[1:]
        finally:
            _c_library().pthread_mutex_unlock(mutex)

    def _received(self, count: int, limit: float) -> np.ndarray:
        return np.frombuffer(self._bytes(8 * count, limit))

    def _bytes(self, count: int, limit: float) -> bytes:
        data = b""
        while len(data) < count:
            if not select.select([self.back], [], [], limit)[0]:
                raise self._hung(limit)
            part = os.read(self.back, count - len(data))
            if not part:
                raise self._died()
            data += part
        return data

    def handle(self, what: int) -> None:
        """Raise what has happened; return where it was only a signal."""
        if what == HUNG:
            raise self._hung(TIMEOUT)
        if what == REFUSED:
            raise self._refusal(int(self.answer[0]))
        if what == DIED or self.process.poll() is not None:
            raise self._died()

    def _refusal(self, length: int) -> SimulationError:
        text = self._bytes(length, TIMEOUT)
        return SimulationError(f"the FMU '{self.path.name}' refuses: {text.decode(errors='replace')}")

    def _hung(self, limit: float) -> SimulationError:
        self.stop()
        return SimulationError(f"the FMU '{self.path.name}' has not answered for {limit:g} s: it was stopped")

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
            TABLE[self.slot, KEY] = 0
            _ended.append(self)
        for fd in (self.out, self.back):
            with contextlib.suppress(OSError):
                os.close(fd)
        if self.process.poll() is None:
            self.process.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(5.0)


@lru_cache(maxsize=1)
def _c_library() -> ctypes.CDLL:
    return ctypes.CDLL(None)


def process_of(key: int) -> _Process:
    """Return the process of a unit, which is started where it does not run.

    Raises
    ------
    SimulationError
        If it cannot be started.
    """
    with _lock:
        if key not in _running:
            used = {one.slot: one for one in _running.values()}
            free = [slot for slot in range(len(TABLE)) if slot not in used]
            if not free:
                oldest = next(iter(_running.values()))
                oldest.stop()
                free = [oldest.slot]
            _running[key] = _Process(key, free[0])
        return _running[key]


def handle(slot: int, what: int) -> None:
    """Raise what compiled code has met at a slot; return where it was only a signal.

    Raises
    ------
    SimulationError
    """
    one = next((v for v in _running.values() if v.slot == slot), None)
    if one is None:
        raise SimulationError("the process of an FMU was stopped")
    one.handle(what)


def _forget_all() -> None:
    """Leave the processes to the parent of a fork: two must not share a pipe."""
    TABLE[:] = 0
    _ended.extend(_running.values())
    _running.clear()


@atexit.register
def _stop_all() -> None:
    for one in list(_running.values()):
        one.stop()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_all)


@lru_cache(maxsize=16)
def start_states(path: str, digest: str) -> tuple[float, ...]:
    """Return the states that a unit has after its own initialization, SI, with the parameters of its description.

    Raises
    ------
    SimulationError
        If the unit refuses, does not answer, or its process cannot be started.
    """
    unit, one = read_unit(path), process_of(key_of(path, digest))
    known = (*unit.states, *unit.inputs, *unit.parameters)
    values = np.empty(len(unit.states))
    one.exchange(START, np.array([0.0, *(v.start for v in known)]), values)
    return tuple(values.tolist())
