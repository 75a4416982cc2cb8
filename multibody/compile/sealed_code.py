"""What numba has compiled, kept in the cache folder and taken from there only with the user's seal.

numba's own cache trusts the time stamp of a source file and unpickles whatever lies beside it.
"""

from __future__ import annotations

import inspect
import pickle
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from multibody.base.cache import cache_dir, digest_of, read_object, write_object

__all__ = ["kept", "njit_kept"]


class _SealedCache(_Cache):  # type: ignore[misc]
    """A numba function's cache: one file for each signature, its name made of all that the code follows from."""

    def __init__(self, function: Callable[..., Any], text: str) -> None:
        self._function, self._text = function, text

    @property
    def cache_path(self) -> str:
        return str(cache_dir())

    def _path(self, signature: Any, code_generator: Any) -> Path:
        origin = (numba.__version__, repr(code_generator.magic_tuple()), self._text, repr(signature))
        return cache_dir() / f"{self._function.__name__}_{digest_of(*origin)}.nbo"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        target_context.refresh()
        overload = read_object(self._path(sig, target_context.codegen()))
        return None if overload is None else CompileResult._rebuild(target_context, *pickle.loads(overload[0]))

    def save_overload(self, sig: Any, data: Any) -> None:
        if not (data.lifted or data.library.has_dynamic_globals):  # such code holds addresses of this process
            write_object(self._path(sig, data.codegen), dumps(data._reduce()))

    def enable(self) -> None:
        """Do nothing: it is always on."""

    def disable(self) -> None:
        """Do nothing: it is always on."""

    def flush(self) -> None:
        """Do nothing: a file whose origin has changed is not looked at again."""


def kept(dispatcher: Any, text: str) -> Any:
    """Let a numba function keep its machine code on disk, and return it.

    Parameters
    ----------
    dispatcher : numba function
        Not compiled yet.
    text : str
        Everything that its machine code follows from besides its signature.
    """
    if hasattr(dispatcher, "py_func"):  # a plain function where numba is switched off
        dispatcher._cache = _SealedCache(dispatcher.py_func, text)
    return dispatcher


def njit_kept(calls: Sequence[Callable[..., Any]] = (), **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator as `numba.njit` for a function that needs nothing of its module but numpy and what it calls.

    Its machine code is kept in the cache folder.

    Parameters
    ----------
    calls : sequence of numba function
        Other functions of the module that it calls.
    **options
        Of `numba.njit`.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        texts = (inspect.getsource(getattr(f, "py_func", f)) for f in (*calls, function))
        return kept(numba.njit(**options)(function), repr(options) + "".join(texts))

    return decorate
