"""The question that equations put to a foreign unit, compiled: it goes through a pipe to the process of the unit.

A round trip costs some ten microseconds and no turn of Python in this process, so that models with a foreign unit are
compiled as all others are.  What the code needs to know of a process stands in the table of `multibody.fmi.foreign`;
what has to be done in Python (start, refusal, crash) is called back.
"""

from __future__ import annotations

import ctypes
import inspect
from typing import Any

import numpy as np

from multibody.base.foreign_faults import ASKS_FOREIGN, FOREIGN_FAULTS
from multibody.compile.sealed_code import kept
from multibody.compile.settings import jit_enabled
from multibody.fmi import foreign
from multibody.fmi.foreign import key_of

__all__ = ["ask", "key_of"]


def _ask_in_python(key: int, kind: float, given: np.ndarray, values: np.ndarray) -> None:
    foreign.process_of(key).exchange(kind, given, values)


def _compiled() -> Any:
    """Return the compiled question.  Its code is kept on disk: addresses of this process reach it as symbols."""
    from llvmlite import binding
    from numba import carray, njit, types
    from numba.extending import intrinsic

    from multibody.compile.emitter.machine import compiled, loaded

    table_text = f"define i64 @vtsdt_fmu_table() {{\n  ret i64 {foreign.TABLE.ctypes.data}\n}}\n"
    binding.add_symbol("vtsdt_fmu_table", loaded(compiled(table_text), "vtsdt_fmu_table"))
    library = ctypes.CDLL(None)
    for name in ("read", "write", "poll", "pthread_mutex_lock", "pthread_mutex_unlock"):
        address = ctypes.cast(getattr(library, name), ctypes.c_void_p).value
        binding.add_symbol(f"vtsdt_fmu_{name}", address)
    for name, callback in _CALLBACKS.items():
        binding.add_symbol(f"vtsdt_fmu_{name}", ctypes.cast(callback, ctypes.c_void_p).value)

    whole, short = types.int64, types.int32

    def external(name: str, *arguments: Any, returns: Any = whole) -> Any:
        return types.ExternalFunction(f"vtsdt_fmu_{name}", returns(*arguments))

    table_at = external("table")
    read, write = external("read", short, whole, whole), external("write", short, whole, whole)
    poll = external("poll", whole, whole, short, returns=short)
    lock = external("pthread_mutex_lock", whole, returns=short)
    unlock = external("pthread_mutex_unlock", whole, returns=short)
    started, trouble = external("started", whole), external("trouble", whole, whole)

    def elements_of(kind: Any) -> Any:
        def elements_at(typingctx, address):  # type: ignore[no-untyped-def]
            def emit(context, builder, signature, args):  # type: ignore[no-untyped-def]
                return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

            return types.CPointer(kind)(whole), emit

        return intrinsic(elements_at)

    floats_at, wholes_at = elements_of(types.float64), elements_of(whole)

    slots, fields = foreign.TABLE.shape
    key_at, fd_out, fd_in = foreign.KEY, foreign.OUT, foreign.IN
    request_at, answer_at, mutex_at, poll_at = foreign.REQUEST, foreign.ANSWER, foreign.MUTEX, foreign.POLL
    known_at, limit_at = foreign.KNOWN, foreign.LIMIT
    interrupted, hung, died, refused = foreign.INTERRUPTED, foreign.HUNG, foreign.DIED, foreign.REFUSED
    evaluate = foreign.EVALUATE

    def compile(function: Any) -> Any:
        origin = ASKS_FOREIGN + inspect.getsource(function) + repr(foreign.TABLE.shape)
        return kept(njit(nogil=True, error_model="numpy")(function), origin)

    @compile
    def exchanged(row, slot, kind, given, results):  # type: ignore[no-untyped-def]
        """Send a question and read its answer into the slot's memory; tell whether it has come."""
        request = carray(floats_at(row[request_at]), 1 + given.size)
        request[0] = kind
        for k in range(given.size):
            request[1 + k] = given[k]
        left, at = 8 * (1 + given.size), row[request_at]
        while left > 0:
            done = write(row[fd_out], at, left)
            if done <= 0:
                trouble(slot, died)
                return False
            left, at = left - done, at + done
        left, at = 8 * (1 + results), row[answer_at]
        while left > 0:
            ready = poll(row[poll_at], 1, row[limit_at])
            if ready == 0:
                trouble(slot, hung)
                return False
            done = read(row[fd_in], at, left) if ready > 0 else -1
            if done == 0:
                trouble(slot, died)
                return False
            if done < 0:
                if trouble(slot, interrupted) == 0:
                    return False
                continue
            left, at = left - done, at + done
        answer = carray(floats_at(row[answer_at]), 1 + results)
        if answer[0] != 0.0:
            trouble(slot, refused)
            return False
        return True

    @compile
    def ask(key, kind, given, values):  # type: ignore[no-untyped-def]
        """Ask a unit at a point, or along a direction there; nan where it gives no answer."""
        table = carray(wholes_at(table_at()), (slots, fields))
        slot = -1
        for k in range(slots):
            if table[k, key_at] == key:
                slot = k
        if slot < 0:
            slot = started(key)
        good = False
        if slot >= 0:
            row = table[slot]
            mutex = row[mutex_at]
            lock(mutex)
            if row[key_at] == key:  # another thread may have ended it
                answer = carray(floats_at(row[answer_at]), 1 + values.size)
                if kind == evaluate and row[known_at]:
                    last = carray(floats_at(row[request_at]), 1 + given.size)
                    good = True
                    for k in range(given.size):
                        if last[1 + k] != given[k]:
                            good = False
                            break
                if not good:
                    row[known_at] = 0
                    good = exchanged(row, slot, kind, given, values.size)
                    row[known_at] = good and kind == evaluate
                if good:
                    for k in range(values.size):
                        values[k] = answer[1 + k]
            unlock(mutex)
        if not good:
            for k in range(values.size):
                values[k] = np.nan

    return ask


def _guarded_start(key: int) -> int:
    if FOREIGN_FAULTS:  # one crash is enough: the integration is about to end with it
        return -1
    try:
        return foreign.process_of(key).slot
    except BaseException as error:
        FOREIGN_FAULTS.append(error)
        return -1


def _guarded_trouble(slot: int, what: int) -> int:
    try:
        foreign.handle(slot, what)
    except BaseException as error:
        FOREIGN_FAULTS.append(error)
        return 0
    return 1


_CALLBACKS = {
    "started": ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)(_guarded_start),
    "trouble": ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64, ctypes.c_int64)(_guarded_trouble),
}

ask = _compiled() if jit_enabled() else _ask_in_python
