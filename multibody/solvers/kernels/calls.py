"""What compiled drivers need beyond numba: calls to an address, and bare pointers.

Arrays that travel through several compiled functions cost more than the mathematics of a small model: numba
counts references to them at every hand-over, atomically.  Inside the drivers data are therefore bare
pointers, which are indexed like arrays.  Without compilation the same names stand for numpy views, or for
ctypes pointers.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

from numba import config, njit, types
from numba.extending import intrinsic

__all__ = [
    "call_rhs",
    "call_tangent",
    "entry",
    "floats",
    "inner",
    "ints",
    "pointer",
    "register_python",
    "shift",
]

# Called from Python: cached on disk.  The rest: called from compiled code only, so that the wrappers for
# Python, which cost more to compile than the functions, are left out.
entry: Any = njit(cache=True, error_model="numpy", nogil=True)
_inner_options: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
inner: Any = njit(error_model="numpy", **_inner_options)

_config: Any = config
_python_functions: dict[int, Callable[..., None]] = {}
_FLOATS = types.CPointer(types.float64)
_INTS = types.CPointer(types.int64)


def register_python(address: int, function: Callable[..., None]) -> None:
    """Remember what to call for an address when nothing is compiled."""
    _python_functions[address] = function


def _data(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    return context.make_array(kind)(context, builder, value).data if isinstance(kind, types.Array) else value


def _emit_call(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    from llvmlite import ir

    pointers = [_data(context, builder, *pair) for pair in zip(signature.args[2:], args[2:], strict=True)]
    prototype = ir.FunctionType(ir.VoidType(), [ir.DoubleType()] + [pointer.type for pointer in pointers])
    builder.call(builder.inttoptr(args[0], prototype.as_pointer()), [args[1], *pointers])
    return context.get_dummy_value()


def _is_vector(kind: Any) -> bool:
    array = isinstance(kind, types.Array) and kind.dtype == types.float64 and kind.layout == "C"
    return array or kind == _FLOATS


def _type_call(address: Any, t: Any, *vectors: Any) -> Any:
    if isinstance(address, types.Integer) and t == types.float64 and all(map(_is_vector, vectors)):
        return types.void(types.uintp, t, *vectors), _emit_call
    return None


def _type_cast(address: Any, kind: Any) -> Any:
    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], context.get_value_type(kind))

    return (kind(types.intp), emit) if isinstance(address, types.Integer) else None


if _config.DISABLE_JIT:

    def call_rhs(address: int, t: float, x: Any, u: Any, p: Any, out: Any) -> None:
        """Call ``f(t, x, u, p, out)`` at an address."""
        _python_functions[address](t, x, u, p, out)

    def call_tangent(
        address: int, t: float, x: Any, u: Any, p: Any, x_dot: Any, u_dot: Any, p_dot: Any, out: Any
    ) -> None:
        """Call ``f(t, x, u, p, x_dot, u_dot, p_dot, out)`` at an address."""
        _python_functions[address](t, x, u, p, x_dot, u_dot, p_dot, out)

    def pointer(array: Any) -> Any:
        """Return the elements of a contiguous array."""
        return array.reshape(-1)

    def shift(elements: Any, count: int) -> Any:
        """Return the elements from ``count`` on."""
        if isinstance(elements, ctypes._Pointer):
            address = ctypes.cast(elements, ctypes.c_void_p).value or 0
            return ctypes.cast(address + 8 * int(count), type(elements))
        return elements[count:]

    def floats(address: int) -> Any:
        """Return the float64 elements at an address."""
        return ctypes.cast(int(address), ctypes.POINTER(ctypes.c_double))

    def ints(address: int) -> Any:
        """Return the int64 elements at an address."""
        return ctypes.cast(int(address), ctypes.POINTER(ctypes.c_int64))

else:

    @intrinsic
    def call_rhs(typingctx, address, t, x, u, p, out):  # type: ignore[no-untyped-def,misc]
        """Call ``f(t, x, u, p, out)`` at an address; vectors are arrays or pointers."""
        return _type_call(address, t, x, u, p, out)

    @intrinsic
    def call_tangent(typingctx, address, t, x, u, p, x_dot, u_dot, p_dot, out):  # type: ignore[no-untyped-def,misc]
        """Call ``f(t, x, u, p, x_dot, u_dot, p_dot, out)`` at an address; vectors are arrays or pointers."""
        return _type_call(address, t, x, u, p, x_dot, u_dot, p_dot, out)

    @intrinsic
    def pointer(typingctx, array):  # type: ignore[no-untyped-def,misc]
        """Return the elements of a contiguous array, which must outlive the pointer."""

        def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return _data(context, builder, signature.args[0], args[0])

        if isinstance(array, types.Array) and array.layout == "C":
            return types.CPointer(array.dtype)(array), emit
        return None

    @intrinsic
    def shift(typingctx, elements, count):  # type: ignore[no-untyped-def,misc]
        """Return the elements from ``count`` on."""

        def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return builder.gep(args[0], [args[1]])

        if isinstance(elements, types.CPointer) and isinstance(count, types.Integer):
            return elements(elements, types.intp), emit
        return None

    @intrinsic
    def floats(typingctx, address):  # type: ignore[no-untyped-def,misc]
        """Return the float64 elements at an address."""
        return _type_cast(address, _FLOATS)

    @intrinsic
    def ints(typingctx, address):  # type: ignore[no-untyped-def,misc]
        """Return the int64 elements at an address."""
        return _type_cast(address, _INTS)
