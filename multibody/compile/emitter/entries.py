"""Functions of modules that are compiled at their first call and called from Python with numbers and arrays."""

from __future__ import annotations

import ctypes
import functools
import importlib.util
import re
import sys
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from multibody.compile.emitter.kinds import FLOAT, INT, TRUTH, Array, Kind, kind_and_address, kind_of_argument
from multibody.compile.settings import jit_enabled

__all__ = ["Entry", "Inner", "Instruction"]

_C: dict[Kind, Any] = {FLOAT: ctypes.c_double, INT: ctypes.c_int64, TRUTH: ctypes.c_bool}
_IMPORT = re.compile(r"^\s*(?:from\s+([\w.]+)\s+import|import\s+([\w.]+))", re.MULTILINE)


class Inner:
    """A function for compiled code only; `py_func` is the same in Python.

    With ``fused`` a product and the sum that it goes into may be rounded once, which is faster and differs from Python
    in the last digit.
    """

    def __init__(self, function: Callable[..., Any], fused: bool = False) -> None:
        self.py_func, self.fused = function, fused
        functools.update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        return self.py_func(*arguments)


class Instruction(Inner):
    """A function that is an instruction or two of the machine."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self.instruction = function.__name__


class _Native:
    """A compiled function and how to read what it returns."""

    def __init__(self, function: Callable[..., None], returns: tuple[str, ...]) -> None:
        self._function, self._returns = function, returns

    def bound(self, given: list[Any], keep: Any) -> Callable[[], Any]:
        """Return the call with arguments for C; ``keep`` holds the arrays that they point into."""
        if not self._returns:
            call = functools.partial(self._function, *given)
            call.keep = keep  # type: ignore[attr-defined]
            return call
        out = (ctypes.c_int64 * len(self._returns))()
        address, function = ctypes.addressof(out), self._function
        if self._returns == ("int",):

            def call_and_tell(keep: Any = keep) -> Any:
                function(*given, address)
                return out[0]

            return call_and_tell
        real = (ctypes.c_double * len(out)).from_buffer(out)
        read = [real if kind == FLOAT else out for kind in self._returns]

        def call_and_read(keep: Any = keep) -> Any:
            function(*given, address)
            values = [part[k] for k, part in enumerate(read)]
            return values[0] if len(values) == 1 else tuple(values)

        return call_and_read


class Entry(Inner):
    """A function that Python calls: compiled for the kinds of its arguments."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._native: dict[tuple[Kind, ...], _Native] = {}
        self._quick: dict[tuple[int, ...], _Native] = {}

    def __call__(self, *arguments: Any) -> Any:
        return self.bound(*arguments)()

    def bound(self, *arguments: Any) -> Callable[[], Any]:
        """Return the call with these arguments, whose arrays are looked up once and may change inside."""
        if not jit_enabled():
            return functools.partial(self.py_func, *arguments)
        kinds: list[Kind] = []
        given: list[Any] = []
        for value in arguments:
            if isinstance(value, np.ndarray):
                kind, address = kind_and_address(value)
                kinds.append(kind)
                given.append(address)
                given += value.shape
                continue
            kinds.append(kind_of_argument(value))
            if type(value) is int:
                given.append(value)
            else:
                given.append(value.item() if isinstance(value, np.generic) else value)
        known = tuple(map(id, kinds))  # each kind is one object for ever; its own hash takes longer than the search
        native = self._quick.get(known)
        if native is None:
            native = self._quick[known] = self._native.get(tuple(kinds)) or self._compile(tuple(kinds))
        return native.bound(given, arguments)

    def _compile(self, kinds: tuple[Kind, ...]) -> _Native:
        from multibody.compile.emitter.build import build

        module, name = self.py_func.__module__, self.py_func.__name__
        address, returns = build(
            f"{module.replace('.', '_')}_{name}",
            module_texts(module),
            functools.partial(_unit, self.py_func),
            name,
            kinds,
        )
        types: list[Any] = []
        for kind in kinds:
            if isinstance(kind, Array):
                types += [ctypes.c_void_p, *[ctypes.c_int64] * kind.dimensions]
            else:
                types.append(_C[kind])
        if returns:
            types.append(ctypes.c_void_p)
        native = ctypes.CFUNCTYPE(None, *types)(address)
        self._native[kinds] = _Native(native, returns)
        return self._native[kinds]


def _unit(function: Callable[..., Any]) -> Any:
    from multibody.compile.emitter.units import unit_of_function

    return unit_of_function(function)[0]


@lru_cache(maxsize=256)
def _text_of(name: str) -> str | None:
    module = sys.modules.get(name)
    origin = getattr(module, "__file__", None) if module is not None else None
    if origin is None:
        spec = importlib.util.find_spec(name)
        origin = spec.origin if spec is not None else None
    if origin is None or not origin.endswith(".py"):
        return None
    return Path(origin).read_text(encoding="utf-8")


@lru_cache(maxsize=64)
def module_texts(name: str) -> tuple[str, ...]:
    """Return the texts of a module and of every project module that it imports, directly or not.

    They are what its machine code follows from: an edit anywhere among them makes another key in the cache.
    """
    own = {name.split(".")[0], "multibody"}
    texts: dict[str, str] = {}
    waiting = [name]
    while waiting:
        module = waiting.pop()
        if module in texts or module.startswith("multibody.compile.emitter"):
            continue
        text = _text_of(module)
        if text is None:
            raise ImportError(f"driver module '{module}' has no source file")
        texts[module] = text
        imported = (first or second for first, second in _IMPORT.findall(text))
        waiting += [other for other in imported if other.split(".")[0] in own]
    return tuple(part for key in sorted(texts) for part in (key, texts[key]))
