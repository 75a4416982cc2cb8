"""What compiled drivers need beyond plain functions: calls to an address, and bare pointers.

Arrays that travel through several functions carry a shape that nobody reads there.  Inside the drivers data are
therefore bare pointers, which are indexed like arrays.  The functions below are what they mean in plain Python;
the emitter turns them into instructions.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable
from typing import Any

from multibody.compile.emitter.entries import Entry as entry
from multibody.compile.emitter.entries import Inner as inner
from multibody.compile.emitter.entries import Instruction

__all__ = [
    "call_batched",
    "call_rhs",
    "call_tangent",
    "entry",
    "floats",
    "fused",
    "independent",
    "inner",
    "ints",
    "pointer",
    "register_python",
    "shift",
]

fused = functools.partial(inner, fused=True)
"""As ``inner``, for functions in which a product and the sum that it goes into may be rounded once."""

independent = range
"""As ``range``, for loops over elements of which no turn touches what another one writes."""

_python_functions: dict[int, Callable[..., None]] = {}


def register_python(address: int, function: Callable[..., None]) -> None:
    """Remember what to call for an address when nothing is compiled."""
    _python_functions[address] = function


@Instruction
def call_rhs(address: int, t: float, x: Any, u: Any, p: Any, out: Any) -> None:
    """Call ``f(t, x, u, p, out)`` at an address."""
    _python_functions[address](t, x, u, p, out)


@Instruction
def call_batched(address: int, t: Any, x: Any, u: Any, p: Any, out: Any) -> None:
    """Call ``f(t, x, u, p, out)`` at an address for the lanes of several runs, the times among them."""
    _python_functions[address](t, x, u, p, out)


@Instruction
def call_tangent(address: int, t: float, x: Any, u: Any, p: Any, x_dot: Any, u_dot: Any, p_dot: Any, out: Any) -> None:
    """Call ``f(t, x, u, p, x_dot, u_dot, p_dot, out)`` at an address."""
    _python_functions[address](t, x, u, p, x_dot, u_dot, p_dot, out)


@Instruction
def pointer(array: Any) -> Any:
    """Return the elements of a contiguous array, which must outlive the pointer."""
    return array.reshape(-1)


@Instruction
def shift(elements: Any, count: int) -> Any:
    """Return the elements from ``count`` on."""
    if isinstance(elements, ctypes._Pointer):
        address = ctypes.cast(elements, ctypes.c_void_p).value or 0
        return ctypes.cast(address + 8 * int(count), type(elements))
    return elements[count:]


@Instruction
def floats(address: int) -> Any:
    """Return the float64 elements at an address."""
    return ctypes.cast(int(address), ctypes.POINTER(ctypes.c_double))


@Instruction
def ints(address: int) -> Any:
    """Return the int64 elements at an address."""
    return ctypes.cast(int(address), ctypes.POINTER(ctypes.c_int64))
