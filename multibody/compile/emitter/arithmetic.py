"""Numbers and what is computed with them, as LLVM text."""

from __future__ import annotations

import ast
from typing import Any

import numpy as np

from multibody.compile.emitter.inference import Kinds
from multibody.compile.emitter.kinds import (
    FLOAT,
    INT,
    TRUTH,
    Array,
    Kind,
    Lanes,
    Outside,
    Truths,
    Value,
    joined,
    llvm_type,
    real,
)
from multibody.compile.emitter.lanes import InLanes

__all__ = ["Arithmetic"]

_ARITHMETIC = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul"}
_SQUARINGS = 16


class Arithmetic(InLanes):
    """Writes operations into the text of one function.

    Parameters
    ----------
    program : Program
        Knows the other functions and the constants.
    kinds : Kinds
        Of the function's names.
    """

    def __init__(self, program: Any, kinds: Kinds) -> None:
        self.program, self.kinds, self.unit = program, kinds, kinds.unit
        self._flag = "contract " if self.unit.fused(kinds.node.name) else ""
        self._access = ""  # what is noted at loads and stores of the loop that is being written
        self.lines: list[str] = []
        self.values: dict[str, Value] = {}  # names assigned once
        self.slots: dict[str, Value] = {}  # names assigned more often, by their place in memory
        self.label = "entry"
        self._mask: Value | None = None  # lanes in which what is being written counts
        self._count = 0

    # ---------------------------------------------------------------- text

    def fresh(self, stem: str = "v") -> str:
        """Return a new name."""
        self._count += 1
        return f"{stem}{self._count}"

    def emit(self, kind: Kind, text: str, **more: Any) -> Value:
        """Write an instruction that gives a value."""
        name = f"%{self.fresh()}"
        self.lines.append(f"  {name} = {text}")
        return Value(kind, name, **more)

    def begin(self, label: str) -> None:
        """Begin a block."""
        self.lines.append(f"{label}:")
        self.label = label

    def jump(self, label: str) -> None:
        """End a block with a jump."""
        self.lines.append(f"  br label %{label}")

    def refuse(self, node: ast.AST, why: str) -> Outside:
        """Return the error for what is outside the subset."""
        return Outside(f"{self.unit.name}, line {getattr(node, 'lineno', '?')}: {why}")

    # ---------------------------------------------------------------- numbers

    def constant(self, value: Any, node: ast.AST) -> Value:
        """Return a number, or an array of numbers, as a value."""
        if isinstance(value, bool):
            return Value(TRUTH, "true" if value else "false")
        if isinstance(value, int):
            return Value(INT, str(value), whole=value)
        if isinstance(value, float):
            return Value(FLOAT, real(value))
        if isinstance(value, np.ndarray):
            kind = Array(FLOAT if value.dtype == np.float64 else INT, value.ndim)
            return Value(kind, self.program.table(value), tuple(map(str, value.shape)))
        raise self.refuse(node, f"a {type(value).__name__} in the place of a number")

    def to(self, value: Value, kind: Kind, node: ast.AST) -> Value:
        """Return a value as another kind."""
        if value.kind == kind:
            return value
        if isinstance(kind, tuple) and isinstance(value.kind, tuple):
            parts = [self.to(v, k, node) for v, k in zip(self.parts(value, len(kind)), kind, strict=True)]
            return self.together(parts, kind)
        if (isinstance(kind, Lanes) and value.kind in (FLOAT, INT, TRUTH)) or (
            isinstance(kind, Truths) and value.kind == TRUTH
        ):
            return self.spread(value, kind, node)
        if kind == FLOAT and value.kind in (INT, TRUTH):
            if value.whole is not None:
                return Value(FLOAT, real(float(value.whole)))
            return self.emit(
                FLOAT, f"{'si' if value.kind == INT else 'ui'}tofp {llvm_type(value.kind)} {value.name} to double"
            )
        if kind == INT and value.kind == TRUTH:
            return self.emit(INT, f"zext i1 {value.name} to i64")
        raise self.refuse(node, f"{value.kind} in the place of {kind}")

    def together(self, parts: list[Value], kind: Kind) -> Value:
        """Return several values as one."""
        whole = Value(kind, "poison")
        for k, part in enumerate(parts):
            whole = self.emit(
                kind, f"insertvalue {llvm_type(kind)} {whole.name}, {llvm_type(part.kind)} {part.name}, {k}"
            )
        return whole

    def parts(self, value: Value, count: int) -> list[Value]:
        """Return the parts of several values."""
        if not isinstance(value.kind, tuple) or len(value.kind) != count:
            raise Outside(f"{self.unit.name}: {count} names take {value.kind}")
        text = f"extractvalue {llvm_type(value.kind)} {value.name}"
        return [self.emit(kind, f"{text}, {k}") for k, kind in enumerate(value.kind)]

    # ---------------------------------------------------------------- operations

    def arithmetic(self, op: ast.operator, a: Value, b: Value, node: ast.AST) -> Value:
        """Write one operation of two values."""
        if isinstance(op, ast.Pow):
            return self._power(a, b, node)
        kind = joined(joined(a.kind, b.kind), FLOAT if isinstance(op, ast.Div) else INT)
        if kind not in (FLOAT, INT) and not isinstance(kind, Lanes):
            raise self.refuse(node, f"arithmetic with {kind}")
        a, b = self.to(a, kind, node), self.to(b, kind, node)
        if type(op) in _ARITHMETIC:
            word = _ARITHMETIC[type(op)] if kind == INT else f"f{_ARITHMETIC[type(op)]} {self._flag}".rstrip()
            return self.emit(kind, f"{word} {llvm_type(kind)} {a.name}, {b.name}")
        if isinstance(op, ast.Div):
            return self.emit(kind, f"fdiv {llvm_type(kind)} {a.name}, {b.name}")
        if isinstance(op, ast.Mod) and kind == FLOAT:
            return self._modulo(a, b)
        if isinstance(op, ast.Mod) and isinstance(kind, Lanes):
            return self.lane_by_lane([a, b], lambda one: self._modulo(one[0], one[1]))
        if kind == INT and isinstance(op, ast.FloorDiv | ast.Mod):
            return self._whole_division(op, a, b)
        raise self.refuse(node, "this operator is outside the subset")

    def _modulo(self, a: Value, b: Value) -> Value:
        """As Python: the result has the sign of b."""
        rest = self.emit(FLOAT, f"frem double {a.name}, {b.name}")
        negative = self.emit(TRUTH, f"fcmp olt double {rest.name}, 0.0")
        below = self.emit(TRUTH, f"fcmp olt double {b.name}, 0.0")
        differ = self.emit(TRUTH, f"xor i1 {negative.name}, {below.name}")
        some = self.emit(TRUTH, f"fcmp one double {rest.name}, 0.0")
        turn = self.emit(TRUTH, f"and i1 {differ.name}, {some.name}")
        moved = self.emit(FLOAT, f"fadd double {rest.name}, {b.name}")
        signed = self.intrinsic("llvm.copysign.f64", [rest, b])
        kept = self.emit(FLOAT, f"select i1 {some.name}, double {rest.name}, double {signed.name}")
        return self.emit(FLOAT, f"select i1 {turn.name}, double {moved.name}, double {kept.name}")

    def _whole_division(self, op: ast.operator, a: Value, b: Value) -> Value:
        """As Python: the quotient is rounded down and the rest has the sign of b."""
        rest = self.emit(INT, f"srem i64 {a.name}, {b.name}")
        signs = self.emit(INT, f"xor i64 {rest.name}, {b.name}")
        differ = self.emit(TRUTH, f"icmp slt i64 {signs.name}, 0")
        some = self.emit(TRUTH, f"icmp ne i64 {rest.name}, 0")
        turn = self.emit(TRUTH, f"and i1 {differ.name}, {some.name}")
        if isinstance(op, ast.Mod):
            moved = self.emit(INT, f"add i64 {rest.name}, {b.name}")
            return self.emit(INT, f"select i1 {turn.name}, i64 {moved.name}, i64 {rest.name}")
        quotient = self.emit(INT, f"sdiv i64 {a.name}, {b.name}")
        less = self.emit(INT, f"sub i64 {quotient.name}, 1")
        return self.emit(INT, f"select i1 {turn.name}, i64 {less.name}, i64 {quotient.name}")

    def _power(self, a: Value, b: Value, node: ast.AST) -> Value:
        if b.whole is None or abs(b.whole) > _SQUARINGS:
            if isinstance(a.kind, Lanes) or isinstance(b.kind, Lanes):
                return self.lane_by_lane([a, b], lambda one: self._power(one[0], one[1], node))
            return self.intrinsic("llvm.pow.f64", [self.to(a, FLOAT, node), self.to(b, FLOAT, node)])
        if a.kind == INT and (a.whole is not None or b.whole < 0):
            raise self.refuse(node, "a power of a whole number")
        word = "mul i64" if a.kind == INT else f"fmul {llvm_type(a.kind)}"
        result: Value | None = None
        factor, left = a, abs(b.whole)
        while left:
            if left & 1:
                result = factor if result is None else self.emit(a.kind, f"{word} {result.name}, {factor.name}")
            left >>= 1
            if left:
                factor = self.emit(a.kind, f"{word} {factor.name}, {factor.name}")
        if result is None:
            return self.to(Value(INT, "1", whole=1), a.kind, node)
        if b.whole > 0:
            return result
        one = self.to(Value(FLOAT, real(1.0)), a.kind, node)
        return self.emit(a.kind, f"fdiv {llvm_type(a.kind)} {one.name}, {result.name}")

    def intrinsic(self, symbol: str, arguments: list[Value], kind: Kind = FLOAT) -> Value:
        """Write the call of a function of real numbers, or of lanes."""
        of = llvm_type(kind)
        self.program.declare(symbol, len(arguments), of)
        return self.emit(kind, f"call {of} @{symbol}({', '.join(f'{of} {a.name}' for a in arguments)})")

    def builtin(self, name: str, arguments: list[Value], node: ast.AST) -> Value:
        """Write min, max, abs, int, round, float or bool."""
        first = arguments[0]
        if name in ("min", "max"):
            kind = first.kind
            for other in arguments[1:]:
                kind = joined(kind, other.kind)
            result = self.to(first, kind, node)
            for other in arguments[1:]:  # as Python: a later one is taken if it is less, or greater
                other = self.to(other, kind, node)
                order = "lt" if name == "min" else "gt"
                of = llvm_type(kind)
                word = f"icmp s{order} i64" if kind == INT else f"fcmp o{order} {of}"
                test = self.emit(
                    Truths(kind.count) if isinstance(kind, Lanes) else TRUTH, f"{word} {other.name}, {result.name}"
                )
                result = self.select(test, other, result, kind)
            return result
        if name == "abs":
            if first.kind == FLOAT:
                return self.intrinsic("llvm.fabs.f64", [first])
            if isinstance(first.kind, Lanes):
                return self.intrinsic(f"llvm.fabs.v{first.kind.count}f64", [first], first.kind)
            minus = self.emit(INT, f"sub i64 0, {first.name}")
            test = self.emit(TRUTH, f"icmp slt i64 {first.name}, 0")
            return self.emit(INT, f"select i1 {test.name}, i64 {minus.name}, i64 {first.name}")
        if name == "round" and first.kind == FLOAT and len(arguments) == 1:
            first, name = self.intrinsic("llvm.roundeven.f64", [first]), "int"
        if name == "int":
            return (
                self.emit(INT, f"fptosi double {first.name} to i64")
                if first.kind == FLOAT
                else self.to(first, INT, node)
            )
        if isinstance(first.kind, Lanes):
            raise self.refuse(node, f"{name} of numbers that differ from lane to lane")
        return self.to(first, FLOAT, node) if name == "float" else self.truth_of(first, node)

    def truth_of(self, value: Value, node: ast.AST) -> Value:
        """Return a number as a condition."""
        if value.kind == FLOAT:
            return self.emit(TRUTH, f"fcmp une double {value.name}, 0.0")
        return value if value.kind == TRUTH else self.emit(TRUTH, f"icmp ne i64 {self.to(value, INT, node).name}, 0")
