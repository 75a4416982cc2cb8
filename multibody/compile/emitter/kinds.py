"""Kinds of values: real, whole, condition, pointer, array, lanes of real numbers or conditions, several at once."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any

import numpy as np

__all__ = [
    "FLOAT", "FLOATS", "INT", "INTS", "NOTHING", "TRUTH", "Array", "Kind", "Lanes", "LanesAt", "OneLaneAt", "Outside",
    "Truths", "Value", "address_of", "element", "in_lanes", "joined", "kind_and_address", "kind_of_argument",
    "lanes_of", "llvm_type", "of_one_lane", "real",
]  # fmt: skip


_NOTHING_OF = (ctypes.c_char * 0).from_buffer


class Outside(Exception):
    """Source text that is outside the subset; the message says where."""


@dataclass(frozen=True)
class Array:
    """An array argument of a function that Python calls: a pointer and its shape."""

    of: str
    dimensions: int


@dataclass(frozen=True)
class Lanes:
    """Real numbers that go through the same operations at once; a plain number beside them counts for every lane."""

    count: int


@dataclass(frozen=True)
class Truths:
    """Conditions, one for each lane."""

    count: int


@dataclass(frozen=True)
class LanesAt:
    """The address of lanes, one after another."""

    count: int


@dataclass(frozen=True)
class OneLaneAt:
    """The address of real numbers that lie so many apart: one lane of what `LanesAt` holds."""

    count: int


FLOAT, INT, TRUTH, FLOATS, INTS, NOTHING = "float", "int", "truth", "floats", "ints", "nothing"
Kind = Any  # one of the names above, an Array, Lanes, or a tuple of kinds
_LLVM = {FLOAT: "double", INT: "i64", TRUTH: "i1", FLOATS: "ptr", INTS: "ptr", NOTHING: "void"}
_RANK = {TRUTH: 0, INT: 1, FLOAT: 2}


_PLAIN: dict[type, Kind] = {int: INT, float: FLOAT, bool: TRUTH, np.int64: INT, np.float64: FLOAT}
_REAL, _WHOLE = np.dtype(np.float64), np.dtype(np.int64)
_HELD = {np.dtype(k).str: [Array(of, n) for n in range(8)] for k, of in ((np.float64, FLOAT), (np.int64, INT))}
_REALS, _WHOLES = _HELD[_REAL.str], _HELD[_WHOLE.str]


@dataclass(frozen=True)
class Value:
    """A value in the text: its kind and its name or number; an array's shape beside it."""

    kind: Kind
    name: str
    shape: tuple[str, ...] = ()
    whole: int | None = None


def llvm_type(kind: Kind) -> str:
    """Return LLVM's name of a kind.

    Examples
    --------
    >>> llvm_type(FLOAT), llvm_type((FLOAT, INT)), llvm_type(Lanes(4))
    ('double', '{ double, i64 }', '<4 x double>')
    """
    if isinstance(kind, tuple):
        return "{ " + ", ".join(map(llvm_type, kind)) + " }"
    if isinstance(kind, Lanes | Truths):
        return f"<{kind.count} x {'double' if isinstance(kind, Lanes) else 'i1'}>"
    return "ptr" if isinstance(kind, Array | LanesAt | OneLaneAt) else _LLVM[kind]


def joined(a: Kind, b: Kind) -> Kind:
    """Return the kind that holds both: a whole number in the place of a real one becomes real, and that one lanes.

    Raises
    ------
    Outside
        If there is none.
    """
    if a == b or b is None:
        return a
    if a is None:
        return b
    if isinstance(a, tuple) and isinstance(b, tuple) and len(a) == len(b):
        return tuple(joined(x, y) for x, y in zip(a, b, strict=True))
    for one, other in ((a, b), (b, a)):
        if isinstance(one, Lanes) and other in _RANK:
            return one
        if isinstance(one, Truths) and other == TRUTH:
            return one
    if a in _RANK and b in _RANK:
        return a if _RANK[a] > _RANK[b] else b
    raise Outside(f"one name holds {a} and {b}")


def element(kind: Kind) -> Kind:
    """Return the kind of what a pointer or an array holds."""
    if isinstance(kind, Array):
        return kind.of
    if isinstance(kind, LanesAt):
        return Lanes(kind.count)
    if isinstance(kind, OneLaneAt):
        return FLOAT
    if kind in (FLOATS, INTS):
        return FLOAT if kind == FLOATS else INT
    raise Outside(f"{kind} has no elements")


def lanes_of(*kinds: Kind) -> int:
    """Return how many lanes there are among kinds, or 0."""
    return max((kind.count for kind in kinds if isinstance(kind, Lanes | Truths | LanesAt)), default=0)


def of_one_lane(kind: Kind) -> Kind:
    """Return the kind that one lane of a kind has."""
    if isinstance(kind, LanesAt):
        return OneLaneAt(kind.count)
    return FLOAT if isinstance(kind, Lanes) else TRUTH if isinstance(kind, Truths) else kind


def in_lanes(kind: Kind, count: int) -> Kind:
    """Return the kind of so many values of a kind side by side.

    Examples
    --------
    >>> in_lanes((FLOAT, TRUTH), 4)
    (Lanes(count=4), Truths(count=4))
    """
    if isinstance(kind, tuple):
        return tuple(in_lanes(k, count) for k in kind)
    if kind in (FLOAT, INT):
        return Lanes(count)
    return Truths(count) if kind == TRUTH else kind


def kind_of_argument(value: Any) -> Kind:
    """Return the kind under which a value of Python is handed to compiled code.

    Raises
    ------
    TypeError
        For arrays that are not contiguous or hold neither float64 nor int64, and for anything else.
    """
    kind = _PLAIN.get(type(value))
    if kind is not None:
        return kind
    if isinstance(value, np.ndarray):
        return kind_and_address(value)[0]
    if isinstance(value, bool | np.bool_):
        return TRUTH
    if isinstance(value, int | np.integer):
        return INT
    if isinstance(value, float | np.floating):
        return FLOAT
    raise TypeError(f"compiled code takes numbers and arrays, not {type(value).__name__}")


def kind_and_address(array: np.ndarray) -> tuple[Kind, int]:
    """Return the kind of an array, as `kind_of_argument` does, and the address of its first element."""
    own = array.dtype
    held = _REALS if own is _REAL else _WHOLES if own is _WHOLE else _HELD.get(own.str)
    try:
        address = ctypes.addressof(_NOTHING_OF(array))  # type: ignore[arg-type]
    except (TypeError, ValueError):  # not writable, or not contiguous
        held = held if array.flags.c_contiguous else None
        address = int(array.__array_interface__["data"][0])
    if held is None:
        raise TypeError(f"compiled code takes contiguous arrays of float64 or int64, not {array.dtype}")
    return held[array.ndim], address


def address_of(array: np.ndarray) -> int:
    """Return the address of a contiguous array's first element; NumPy's own ways take three times as long."""
    try:
        return ctypes.addressof(_NOTHING_OF(array))  # type: ignore[arg-type]
    except (TypeError, ValueError):  # not writable, or not contiguous
        return int(array.__array_interface__["data"][0])


def real(value: float) -> str:
    """Return a number as LLVM writes it, exactly."""
    import struct

    return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"
