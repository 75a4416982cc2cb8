"""Addresses of functions: found in the cache, or written, optimised and kept there."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

from multibody.base.cache import cache_dir, digest_of, read_object, write_object
from multibody.base.compile_events import tell
from multibody.compile.emitter.kinds import Kind
from multibody.compile.emitter.machine import compiled, loaded, processor
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
    return _built(_file_of(stem, source, name, arguments), unit, name, arguments)


def built(stem: str, source: tuple[str, ...], name: str, arguments: tuple[Kind, ...]) -> bool:
    """Tell whether `build` would find a function in the cache."""
    return _file_of(stem, source, name, arguments).exists()


@lru_cache(maxsize=1)
def _compiler() -> str:
    """What machine code depends on beside its source: the text of this folder, LLVM and the processor."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    return digest_of(processor(), *(path.read_text(encoding="utf-8") for path in files))


def _file_of(stem: str, source: tuple[str, ...], name: str, arguments: tuple[Kind, ...]) -> Path:
    """Return the file of a function, whose name changes with everything that the machine code follows from."""
    return cache_dir() / f"{stem}_{digest_of(_compiler(), *source, name, repr(arguments))}.o"


@lru_cache(maxsize=1024)
def _built(path: Path, unit: Callable[[], Unit], name: str, arguments: tuple[Kind, ...]) -> tuple[int, tuple[str, ...]]:
    kept = read_object(path)
    if kept is not None:
        try:
            return loaded(kept[0], SYMBOL), tuple(filter(None, kept[1].split(",")))
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
