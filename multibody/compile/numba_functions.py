"""Functions of a model compiled by numba: kept on disk, with a C address, and callable from other numba functions."""

from __future__ import annotations

import time
from functools import lru_cache
from types import FunctionType, ModuleType
from typing import Any

import numpy as np
from numba import errors, njit, types
from numba.core import event
from numba.extending import intrinsic

from multibody.base.compile_events import tell
from multibody.compile.sealed_code import kept

__all__ = ["address_of_function", "function_on_arrays", "function_on_pointers", "function_with_result"]

_FLOATS = types.CPointer(types.float64)


class _Announcement(event.Listener):  # type: ignore[misc]
    """Reports that numba compiles a model's function which its cache does not hold; its helpers go with it."""

    def __init__(self) -> None:
        self._open: list[tuple[str, float]] = []

    def on_start(self, event: Any) -> None:
        """Note the begin of a compilation."""
        if not _is_generated(event):
            return
        name = event.data["dispatcher"].py_func.__name__
        self._open.append((name, time.perf_counter()))
        if len(self._open) == 1:
            tell(name, None)

    def on_end(self, event: Any) -> None:
        """Note the end of a compilation."""
        if not _is_generated(event):
            return
        name, begun = self._open.pop()
        if not self._open:
            tell(name, time.perf_counter() - begun)


def _is_generated(event: Any) -> bool:
    return (event.data["dispatcher"].py_func.__module__ or "").startswith("vtsdt_native_")


@lru_cache(maxsize=1)
def _announce() -> None:
    event.register("numba:compile", _Announcement())


def function_on_pointers(module: ModuleType, text: str, name: str, arrays: int) -> Any:
    """Return a function ``f(t, *arrays)`` of a module and its text from `native.load_source`, compiled, kept on disk.

    Its arrays are pointers.  Division by zero gives inf or nan as in C, which the step control handles; an exception
    could not leave.
    """
    names = dict(vars(module))
    helper: Any = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    for key, value in vars(module).items():
        if isinstance(value, FunctionType) and value.__module__ == module.__name__ and key != name:
            names[key] = njit(**helper)(FunctionType(value.__code__, names, key, value.__defaults__))
    code = getattr(names[name], "py_func", names[name]).__code__
    signature = types.void(types.float64, *([_FLOATS] * arrays))
    _announce()
    options: Any = {"error_model": "numpy", "nogil": True, "no_cpython_wrapper": True}
    function = kept(njit(**options)(FunctionType(code, names, name)), repr((options, helper)) + text)
    function.compile(signature)
    function.disable_compile()
    return function


def address_of_function(function: Any) -> int:
    """Return the C address of what `function_on_pointers` has compiled."""
    (compiled,) = function.overloads.values()
    return int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_cfunc_wrapper_name))


@intrinsic
def _elements(typingctx, array):  # type: ignore[no-untyped-def]
    if not (isinstance(array, types.Array) and array.dtype == types.float64 and array.layout == "C"):
        raise errors.TypingError(
            f"functions of a model take contiguous arrays of float64, not {array}: "
            "numpy.ascontiguousarray(..., dtype=float) makes one"
        )

    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return context.make_array(signature.args[0])(context, builder, args[0]).data

    return _FLOATS(array), emit


def function_on_arrays(function: Any, arrays: int) -> Any:
    """Return what `function_on_pointers` has compiled as a numba function of arrays, which writes the last one."""
    at: Any = _elements  # numba itself gives an intrinsic its first argument

    if arrays == 4:

        def call(t, x, u, p, out):  # type: ignore[no-untyped-def]
            function(float(t), at(x), at(u), at(p), at(out))

    else:

        def call(t, x, u, p, x_dot, u_dot, p_dot, out):  # type: ignore[no-untyped-def, misc]
            function(float(t), at(x), at(u), at(p), at(x_dot), at(u_dot),
                     at(p_dot), at(out))  # fmt: skip

    return njit(error_model="numpy", nogil=True)(call)


def function_with_result(function: Any, size: int) -> Any:
    """Return ``f(t, x, u, p)`` as a numba function that returns a new array of so many elements."""

    def call(t, x, u, p):  # type: ignore[no-untyped-def]
        out = np.empty(size)
        function(t, x, u, p, out)
        return out

    return njit(error_model="numpy", nogil=True)(call)
