"""Generated and hand-written numerical code as native functions, compiled once per machine.

A model's equations arrive as Python source text of flat functions over arrays.  Here that text becomes a file
in the cache folder, a module, and a function with a plain C address.  Whatever drives equations (integrators,
filters) is written against such addresses, and is therefore compiled once for all models and not once for
each.

With ``NUMBA_DISABLE_JIT=1`` the same text runs as plain Python everywhere.
"""

from __future__ import annotations

import ast
import ctypes
import hashlib
import importlib
import importlib.util
import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

from multibody.compile_events import listen_to_numba, on_compile, tell

__all__ = [
    "NativeFunction",
    "cache_dir",
    "compile_rhs",
    "compile_tangent",
    "fingerprint",
    "jit_enabled",
    "load_driver",
    "load_source",
    "on_compile",
]

RHS_ARRAYS = 4
TANGENT_ARRAYS = 7


def cache_dir() -> Path:
    """Return the folder of generated sources and compiled code, and create it.

    It is the environment variable ``VTSDT_CACHE`` if that is set, else the user's cache folder for ``vtsdt``.
    """
    named = os.environ.get("VTSDT_CACHE")
    if named:
        folder = Path(named).expanduser()
    else:
        from platformdirs import user_cache_path

        folder = user_cache_path("vtsdt")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OSError(
            f"the cache folder '{folder}' cannot be made ({error}): set VTSDT_CACHE to a writable folder"
        ) from error
    if not os.access(folder, os.W_OK):
        raise OSError(f"the cache folder '{folder}' cannot be written to: set VTSDT_CACHE to a writable folder")
    return folder


def jit_enabled() -> bool:
    """Tell whether functions are compiled (``NUMBA_DISABLE_JIT=1`` turns that off)."""
    import numba

    config: Any = numba.config
    return not config.DISABLE_JIT


@lru_cache(maxsize=1)
def _platform() -> str:
    import llvmlite
    import numba
    from llvmlite import binding

    features = binding.get_host_cpu_features().flatten()
    versions = (numba.__version__, llvmlite.__version__, sys.version, binding.get_host_cpu_name(), features)
    return "\n".join(versions)


def fingerprint(*texts: str) -> str:
    """Return 16 hexadecimal digits that change with the texts, the compiler's version and the processor."""
    digest = hashlib.sha256(_platform().encode())
    for text in texts:
        digest.update(len(text).to_bytes(8, "little"))
        digest.update(text.encode())
    return digest.hexdigest()[:16]


def _write_once(path: Path, text: str) -> None:
    """Put ``text`` at ``path`` unless it is there: its time stamp is part of the compiled code's key."""
    if path.exists() and path.read_text(encoding="utf-8") == text:
        return
    handle, draft = tempfile.mkstemp(dir=path.parent, prefix=path.stem, suffix=".tmp")
    with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as stream:
        stream.write(text)
    try:
        if path.exists():
            os.replace(draft, path)
        else:
            # A link fails where another process was first; a rename would give its file a new time stamp.
            os.link(draft, path)
    except FileExistsError:
        pass
    except OSError:
        os.replace(draft, path)
    finally:
        Path(draft).unlink(missing_ok=True)


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
        Registered in ``sys.modules`` before it is executed, because numba's cache needs that.
    """
    with _loading:
        return _load(text, stem)


def _load(text: str, stem: str) -> ModuleType:
    name = f"{stem}_{fingerprint(text)}"
    module_name = f"vtsdt_native_{name}"
    if module_name in sys.modules:
        return sys.modules[module_name]
    path = cache_dir() / f"{name}.py"
    _write_once(path, text)
    spec = importlib.util.spec_from_file_location(module_name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"'{path}' cannot be loaded as a Python module")
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[module_name]
        raise
    return module


def _module_text(name: str) -> tuple[str, Path]:
    spec = importlib.util.find_spec(name)
    if spec is None or spec.origin is None or not spec.origin.endswith(".py"):
        raise ImportError(f"driver module '{name}' has no source file")
    path = Path(spec.origin)
    return path.read_text(encoding="utf-8"), path


def _dependencies(text: str, own: set[str]) -> Iterator[str]:
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in own:
            yield node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.split(".")[0] in own)


@lru_cache(maxsize=64)
def load_driver(name: str) -> ModuleType:
    """Load a module of compiled drivers so that its cache never serves code from before an edit.

    numba looks only at the file of the cached function, not at the files of the functions that it calls.  So
    the driver is loaded from a copy whose name holds the hash of its text and of every project module that it
    imports, directly or not.

    Parameters
    ----------
    name : str
        Dotted name, such as ``"multibody.solvers.kernels.dormand_prince"``.  It may import project modules
        only by ``from package.module import name`` or ``import package.module``.
    """
    if not jit_enabled():
        return importlib.import_module(name)
    text, path = _module_text(name)
    own = {name.split(".")[0], "multibody"}
    texts: dict[str, str] = {}
    waiting = list(_dependencies(text, own))
    while waiting:
        other = waiting.pop()
        if other not in texts:
            texts[other] = _module_text(other)[0]
            waiting.extend(_dependencies(texts[other], own))
    ordered = [part for key in sorted(texts) for part in (key, texts[key])]
    seal = f"\n# Copy of {path.name}; the modules that it calls have the hash {fingerprint(*ordered)}.\n"
    listen_to_numba()
    return load_source(text + seal, name.replace(".", "_"))


@dataclass(frozen=True, eq=False)
class NativeFunction:
    """A flat function with a C address that compiled drivers call.

    Parameters
    ----------
    name : str
        Name of the function in its module.
    address : int
        Address of ``void f(double t, double *..., double *out)``.
    python : callable
        The same function as plain Python.
    arrays : int
        Number of array arguments after ``t``; the last one is written.
    compiled : bool
        False if the address leads back into Python.
    """

    name: str
    address: int
    python: Callable[..., None]
    arrays: int
    compiled: bool
    origin: tuple[str, str] = ("", "")
    faults: list[BaseException] = field(default_factory=list, repr=False)
    _native: Any = field(default=None, repr=False)

    def __call__(self, t: float, *arrays: np.ndarray) -> np.ndarray:
        """Evaluate once: ``f(t, x, u, p, dx)`` or the tangent form; writes and returns the last array."""
        if len(arrays) != self.arrays:
            raise TypeError(f"{self.name} takes t and {self.arrays} arrays, {len(arrays)} arrays were given")
        out = arrays[-1]
        if not (isinstance(out, np.ndarray) and out.dtype == np.float64 and out.flags.c_contiguous):
            raise TypeError(
                f"{self.name} writes into its last argument: a contiguous float64 array is needed"
            )
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

    def __reduce__(self) -> tuple[Any, ...]:
        """Send the source and not the address: a worker process compiles, or finds it in the cache."""
        if not self.origin[0]:
            raise TypeError(f"{self.name} has no source text to be rebuilt from in another process")
        return _rebuild, (*self.origin, self.name, self.arrays, self.compiled)


def _rebuild(text: str, stem: str, name: str, arrays: int, compiled: bool) -> NativeFunction:
    return _compile(load_source(text, stem), name, arrays, compiled)


def _signature(arrays: int) -> Any:
    from numba import types

    return types.void(types.float64, *([types.CPointer(types.float64)] * arrays))


def _compile_native(python: Callable[..., None], arrays: int) -> Any:
    from numba.core import sigutils
    from numba.core.ccallback import CFunc

    class Announced(CFunc):
        def _compile_uncached(self) -> Any:
            begun = time.perf_counter()
            tell(python.__name__, None)
            result = super()._compile_uncached()  # type: ignore[misc]
            tell(python.__name__, time.perf_counter() - begun)
            return result

    # Division by zero gives inf or nan as in C, which the step control handles; an exception could not leave.
    native = Announced(
        python, sigutils.normalize_signature(_signature(arrays)), locals={}, options={"error_model": "numpy"}
    )
    native.enable_caching()
    native.compile()
    return native


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


def _plain(module: ModuleType, name: str) -> tuple[Callable[..., None], Callable[..., None]]:
    """Return the undecorated function twice: for the compiler, and with its helpers undecorated too."""
    plain = dict(vars(module))
    for key, value in vars(module).items():
        inner = getattr(value, "py_func", value)
        if isinstance(inner, FunctionType) and inner.__module__ == module.__name__:
            plain[key] = FunctionType(inner.__code__, plain, key, inner.__defaults__, inner.__closure__)
    function = getattr(module, name)
    return getattr(function, "py_func", function), plain[name]


def _compile(module: ModuleType, name: str, arrays: int, compiled: bool) -> NativeFunction:
    function, python = _plain(module, name)
    path = Path(str(module.__file__))
    stem = path.stem.rpartition("_")[0] or path.stem
    origin = (path.read_text(encoding="utf-8"), stem) if path.exists() else ("", "")
    if compiled and jit_enabled():
        native = _compile_native(function, arrays)
        prototype = ctypes.CFUNCTYPE(None, ctypes.c_double, *([ctypes.c_void_p] * arrays))
        entry = prototype(native.address)
        entry.keep = native  # type: ignore[attr-defined]
        return NativeFunction(name, native.address, python, arrays, True, origin, [], entry)

    from multibody.solvers.kernels.calls import register_python

    faults: list[BaseException] = []
    guarded = _guard(python, faults)
    pointer = ctypes.POINTER(ctypes.c_double)
    back = ctypes.CFUNCTYPE(None, ctypes.c_double, *([pointer] * arrays))(guarded)
    address = ctypes.cast(back, ctypes.c_void_p).value or 0
    register_python(address, guarded)
    prototype = ctypes.CFUNCTYPE(None, ctypes.c_double, *([ctypes.c_void_p] * arrays))
    entry = prototype(address)
    entry.keep = back  # type: ignore[attr-defined]
    return NativeFunction(name, address, python, arrays, False, origin, faults, entry)


def compile_rhs(module: ModuleType, name: str = "rhs", compile: bool = True) -> NativeFunction:
    """Compile ``name(t, x, u, p, out)`` of a module from `load_source`.

    Parameters
    ----------
    module : ModuleType
        May hold helpers decorated with ``@njit(cache=True, error_model="numpy")`` (without signatures: they
        are called with pointers, which are indexed like arrays but have no length).
    name : str
        Name of the function.
    compile : bool
        False keeps it plain Python behind a C address, so that a debugger can step through it.
    """
    return _compile(module, name, RHS_ARRAYS, compile)


def compile_tangent(module: ModuleType, name: str = "rhs_tangent", compile: bool = True) -> NativeFunction:
    """Compile ``name(t, x, u, p, x_dot, u_dot, p_dot, out)``; otherwise as `compile_rhs`."""
    return _compile(module, name, TANGENT_ARRAYS, compile)


def __getattr__(name: str) -> Any:
    if name in ("call_rhs", "call_tangent"):
        return getattr(importlib.import_module("multibody.solvers.kernels.calls"), name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
