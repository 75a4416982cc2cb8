"""Expressions as LLVM text."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from multibody.compiler.inference import Kinds
from multibody.compiler.instructions import CALLS, METHODS
from multibody.compiler.kinds import (
    FLOAT,
    FLOATS,
    INT,
    INTS,
    NOTHING,
    TRUTH,
    Array,
    Kind,
    Outside,
    Value,
    element,
    joined,
    llvm_type,
    real,
)  # fmt: skip

__all__ = ["Expressions"]

_ARITHMETIC = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul"}
_COMPARE = {
    ast.Lt: ("olt", "slt"), ast.LtE: ("ole", "sle"), ast.Gt: ("ogt", "sgt"), ast.GtE: ("oge", "sge"),
    ast.Eq: ("oeq", "eq"), ast.NotEq: ("une", "ne"),
}  # fmt: skip
_SQUARINGS = 16


class Expressions:
    """Writes the expressions of one function.

    Parameters
    ----------
    program : Program
        Knows the other functions and the constants.
    kinds : Kinds
        Of the function's names.
    """

    def __init__(self, program: Any, kinds: Kinds) -> None:
        self.program, self.kinds, self.unit = program, kinds, kinds.unit
        self.lines: list[str] = []
        self.values: dict[str, Value] = {}  # names assigned once
        self.slots: dict[str, Value] = {}  # names assigned more often, by their place in memory
        self.label = "entry"
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

    # ---------------------------------------------------------------- expressions

    def value(self, node: ast.expr) -> Value:
        """Write an expression and return its value."""
        match node:
            case ast.Name(id=name):
                if name in self.values:
                    return self.values[name]
                if name in self.slots:
                    slot = self.slots[name]
                    return self.emit(slot.kind, f"load {llvm_type(slot.kind)}, ptr {slot.name}")
                if name in self.kinds.of:
                    raise self.refuse(node, f"'{name}' is read before it has a value")
                return self.constant(self.unit.meaning(name), node)
            case ast.BinOp():
                return self._binary(node)
            case ast.Constant(value=value):
                return self.constant(value, node)
            case ast.Subscript():
                return self._load(node)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                inner = self.value(operand)
                if inner.whole is not None:
                    return Value(INT, str(-inner.whole), whole=-inner.whole)
                if inner.kind == FLOAT:
                    return self.emit(FLOAT, f"fneg double {inner.name}")
                return self.emit(INT, f"sub i64 0, {self.to(inner, INT, node).name}")
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.value(operand)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return self.emit(TRUTH, f"xor i1 {self.truth(operand).name}, true")
            case ast.Compare():
                return self._compare(node)
            case ast.BoolOp():
                return self._condition(node)
            case ast.IfExp(test=test, body=body, orelse=orelse):
                kind = self.kinds.kind(node)
                return self._either(
                    self.truth(test),
                    kind,
                    lambda: self.to(self.value(body), kind, node),
                    lambda: self.to(self.value(orelse), kind, node),
                )
            case ast.Call():
                return self._call(node)
            case ast.Attribute(value=ast.Name(id="math"), attr=attr) if isinstance(getattr(math, attr, None), float):
                return self.constant(getattr(math, attr), node)
            case ast.Attribute(value=value, attr="size"):
                array = self.value(value)
                size = Value(INT, array.shape[0])
                for other in array.shape[1:]:
                    size = self.emit(INT, f"mul i64 {size.name}, {other}")
                return size
            case ast.Tuple(elts=elts):
                parts = [self.value(e) for e in elts]
                return self.together(parts, tuple(p.kind for p in parts))
        raise self.refuse(node, f"{ast.unparse(node)} is outside the subset")

    def truth(self, node: ast.expr) -> Value:
        """Write a condition and return it."""
        found = self.value(node)
        if found.kind == TRUTH:
            return found
        if found.kind == INT:
            return self.emit(TRUTH, f"icmp ne i64 {found.name}, 0")
        raise self.refuse(node, f"{found.kind} in the place of a condition")

    def _either(self, test: Value, kind: Kind, first: Callable[[], Value], second: Callable[[], Value]) -> Value:
        """Write what is evaluated on one side only, and return the side's value."""
        yes, no, end = self.fresh("yes"), self.fresh("no"), self.fresh("end")
        self.lines.append(f"  br i1 {test.name}, label %{yes}, label %{no}")
        arms = []
        for label, side in ((yes, first), (no, second)):
            self.begin(label)
            value = side()
            arms.append(f"[ {value.name}, %{self.label} ]")
            self.jump(end)
        self.begin(end)
        return self.emit(kind, f"phi {llvm_type(kind)} {', '.join(arms)}")

    def _condition(self, node: ast.BoolOp) -> Value:
        found = self.truth(node.values[0])
        for other in node.values[1:]:
            if isinstance(node.op, ast.And):
                found = self._either(found, TRUTH, lambda n=other: self.truth(n), lambda: Value(TRUTH, "false"))  # type: ignore[misc]
            else:
                found = self._either(found, TRUTH, lambda: Value(TRUTH, "true"), lambda n=other: self.truth(n))  # type: ignore[misc]
        return found

    def _compare(self, node: ast.Compare) -> Value:
        values = [self.value(node.left), *map(self.value, node.comparators)]
        found: Value | None = None
        for op, a, b in zip(node.ops, values, values[1:], strict=False):
            if type(op) not in _COMPARE:
                raise self.refuse(node, "this comparison is outside the subset")
            kind = joined(joined(a.kind, b.kind), INT)
            a, b = self.to(a, kind, node), self.to(b, kind, node)
            of_reals, of_whole = _COMPARE[type(op)]
            word = f"fcmp {of_reals} double" if kind == FLOAT else f"icmp {of_whole} i64"
            now = self.emit(TRUTH, f"{word} {a.name}, {b.name}")
            found = now if found is None else self.emit(TRUTH, f"and i1 {found.name}, {now.name}")
        assert found is not None
        return found

    # ---------------------------------------------------------------- arithmetic

    def _binary(self, node: ast.BinOp) -> Value:
        return self.arithmetic(node.op, self.value(node.left), self.value(node.right), node)

    def arithmetic(self, op: ast.operator, a: Value, b: Value, node: ast.AST) -> Value:
        """Write one operation of two values."""
        if isinstance(op, ast.Pow):
            return self._power(a, b, node)
        kind = FLOAT if isinstance(op, ast.Div) else joined(joined(a.kind, b.kind), INT)
        if kind not in (FLOAT, INT):
            raise self.refuse(node, f"arithmetic with {kind}")
        a, b = self.to(a, kind, node), self.to(b, kind, node)
        if type(op) in _ARITHMETIC:
            word = _ARITHMETIC[type(op)]
            return self.emit(kind, f"{'f' if kind == FLOAT else ''}{word} {llvm_type(kind)} {a.name}, {b.name}")
        if isinstance(op, ast.Div):
            return self.emit(FLOAT, f"fdiv double {a.name}, {b.name}")
        if isinstance(op, ast.Mod) and kind == FLOAT:
            return self._modulo(a, b)
        if kind == INT and isinstance(op, ast.FloorDiv | ast.Mod) and b.whole is not None and b.whole > 0:
            return self._whole_division(op, a, b)
        if kind == INT and isinstance(op, ast.Mod):  # of numbers that are not negative: slots and counters
            return self.emit(INT, f"srem i64 {a.name}, {b.name}")
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
        signed = self._intrinsic("llvm.copysign.f64", [rest, b])
        kept = self.emit(FLOAT, f"select i1 {some.name}, double {rest.name}, double {signed.name}")
        return self.emit(FLOAT, f"select i1 {turn.name}, double {moved.name}, double {kept.name}")

    def _whole_division(self, op: ast.operator, a: Value, b: Value) -> Value:
        rest = self.emit(INT, f"srem i64 {a.name}, {b.name}")
        negative = self.emit(TRUTH, f"icmp slt i64 {rest.name}, 0")
        if isinstance(op, ast.Mod):
            moved = self.emit(INT, f"add i64 {rest.name}, {b.name}")
            return self.emit(INT, f"select i1 {negative.name}, i64 {moved.name}, i64 {rest.name}")
        quotient = self.emit(INT, f"sdiv i64 {a.name}, {b.name}")
        less = self.emit(INT, f"sub i64 {quotient.name}, 1")
        return self.emit(INT, f"select i1 {negative.name}, i64 {less.name}, i64 {quotient.name}")

    def _power(self, a: Value, b: Value, node: ast.AST) -> Value:
        if b.whole is None or abs(b.whole) > _SQUARINGS:
            return self._intrinsic("llvm.pow.f64", [self.to(a, FLOAT, node), self.to(b, FLOAT, node)])
        if a.kind == INT and (a.whole is not None or b.whole < 0):
            raise self.refuse(node, "a power of a whole number")
        word = "fmul double" if a.kind == FLOAT else "mul i64"
        found: Value | None = None
        factor, left = a, abs(b.whole)
        while left:
            if left & 1:
                found = factor if found is None else self.emit(a.kind, f"{word} {found.name}, {factor.name}")
            left >>= 1
            if left:
                factor = self.emit(a.kind, f"{word} {factor.name}, {factor.name}")
        if found is None:
            return self.to(Value(INT, "1", whole=1), a.kind, node)
        return found if b.whole > 0 else self.emit(FLOAT, f"fdiv double {real(1.0)}, {found.name}")

    # ---------------------------------------------------------------- memory

    def place(self, node: ast.Subscript) -> Value:
        """Write the address of an element; the kind is that of the element."""
        array = self.value(node.value)
        kind = element(array.kind)
        indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if len(indices) != max(1, len(array.shape)):
            raise self.refuse(node, f"{len(indices)} indices for {len(array.shape) or 1} dimensions")
        at = self.to(self.value(indices[0]), INT, node)
        for size, index in zip(array.shape[1:], indices[1:], strict=True):
            row = self.emit(INT, f"mul i64 {at.name}, {size}")
            at = self.emit(INT, f"add i64 {row.name}, {self.to(self.value(index), INT, node).name}")
        found = self.emit(kind, f"getelementptr {llvm_type(kind)}, ptr {array.name}, i64 {at.name}")
        return found

    def _load(self, node: ast.Subscript) -> Value:
        if isinstance(node.value, ast.Attribute) and node.value.attr == "shape":
            array = self.value(node.value.value)
            if not (isinstance(node.slice, ast.Constant) and isinstance(node.slice.value, int)):
                raise self.refuse(node, "the shape of an array takes a number")
            return Value(INT, array.shape[node.slice.value])
        place = self.place(node)
        return self.emit(place.kind, f"load {llvm_type(place.kind)}, ptr {place.name}, !tbaa !{place.kind}")

    # ---------------------------------------------------------------- calls

    def _intrinsic(self, symbol: str, arguments: list[Value]) -> Value:
        self.program.declare(symbol, len(arguments))
        return self.emit(FLOAT, f"call double @{symbol}({', '.join(f'double {a.name}' for a in arguments)})")

    def _call(self, node: ast.Call) -> Value:
        if node.keywords:
            raise self.refuse(node, "calls take plain arguments")
        arguments = [self.value(a) for a in node.args]
        match node.func:
            case ast.Attribute(value=ast.Name(id="math"), attr=attr) if attr in METHODS:
                return self._method(attr, [self.to(a, FLOAT, node) for a in arguments], node)
            case ast.Name(id=name):
                if name in ("min", "max", "abs", "int", "float", "bool") and name not in self.unit.functions:
                    return self._builtin(name, arguments, node)
                meaning = self.unit.meaning(name)
                if isinstance(meaning, tuple):
                    return self._function(meaning[0], meaning[1], arguments)
                if hasattr(meaning, "instruction"):
                    return self._instruction(meaning.instruction, arguments, node)
        raise self.refuse(node, f"{ast.unparse(node.func)} cannot be called")

    def _method(self, name: str, arguments: list[Value], node: ast.AST) -> Value:
        method = METHODS[name]
        if len(arguments) != method.arguments:
            raise self.refuse(node, f"math.{name} takes {method.arguments} arguments")
        if name == "isfinite":
            size = self._intrinsic("llvm.fabs.f64", arguments)
            return self.emit(TRUTH, f"fcmp olt double {size.name}, {real(math.inf)}")
        if name == "isnan":
            return self.emit(TRUTH, f"fcmp uno double {arguments[0].name}, {arguments[0].name}")
        return self._intrinsic(method.symbol, arguments)

    def _builtin(self, name: str, arguments: list[Value], node: ast.AST) -> Value:
        first = arguments[0]
        if name in ("min", "max"):
            kind = first.kind
            for other in arguments[1:]:
                kind = joined(kind, other.kind)
            found = self.to(first, kind, node)
            for other in arguments[1:]:  # as Python: a later one is taken if it is less, or greater
                other = self.to(other, kind, node)
                order = "lt" if name == "min" else "gt"
                word = f"fcmp o{order} double" if kind == FLOAT else f"icmp s{order} i64"
                test = self.emit(TRUTH, f"{word} {other.name}, {found.name}")
                kind_name = llvm_type(kind)
                found = self.emit(kind, f"select i1 {test.name}, {kind_name} {other.name}, {kind_name} {found.name}")
            return found
        if name == "abs":
            if first.kind == FLOAT:
                return self._intrinsic("llvm.fabs.f64", [first])
            minus = self.emit(INT, f"sub i64 0, {first.name}")
            test = self.emit(TRUTH, f"icmp slt i64 {first.name}, 0")
            return self.emit(INT, f"select i1 {test.name}, i64 {minus.name}, i64 {first.name}")
        if name == "int":
            return (
                self.emit(INT, f"fptosi double {first.name} to i64")
                if first.kind == FLOAT
                else self.to(first, INT, node)
            )
        return self.to(first, FLOAT, node) if name == "float" else self.truth_of(first, node)

    def truth_of(self, value: Value, node: ast.AST) -> Value:
        """Return a number as a condition."""
        if value.kind == FLOAT:
            return self.emit(TRUTH, f"fcmp une double {value.name}, 0.0")
        return value if value.kind == TRUTH else self.emit(TRUTH, f"icmp ne i64 {self.to(value, INT, node).name}, 0")

    def _function(self, unit: Any, name: str, arguments: list[Value]) -> Value:
        symbol, returns = self.program.function(unit, name, tuple(a.kind for a in arguments))
        given = ", ".join(f"{llvm_type(a.kind)} {a.name}" for a in arguments)
        if returns == NOTHING:
            self.lines.append(f"  call void @{symbol}({given})")
            return Value(NOTHING, "")
        return self.emit(returns, f"call {llvm_type(returns)} @{symbol}({given})")

    def _instruction(self, name: str, arguments: list[Value], node: ast.AST) -> Value:
        first = arguments[0]
        if name == "pointer" and isinstance(first.kind, Array):
            return Value(FLOATS if first.kind.of == FLOAT else INTS, first.name)
        if name in ("floats", "ints"):
            kind = FLOATS if name == "floats" else INTS
            return self.emit(kind, f"inttoptr i64 {self.to(first, INT, node).name} to ptr")
        if name == "shift":
            kind = llvm_type(element(first.kind))
            count = self.to(arguments[1], INT, node)
            return self.emit(first.kind, f"getelementptr {kind}, ptr {first.name}, i64 {count.name}")
        if name in CALLS:
            target = self.emit(INTS, f"inttoptr i64 {self.to(first, INT, node).name} to ptr")
            given = ", ".join(f"{llvm_type(a.kind)} {a.name}" for a in arguments[1:])
            self.lines.append(f"  call void {target.name}({given})")
            return Value(NOTHING, "")
        raise self.refuse(node, f"{name} is outside the subset")
