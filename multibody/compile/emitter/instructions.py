"""Functions that become instructions or calls of the C library."""

from __future__ import annotations

from dataclasses import dataclass

from multibody.compile.emitter.kinds import FLOAT, FLOATS, INT, INTS, NOTHING, TRUTH, Array, Kind, joined

__all__ = ["CALLS", "METHODS", "Method", "result_kind"]


@dataclass(frozen=True)
class Method:
    """A function of `math`: its symbol, and what it returns."""

    symbol: str
    arguments: int = 1
    kind: Kind = FLOAT


def _intrinsics(*names: str) -> dict[str, Method]:
    return {name: Method(f"llvm.{name}.f64") for name in names}


METHODS: dict[str, Method] = {
    **_intrinsics("sin", "cos", "exp", "exp2", "log", "log2", "log10", "sqrt", "fabs", "floor", "ceil"),
    **{name: Method(name) for name in ("tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "expm1", "log1p", "erf")},
    "copysign": Method("llvm.copysign.f64", 2),
    "pow": Method("llvm.pow.f64", 2),
    "atan2": Method("atan2", 2),
    "hypot": Method("hypot", 2),
    "isfinite": Method("", 1, TRUTH),
    "isnan": Method("", 1, TRUTH),
}

# The instructions of drivers: see solvers/kernels/calls.py, which says what each does.
CALLS = ("call_rhs", "call_batched", "call_tangent")


def result_kind(name: str, arguments: tuple[Kind, ...]) -> Kind | None:
    """Return the kind that an instruction gives, or None for another name."""
    if name in ("min", "max"):
        kind = arguments[0]
        for other in arguments[1:]:
            kind = joined(kind, other)
        return kind
    if name == "abs":
        return arguments[0]
    if name == "pointer":
        kind = arguments[0]
        return (FLOATS if kind.of == FLOAT else INTS) if isinstance(kind, Array) else kind
    if name == "shift":
        return arguments[0]
    if name in CALLS:
        return NOTHING
    return {"int": INT, "round": INT, "float": FLOAT, "bool": TRUTH, "floats": FLOATS, "ints": INTS}.get(name)
