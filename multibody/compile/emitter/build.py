"""Addresses of functions: found in the cache, or written, optimised and kept there."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import lru_cache

from multibody.base.cache import cache_dir, fingerprint, read_object, write_object
from multibody.base.compile_events import tell
from multibody.compile.emitter.kinds import Kind
from multibody.compile.emitter.machine import compiled, loaded
from multibody.compile.emitter.units import Unit

__all__ = ["build", "built"]

SYMBOL = "vtsdt_entry"


def build(
    stem: str, source: tuple[str, ...], unit: Callable[[], Unit], name: str, arguments: tuple[Kind, ...]
) -> tuple[int, tuple[str, ...]]:
    """Return the address of a function and the kinds of what it returns (see `Program.add`).

    Parameters
    ----------
    stem : str
        Beginning of the file's name in the cache.
    source : tuple of str
        Everything that the machine code follows from.
    unit : callable
        Gives the function's unit, if it has to be compiled.
    name : str
        The function.
    arguments : tuple of kinds

    Raises
    ------
    Outside
        If the function is outside the subset.
    """
    key = fingerprint(*source, name, repr(arguments))
    return _built(f"{stem}_{key}", unit, name, arguments)


def built(stem: str, source: tuple[str, ...], name: str, arguments: tuple[Kind, ...]) -> bool:
    """Tell whether `build` would find a function in the cache."""
    return (cache_dir() / f"{stem}_{fingerprint(*source, name, repr(arguments))}.o").exists()


@lru_cache(maxsize=1024)
def _built(stem: str, unit: Callable[[], Unit], name: str, arguments: tuple[Kind, ...]) -> tuple[int, tuple[str, ...]]:
    path = cache_dir() / f"{stem}.o"
    found = read_object(path)
    if found is not None:
        try:
            return loaded(found[0], SYMBOL), tuple(filter(None, found[1].split(",")))
        except ValueError:
            pass  # code of another format: made anew
    begun = time.perf_counter()
    tell(name, None)
    from multibody.compile.emitter.program import Program

    program = Program()
    returns = program.add(unit(), name, arguments, SYMBOL)
    code = compiled(program.text())
    write_object(path, code, ",".join(returns))
    address = loaded(code, SYMBOL)
    tell(name, time.perf_counter() - begun)
    return address, returns
