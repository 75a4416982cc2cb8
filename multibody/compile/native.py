"""The equations of a model as native functions, compiled once per machine.

They arrive as Python source text of flat functions over arrays.  Here that text becomes a file in the cache folder, a
module, and a function with a plain C address, compiled by numba; a tangent of several directions at once is compiled by
the package's own emitter, which writes vector instructions.  Integrators and filters are written against such
addresses, and are therefore compiled once for all models and not once for each.

With ``NUMBA_DISABLE_JIT=1`` the same text runs as plain Python everywhere.
"""

from __future__ import annotations

import ctypes
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

from multibody.base.cache import cache_dir, digest_of, write_once
from multibody.base.compile_events import on_compile
from multibody.base.errors import EquationError
from multibody.compile.calls import register_python
from multibody.compile.emitter.build import build
from multibody.compile.emitter.kinds import FLOAT, FLOATS, LanesAt
from multibody.compile.emitter.units import Unit, unit_of_text
from multibody.compile.hosts import ASKS, Host, constants_in, hosts_in
from multibody.compile.settings import jit_enabled, models_by_emitter

__all__ = [
    "NativeFunction",
    "ReturningFunction",
    "cache_dir",
    "compile_rhs",
    "compile_tangent",
    "compile_text",
    "load_source",
    "on_compile",
]

RHS_ARRAYS = 4
TANGENT_ARRAYS = 7


#: A module stands in ``sys.modules`` while it is executed; another thread must not take it half made.
_loading = threading.RLock()
compiling = threading.RLock()


def load_source(text: str, stem: str) -> ModuleType:
    """Turn source text into a module whose functions can be compiled, cached and stepped through.

    Parameters
    ----------
    text : str
        Python source.  The same text gives the same file and the same module.
    stem : str
        Beginning of the file's name, an identifier.

    Returns
    -------
    module : ModuleType
        Registered in ``sys.modules`` before it is executed, because pickled functions name it.
    """
    with _loading:
        return _load(text, stem)


def _load(text: str, stem: str) -> ModuleType:
    name = f"{stem}_{digest_of(text)}"
    module_name = f"vtsdt_native_{name}"
    if module_name in sys.modules:
        return sys.modules[module_name]
    path = cache_dir() / f"{name}.py"
    write_once(path, text)
    module = ModuleType(module_name)
    module.__file__ = str(path)
    sys.modules[module_name] = module
    try:
        # From the text and not from the file, beside which somebody may have put compiled code.
        exec(compile(text, str(path), "exec"), vars(module))
    except BaseException:
        del sys.modules[module_name]
        raise
    return module


@dataclass(frozen=True, eq=False, kw_only=True)
class NativeFunction:
    """A flat function with a C address that compiled drivers call.

    Parameters
    ----------
    name : str
        Name of the function in its module.
    python : callable
        The same function as plain Python.
    arrays : int
        Number of array arguments after ``t``; the last one is written.
    compiled : bool
        False if the address leads back into Python.
    """

    name: str
    python: Callable[..., None]
    arrays: int
    compiled: bool
    origin: tuple[str, str] = ("", "")
    faults: list[BaseException] = field(default_factory=list, repr=False)
    lanes: int = 0
    _made: tuple[int, Any] | None = field(default=None, repr=False)

    @cached_property
    def _entry(self) -> tuple[int, Any]:
        """The C address, and what has to stay alive for it; numba compiles when it is first asked for."""
        return _by_numba(*self.origin, self.name, self.arrays) if self._made is None else self._made

    @property
    def address(self) -> int:
        """Address of ``void f(double t, double *..., double *out)``."""
        return self._entry[0]

    def compile(self) -> None:
        """Compile now; otherwise that happens when the function is first needed."""
        _ = self._entry

    @cached_property
    def _native(self) -> Any:
        return _prototype(self.arrays)(self.address)

    def __call__(self, t: float, *arrays: np.ndarray) -> np.ndarray:
        """Evaluate once: ``f(t, x, u, p, dx)`` or the tangent form; writes and returns the last array."""
        if len(arrays) != self.arrays:
            raise TypeError(f"{self.name} takes t and {self.arrays} arrays, {len(arrays)} arrays were given")
        out = arrays[-1]
        if not (isinstance(out, np.ndarray) and out.dtype == np.float64 and out.flags.c_contiguous):
            raise TypeError(f"{self.name} writes into its last argument: a contiguous float64 array is needed")
        inputs = [np.ascontiguousarray(a, dtype=np.float64) for a in arrays[:-1]]
        self._native(float(t), *(a.ctypes.data for a in inputs), out.ctypes.data)
        self.check()
        return out

    def check(self) -> None:
        """Raise what a plain Python function raised when compiled code called it."""
        if self.faults:
            error = self.faults[0]
            self.faults.clear()
            raise error

    @property
    def _numba_type_(self) -> Any:
        """What a function compiled by numba sees that calls this one, with contiguous arrays of float64."""
        return self._on_arrays._numba_type_

    @cached_property
    def _on_arrays(self) -> Any:
        if not self.compiled or self.lanes or models_by_emitter():
            raise TypeError(f"{self.name} is not compiled by numba, so that functions compiled by numba cannot call it")
        from multibody.compile.numba_functions import function_on_arrays

        return function_on_arrays(_by_numba(*self.origin, self.name, self.arrays)[1], self.arrays)

    def run(self, work: Callable[..., Any], *given: Any, receive: Callable[..., None] | None = None) -> Any:
        """Return ``work(*given)``, which evaluates this function often; done in another process if that is faster.

        Arguments as of `multibody.compile.hosts.Host.do`.
        """
        hosts = _hosts(*self.origin)
        if len(hosts) == 1:
            return hosts[0].do(work, *given, receive=receive)
        return work(*given) if receive is None else work(*given, receive)

    @property
    def elsewhere(self) -> bool:
        """Whether `run` does its work in another process."""
        return len(_hosts(*self.origin)) == 1

    def __reduce__(self) -> tuple[Any, ...]:
        """Send the source and not the address: a worker process compiles, or finds it in the cache."""
        if not self.origin[0]:
            raise TypeError(f"{self.name} has no source text to be rebuilt from in another process")
        if self._made is None:
            load_source(*self.origin)  # what numba keeps of a user's function that calls this one names the module
        compiled = self.compiled or bool(_hosts(*self.origin))  # where its host is, it is
        return _rebuild, (*self.origin, self.name, self.arrays, compiled, self.lanes)


def _rebuild(text: str, stem: str, name: str, arrays: int, compiled: bool, lanes: int) -> NativeFunction:
    return compile_text(text, stem, name, arrays, compiled, lanes)


class ReturningFunction:
    """A native function ``f(t, x, u, p, out)`` that returns a new array, in Python and in functions compiled by numba.

    Parameters
    ----------
    function : NativeFunction
    size : int
        Length of what it returns.
    u, p : ndarray
        Inputs and parameters that count where none are given; in functions compiled by numba all four are given.
    """

    def __init__(self, function: NativeFunction, size: int, u: np.ndarray, p: np.ndarray) -> None:
        self.function, self.size = function, size
        self._u, self._p = u, p

    def __call__(self, t: float, x: np.ndarray, u: np.ndarray | None = None, p: np.ndarray | None = None) -> np.ndarray:
        """Return the values at one instant, shape (size,)."""
        return self.function(t, x, self._u if u is None else u, self._p if p is None else p, np.empty(self.size))

    @property
    def _numba_type_(self) -> Any:
        return self._with_result._numba_type_

    @cached_property
    def _with_result(self) -> Any:
        from multibody.compile.numba_functions import function_with_result

        return function_with_result(self.function._on_arrays, self.size)

    def __reduce__(self) -> tuple[Any, ...]:
        """Leave out what numba has compiled: numba's key for a function that calls this one is made of the rest."""
        return ReturningFunction, (self.function, self.size, self._u, self._p)


def _guard(python: Callable[..., None], faults: list[BaseException]) -> Callable[..., None]:
    def guarded(t: float, *arrays: Any) -> None:
        try:
            python(t, *arrays)
        except (ZeroDivisionError, OverflowError, ValueError):
            arrays[-1][0] = np.nan
        except TypeError as error:
            # A negative number to a broken power is complex in Python and nan in compiled code.
            if "complex" not in str(error):
                faults.append(error)
            arrays[-1][0] = np.nan
        except BaseException as error:
            faults.append(error)
            arrays[-1][0] = np.nan

    return guarded


class _Plain:
    """A function of a text in plain Python, with its helpers undecorated; the text is run when it is called."""

    def __init__(self, text: str, stem: str, name: str) -> None:
        self._text, self._stem, self.__name__ = text, stem, name
        self._function: Callable[..., None] | None = None

    def __call__(self, t: float, *arrays: Any) -> None:
        if self._function is None:
            self._function = _undecorated(load_source(self._text, self._stem), self.__name__)
        self._function(t, *arrays)


def _undecorated(module: ModuleType, name: str) -> Callable[..., None]:
    plain = dict(vars(module))
    for key, value in vars(module).items():
        inner = getattr(value, "py_func", value)
        if isinstance(inner, FunctionType) and inner.__module__ == module.__name__:
            plain[key] = FunctionType(inner.__code__, plain, key, inner.__defaults__, inner.__closure__)
    return plain[name]


def compile_text(text: str, stem: str, name: str, arrays: int, compiled: bool = True, lanes: int = 0) -> NativeFunction:
    """Return the function ``name(t, *arrays)`` of a source text with a C address.

    Parameters
    ----------
    text : str
        Python source.
    stem : str
        Beginning of the names of its files in the cache.
    name : str
        The function.
    arrays : int
        Number of its array arguments.
    compiled : bool
        False keeps it plain Python behind a C address, so that a debugger can step through it.
    lanes : int
        Of a tangent: how many directions it carries; 0 for one, without a further axis.

    Raises
    ------
    Outside
        If a tangent for several directions is outside the emitter's subset.
    """
    python = _Plain(text, stem, name)
    if compiled and jit_enabled() and not _hosts(text, stem):
        made = None
        if lanes or models_by_emitter():
            made = _by_emitter(text, stem, name, arrays, lanes), None
        return NativeFunction(
            name=name, python=python, arrays=arrays, compiled=True, origin=(text, stem), lanes=lanes, _made=made
        )

    faults: list[BaseException] = []
    guarded = _guard(python, faults)
    pointer = ctypes.POINTER(ctypes.c_double)
    back = ctypes.CFUNCTYPE(None, ctypes.c_double, *([pointer] * arrays))(guarded)
    address = ctypes.cast(back, ctypes.c_void_p).value or 0
    register_python(address, guarded)
    return NativeFunction(
        name=name,
        python=python,
        arrays=arrays,
        compiled=False,
        origin=(text, stem),
        faults=faults,
        _made=(address, back),
    )


@lru_cache(maxsize=256)
def _hosts(text: str, stem: str) -> tuple[Host, ...]:
    return hosts_in(vars(load_source(text, stem))) if ASKS in text else ()


@lru_cache(maxsize=8)
def _prototype(arrays: int) -> Any:
    return ctypes.CFUNCTYPE(None, ctypes.c_double, *([ctypes.c_void_p] * arrays))


def _by_emitter(text: str, stem: str, name: str, arrays: int, lanes: int) -> int:
    names = vars(load_source(text, stem)) if ASKS in text else {}

    def unit() -> Unit:
        path = cache_dir() / f"{stem}_{digest_of(text)}.py"
        write_once(path, text)  # to read, and to step through
        return replace(unit_of_text(text, str(path)), values=names)

    shared = RHS_ARRAYS - 1 if lanes else arrays
    source = (text, *constants_in(names)) if names else (text,)
    return build(stem, source, unit, name, (FLOAT, *[FLOATS] * shared, *[LanesAt(lanes)] * (arrays - shared)))[0]


@lru_cache(maxsize=1024)
def _by_numba(text: str, stem: str, name: str, arrays: int) -> tuple[int, Any]:
    from multibody.compile.numba_functions import address_of_function, function_on_pointers

    try:
        with compiling:  # two threads would compile the same text twice
            function = function_on_pointers(load_source(text, stem), text, name, arrays)
            return address_of_function(function), function
    except Exception as error:
        if not type(error).__module__.startswith("numba"):
            raise
        raise EquationError(f"the equations ('{stem}') could not be compiled: {error}") from error


def _text_of(module: ModuleType) -> tuple[str, str]:
    path = Path(str(module.__file__))
    return path.read_text(encoding="utf-8"), path.stem.rpartition("_")[0] or path.stem


def compile_rhs(module: ModuleType, name: str = "rhs", compile: bool = True) -> NativeFunction:
    """Compile ``name(t, x, u, p, out)`` of a module from `load_source`.

    Parameters
    ----------
    module : ModuleType
        Its helpers are called with pointers, which are indexed like arrays but have no length.
    name : str
        Name of the function.
    compile : bool
        False keeps it plain Python behind a C address, so that a debugger can step through it.
    """
    text, stem = _text_of(module)
    return compile_text(text, stem, name, RHS_ARRAYS, compile)


def compile_tangent(module: ModuleType, name: str = "rhs_tangent", compile: bool = True) -> NativeFunction:
    """Compile ``name(t, x, u, p, x_dot, u_dot, p_dot, out)``; otherwise as `compile_rhs`."""
    text, stem = _text_of(module)
    return compile_text(text, stem, name, TANGENT_ARRAYS, compile)
