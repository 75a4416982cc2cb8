"""What goes through numba: texts outside the compiler's subset, and drivers that use all of numpy.

A driver compiled by numba may call everything that is marked `entry` or `inner` and the instructions of
`multibody.compile.calls`: this module gives numba its view of them.
"""

from __future__ import annotations

import re
import time
from functools import lru_cache
from typing import Any

from multibody.base.compile_events import tell

__all__ = [
    "call_rhs",
    "call_tangent",
    "compile_function",
    "dispatcher",
    "floats",
    "intrinsic_type",
    "ints",
    "platform",
    "pointer",
    "shift",
    "with_helpers_compiled",
]  # fmt: skip

from numba import njit, types
from numba.extending import intrinsic

_OPTIONS: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
_FLOATS = types.CPointer(types.float64)
_INTS = types.CPointer(types.int64)
_dispatchers: dict[Any, Any] = {}


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


@intrinsic
def call_rhs(typingctx, address, t, x, u, p, out):  # type: ignore[no-untyped-def]
    """As `calls.call_rhs`; vectors are arrays or pointers."""
    return _type_call(address, t, x, u, p, out)


@intrinsic
def call_tangent(typingctx, address, t, x, u, p, x_dot, u_dot, p_dot, out):  # type: ignore[no-untyped-def]
    """As `calls.call_tangent`; vectors are arrays or pointers."""
    return _type_call(address, t, x, u, p, x_dot, u_dot, p_dot, out)


@intrinsic
def pointer(typingctx, array):  # type: ignore[no-untyped-def]
    """As `calls.pointer`."""

    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _data(context, builder, signature.args[0], args[0])

    if isinstance(array, types.Array) and array.layout == "C":
        return types.CPointer(array.dtype)(array), emit
    return None


@intrinsic
def shift(typingctx, elements, count):  # type: ignore[no-untyped-def]
    """As `calls.shift`."""

    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.gep(args[0], [args[1]])

    if isinstance(elements, types.CPointer) and isinstance(count, types.Integer):
        return elements(elements, types.intp), emit
    return None


@intrinsic
def floats(typingctx, address):  # type: ignore[no-untyped-def]
    """As `calls.floats`."""
    return _type_cast(address, _FLOATS)


@intrinsic
def ints(typingctx, address):  # type: ignore[no-untyped-def]
    """As `calls.ints`."""
    return _type_cast(address, _INTS)


def intrinsic_type(name: str) -> Any:
    """Return numba's type of an instruction."""
    from numba.core.registry import cpu_target

    return cpu_target.typing_context.resolve_value_type(globals()[name])


def dispatcher(function: Any) -> Any:
    """Return numba's version of an `entry` or `inner` function."""
    if function not in _dispatchers:
        from multibody.compile.emitter.entries import Entry

        options = {} if isinstance(function, Entry) else dict(_OPTIONS)
        if function.fused:
            options["fastmath"] = {"contract"}
        _dispatchers[function] = njit(error_model="numpy", nogil=True, **options)(function.py_func)
    return _dispatchers[function]


@lru_cache(maxsize=1)
def platform() -> str:
    """Return what numba's code depends on."""
    import sys

    import llvmlite
    import numba
    from llvmlite import binding

    features = binding.get_host_cpu_features().flatten()
    versions = (numba.__version__, llvmlite.__version__, sys.version, binding.get_host_cpu_name(), features)
    return "\n".join(versions)


def with_helpers_compiled(text: str, name: str) -> str:
    """Return a generated text in which the functions that others call are compiled as well."""
    if "@njit" in text:
        return text
    mark = "@njit(cache=True, error_model='numpy')\ndef "
    body = re.sub(rf"^def (?!{re.escape(name)}\()", mark, text, flags=re.MULTILINE)
    return f"from numba import njit\n\n{body}"


def compile_function(python: Any, arrays: int) -> Any:
    """Return ``f(t, *arrays)`` as a numba function with a C address."""
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
    signature = types.void(types.float64, *([_FLOATS] * arrays))
    native = Announced(python, sigutils.normalize_signature(signature), locals={}, options={"error_model": "numpy"})
    native.enable_caching()
    native.compile()
    return native
