"""The equations of several runs of one structure in one pass: every number a vector of one entry for each run."""

from __future__ import annotations

from functools import lru_cache, partial

from multibody.compile.emitter.kinds import Kind, Lanes, LanesAt, Outside
from multibody.compile.emitter.units import Unit, unit_of_text
from multibody.compile.native import RHS_ARRAYS, NativeFunction, compiling

__all__ = ["batched_rhs", "batched_rhs_is_cached"]

_ENTRY = "\n\ndef {name}_batched(t, x, u, p, dx):\n    {name}(t[0], x, u, p, dx)\n"


def batched_rhs(rhs: NativeFunction, count: int) -> int:
    """Return the address of a right-hand side for several runs, or 0 where it is outside the compiler's subset.

    Times, states (n, count), inputs (n_u, count), parameters (n_p, count) and rates (n, count) of the runs stand side
    by side; conditions are worked out on both sides, tables and functions that search or leave early for one run after
    another.  The rates of each run are those that it has alone, to the last bit.

    Parameters
    ----------
    rhs : NativeFunction
        Of a system or of a text of one's own.
    count : int
        Number of runs.
    """
    return _made(*rhs.origin, rhs.name, count) if _can_be(rhs) else 0


def batched_rhs_is_cached(rhs: NativeFunction, count: int) -> bool:
    """Tell whether `batched_rhs` finds its code in the cache, so that it costs no compilation."""
    from multibody.compile.emitter.build import built

    if not _can_be(rhs):
        return False
    text, stem = rhs.origin
    return built(stem, _source(text, rhs.name), f"{rhs.name}_batched", _kinds(count))


def _can_be(rhs: NativeFunction) -> bool:
    return rhs.compiled and bool(rhs.origin[0]) and rhs.arrays == RHS_ARRAYS and not rhs.lanes


def _source(text: str, name: str) -> tuple[str]:
    return (text + _ENTRY.format(name=name),)


def _kinds(count: int) -> tuple[Kind, ...]:
    return (LanesAt(count),) * (1 + RHS_ARRAYS)


@lru_cache(maxsize=256)
def _made(text: str, stem: str, name: str, count: int) -> int:
    from multibody.compile.emitter.build import build

    source = _source(text, name)
    try:
        with compiling:
            return build(stem, source, partial(_unit, *source, stem, name, count), f"{name}_batched", _kinds(count))[0]
    except Outside:
        return 0


def _unit(text: str, stem: str, name: str, count: int) -> Unit:
    from multibody.compile.emitter.program import Program

    unit = unit_of_text(text, f"{stem} batched")
    if Program().one_by_one(unit, name, (Lanes(count), *_kinds(count)[1:])):
        raise Outside(f"{name}: all of it would be worked out for one run after another")
    return unit
