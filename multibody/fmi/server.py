"""The process in which a foreign unit runs: it loads the unit, answers requests, and may crash alone.

Started by `multibody.fmi.foreign` as ``python -m multibody.fmi.server FMU FD FOLDER``; the unit is unpacked into the
folder, which this process removes unless it is killed (then its parent does).

A request is one byte and what belongs to it.  To evaluate, float64 numbers in SI: see
`multibody.fmi.answering.RunningUnit.answer`.  Of the start, the unit's own numbers of its parameters.  To work, a
function of this project and its arguments, pickled by the parent: it is run here, where the equations in its arguments
are compiled.  Requests to a unit that is stepped: see `multibody.fmi.stepping`.  Answers: see `multibody.fmi.messages`.
"""

from __future__ import annotations

import os
import pickle
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from multibody.fmi.answering import BUSY, COUNT, RunningUnit
from multibody.fmi.errors import FmuError
from multibody.fmi.foreign_description import ForeignUnit, read_unit
from multibody.fmi.messages import ANSWER, FAILURE, PIECE, PULSE, REFUSAL, packed
from multibody.fmi.stepping import BEGIN, STEPS, SteppedUnit

__all__ = ["EVALUATE", "GO_ON", "START", "WORK", "WORK_IN_PIECES", "serve"]

EVALUATE, START, WORK, WORK_IN_PIECES, GO_ON = b"E", b"S", b"W", b"V", b"G"
_EVERY = 1.0  # s between the signs of life while the process works


def serve(path: str, connection: Connection, folder: str) -> None:
    """Answer requests until the other side closes the connection."""
    try:
        try:
            server = _Server(read_unit(path), connection, folder)
            server.send(ANSWER)
        except Exception as error:
            connection.send_bytes(REFUSAL + f"{error}".encode())
            return
        server.answer_all()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


class _Server:
    """A unit and the connection through which it is asked."""

    def __init__(self, unit: ForeignUnit, connection: Connection, folder: str) -> None:
        self._connection, self._lock, self._works = connection, threading.Lock(), 0
        self._running = None if unit.stepped else RunningUnit(unit, folder)
        self._answers = self._stepped(unit, folder) if self._running is None else self._continuous(self._running)
        if self._running is not None:
            threading.Thread(target=self._pulse, args=(self._running.table,), daemon=True).start()

    def _stepped(self, unit: ForeignUnit, folder: str) -> dict[bytes, Callable[[bytes], bytes]]:
        stepped = SteppedUnit(unit, folder)
        return {BEGIN: _on_numbers(stepped.begin), STEPS: _on_numbers(stepped.steps)}

    def _continuous(self, running: RunningUnit) -> dict[bytes, Callable[[bytes], bytes]]:
        def work(request: bytes, *more: Any) -> bytes:
            self._works += 1
            try:
                running.prepare()
                function, given = pickle.loads(request)
                result = function(*given, *more)
            finally:
                self._works -= 1
                running.check()
            return packed(result)

        return {
            EVALUATE: _on_numbers(running.answer),
            START: _on_numbers(running.start),
            WORK: work,
            WORK_IN_PIECES: lambda request: work(request, self._piece),
        }

    def send(self, message: bytes) -> None:
        """Send a message, whole."""
        with self._lock:
            self._connection.send_bytes(message)

    def answer_all(self) -> bool:
        """Answer requests until there are no more, or the other side asks to go on with what has been interrupted."""
        while True:
            try:
                request = self._connection.recv_bytes()
            except EOFError:
                return False
            kind, rest = request[:1], request[1:]
            if kind == GO_ON:
                return True
            try:
                answer = ANSWER + self._answers[kind](rest)
            except FmuError as error:
                answer = REFUSAL + f"{error}".encode()
            except Exception as error:
                blamed = FAILURE if kind in (WORK, WORK_IN_PIECES) else REFUSAL
                answer = blamed + (f"{error}" or type(error).__name__).encode()
            self.send(answer)

    def _piece(self, *part: Any) -> None:
        """Hand over a piece of an answer; meanwhile others are answered."""
        self.send(PIECE + packed(part))
        if not self.answer_all():
            os._exit(0)  # nobody wants the rest

    def _pulse(self, table: np.ndarray) -> None:
        """Give signs of life while there is work, unless the unit is in one call all the time."""
        count = -1
        while True:
            time.sleep(_EVERY)
            if self._works and not (table[BUSY] and table[COUNT] == count):
                self.send(PULSE)
            count = int(table[COUNT])


def _on_numbers(function: Callable[[np.ndarray], np.ndarray]) -> Callable[[bytes], bytes]:
    return lambda request: function(np.frombuffer(request) if request else np.empty(0)).tobytes()


def _end_with_parent(folder: str) -> None:
    """End this process when its parent has ended: a unit that hangs sees no closed connection."""
    parent = os.getppid()
    while os.getppid() == parent:
        time.sleep(1.0)
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)


def _main() -> None:
    os.dup2(2, 1)  # what the unit prints is no answer
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which may still have questions
    os.environ["VTSDT_COMPILER"] = "emitter"  # a diagnosis has many models, each with the unit's many names in it
    path, descriptor, folder = sys.argv[1:]
    threading.Thread(target=_end_with_parent, args=(folder,), daemon=True).start()
    serve(path, Connection(int(descriptor)), folder)


if __name__ == "__main__":
    try:
        _main()
    except (BrokenPipeError, KeyboardInterrupt, FmuError):
        os._exit(1)
