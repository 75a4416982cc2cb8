"""What goes through numba: texts outside the compiler's subset, and drivers that use all of numpy.

A driver compiled by numba may call everything that is marked `entry` or `inner` and the instructions of
`multibody.compile.calls`: this module gives numba its view of them.
"""

from __future__ import annotations

from functools import lru_cache
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

from multibody.base.compile_events import listen_to_numba

__all__ = [
    "address_of_function",
    "call_rhs",
    "call_tangent",
    "dispatcher",
    "floats",
    "function_on_arrays",
    "function_on_pointers",
    "function_with_result",
    "intrinsic_type",
    "ints",
    "platform",
    "pointer",
    "shift",
]  # fmt: skip

from numba import errors, njit, types
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


def function_on_pointers(module: ModuleType, name: str, arrays: int) -> Any:
    """Return a function ``f(t, *arrays)`` of a module from `native.load_source`, compiled and kept on disk.

    Its arrays are pointers.  Division by zero gives inf or nan as in C, which the step control handles; an exception
    could not leave.
    """
    names = dict(vars(module))
    for key, value in vars(module).items():
        if isinstance(value, FunctionType) and value.__module__ == module.__name__ and key != name:
            names[key] = njit(error_model="numpy")(FunctionType(value.__code__, names, key, value.__defaults__))
    code = getattr(names[name], "py_func", names[name]).__code__
    signature = types.void(types.float64, *([_FLOATS] * arrays))
    listen_to_numba()
    return njit(signature, error_model="numpy", nogil=True, cache=True, no_cpython_wrapper=True)(
        FunctionType(code, names, name)
    )


def address_of_function(function: Any) -> int:
    """Return the C address of what `function_on_pointers` has compiled."""
    (compiled,) = function.overloads.values()
    return int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_cfunc_wrapper_name))


@intrinsic
def _elements(typingctx, array):  # type: ignore[no-untyped-def]
    if not (isinstance(array, types.Array) and _is_vector(array)):
        raise errors.TypingError(
            f"functions of a model take contiguous arrays of float64, not {array}: "
            "numpy.ascontiguousarray(..., dtype=float) makes one"
        )

    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _data(context, builder, signature.args[0], args[0])

    return _FLOATS(array), emit


def function_on_arrays(function: Any, arrays: int) -> Any:
    """Return what `function_on_pointers` has compiled as a numba function of arrays, which writes the last one."""
    if arrays == 4:

        def call(t, x, u, p, out):  # type: ignore[no-untyped-def]
            function(float(t), _elements(x), _elements(u), _elements(p), _elements(out))

    else:

        def call(t, x, u, p, x_dot, u_dot, p_dot, out):  # type: ignore[no-untyped-def, misc]
            function(float(t), _elements(x), _elements(u), _elements(p), _elements(x_dot), _elements(u_dot),
                     _elements(p_dot), _elements(out))  # fmt: skip

    return njit(error_model="numpy", nogil=True)(call)


def function_with_result(function: Any, size: int) -> Any:
    """Return ``f(t, x, u, p)`` as a numba function that returns a new array of so many elements."""

    def call(t, x, u, p):  # type: ignore[no-untyped-def]
        out = np.empty(size)
        function(t, x, u, p, out)
        return out

    return njit(error_model="numpy", nogil=True)(call)
