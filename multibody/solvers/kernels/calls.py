"""Calls from compiled code to a function known by its address only."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import config, njit, types
from numba.extending import intrinsic

__all__ = ["call_rhs", "call_tangent", "entry", "inner", "register_python"]

# Called from Python: cached on disk.  The rest: called from compiled code only, so that the wrappers for
# Python, which cost more to compile than the functions, are left out.
entry: Any = njit(cache=True, error_model="numpy", nogil=True)
_inner_options: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
inner: Any = njit(error_model="numpy", **_inner_options)
_config: Any = config

_python_functions: dict[int, Callable[..., None]] = {}


def register_python(address: int, function: Callable[..., None]) -> None:
    """Remember what to call for an address when nothing is compiled."""
    _python_functions[address] = function


def _emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    from llvmlite import ir

    double = ir.DoubleType()
    pointers = []
    for kind, value in zip(signature.args[2:], args[2:], strict=True):
        pointers.append(context.make_array(kind)(context, builder, value).data)
    prototype = ir.FunctionType(ir.VoidType(), [double] + [pointer.type for pointer in pointers])
    function = builder.inttoptr(args[0], prototype.as_pointer())
    builder.call(function, [args[1], *pointers])
    return context.get_dummy_value()


def _typed(address: Any, t: Any, *arrays: Any) -> Any:
    fits = all(
        isinstance(a, types.Array) and a.dtype == types.float64 and a.layout == "C" and a.ndim == 1
        for a in arrays
    )
    if not (fits and isinstance(address, types.Integer) and t == types.float64):
        return None
    return types.void(types.uintp, t, *arrays), _emit


if _config.DISABLE_JIT:

    def call_rhs(address: int, t: float, x: Any, u: Any, p: Any, out: Any) -> None:
        """Call ``f(t, x, u, p, out)`` at an address."""
        _python_functions[address](t, x, u, p, out)

    def call_tangent(
        address: int, t: float, x: Any, u: Any, p: Any, x_dot: Any, u_dot: Any, p_dot: Any, out: Any
    ) -> None:
        """Call ``f(t, x, u, p, x_dot, u_dot, p_dot, out)`` at an address."""
        _python_functions[address](t, x, u, p, x_dot, u_dot, p_dot, out)

else:

    @intrinsic
    def call_rhs(typingctx, address, t, x, u, p, out):  # type: ignore[no-untyped-def,misc]
        """Call ``f(t, x, u, p, out)`` at an address."""
        return _typed(address, t, x, u, p, out)

    @intrinsic
    def call_tangent(typingctx, address, t, x, u, p, x_dot, u_dot, p_dot, out):  # type: ignore[no-untyped-def,misc]
        """Call ``f(t, x, u, p, x_dot, u_dot, p_dot, out)`` at an address."""
        return _typed(address, t, x, u, p, x_dot, u_dot, p_dot, out)
