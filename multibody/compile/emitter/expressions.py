"""Expressions as LLVM text."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from typing import Any

from multibody.compile.emitter.arithmetic import Arithmetic
from multibody.compile.emitter.instructions import CALLS, METHODS
from multibody.compile.emitter.kinds import (
    FLOAT,
    FLOATS,
    INT,
    INTS,
    NOTHING,
    TRUTH,
    Array,
    Kind,
    Lanes,
    OneLaneAt,
    Truths,
    Value,
    element,
    joined,
    lanes_of,
    llvm_type,
    real,
)  # fmt: skip
from multibody.compile.emitter.lanes import VECTOR_METHODS

__all__ = ["Expressions"]

_COMPARE = {
    ast.Lt: ("olt", "slt"), ast.LtE: ("ole", "sle"), ast.Gt: ("ogt", "sgt"), ast.GtE: ("oge", "sge"),
    ast.Eq: ("oeq", "eq"), ast.NotEq: ("une", "ne"),
}  # fmt: skip


class Expressions(Arithmetic):
    """Writes the expressions of one function; see `Arithmetic`."""

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
                if inner.kind == FLOAT or isinstance(inner.kind, Lanes):
                    return self.emit(inner.kind, f"fneg {llvm_type(inner.kind)} {inner.name}")
                return self.emit(INT, f"sub i64 0, {self.to(inner, INT, node).name}")
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.value(operand)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return self.both(self.truth(operand), Value(TRUTH, "true"), "xor", node)
            case ast.Compare():
                return self._compare(node)
            case ast.BoolOp():
                return self._condition(node)
            case ast.IfExp(test=test, body=body, orelse=orelse):
                kind, holds = self.kinds.kind(node), self.truth(test)
                if isinstance(holds.kind, Truths):
                    around, self._mask = self._mask, holds
                    first, second = (self.to(self.value(side), kind, node) for side in (body, orelse))
                    self._mask = around
                    return self.select(holds, first, second, kind)
                return self._either(
                    holds,
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
        result = self.value(node)
        if result.kind == TRUTH or isinstance(result.kind, Truths):
            return result
        if result.kind == INT:
            return self.emit(TRUTH, f"icmp ne i64 {result.name}, 0")
        raise self.refuse(node, f"{result.kind} in the place of a condition")

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
        if lanes_of(self.kinds.kind(node)):
            word = "and" if isinstance(node.op, ast.And) else "or"
            result = self.truth(node.values[0])
            for other in node.values[1:]:  # nothing is left out: what stands behind is read in every lane
                result = self.both(result, self.truth(other), word, node)
            return result
        result = self.truth(node.values[0])
        for other in node.values[1:]:
            if isinstance(node.op, ast.And):
                result = self._either(result, TRUTH, lambda n=other: self.truth(n), lambda: Value(TRUTH, "false"))  # type: ignore[misc]
            else:
                result = self._either(result, TRUTH, lambda: Value(TRUTH, "true"), lambda n=other: self.truth(n))  # type: ignore[misc]
        return result

    def _compare(self, node: ast.Compare) -> Value:
        values = [self.value(node.left), *map(self.value, node.comparators)]
        result: Value | None = None
        for op, a, b in zip(node.ops, values, values[1:], strict=False):
            if type(op) not in _COMPARE:
                raise self.refuse(node, "this comparison is outside the subset")
            kind = joined(joined(a.kind, b.kind), INT)
            if kind not in (FLOAT, INT) and not isinstance(kind, Lanes):
                raise self.refuse(node, f"a comparison of {kind}")
            a, b = self.to(a, kind, node), self.to(b, kind, node)
            of_reals, of_whole = _COMPARE[type(op)]
            word = f"icmp {of_whole} i64" if kind == INT else f"fcmp {of_reals} {llvm_type(kind)}"
            now = self.emit(Truths(kind.count) if isinstance(kind, Lanes) else TRUTH, f"{word} {a.name}, {b.name}")
            result = now if result is None else self.both(result, now, "and", node)
        assert result is not None
        return result

    def _binary(self, node: ast.BinOp) -> Value:
        return self.arithmetic(node.op, self.value(node.left), self.value(node.right), node)

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
        if isinstance(kind, Lanes):
            at = self.emit(INT, f"mul i64 {at.name}, {kind.count}")
        if isinstance(array.kind, OneLaneAt):
            at = self.emit(INT, f"mul i64 {at.name}, {array.kind.count}")
        of = "double" if isinstance(kind, Lanes) else llvm_type(kind)
        return self.emit(kind, f"getelementptr {of}, ptr {array.name}, i64 {at.name}")

    def access(self, kind: Kind) -> str:
        """Return what stands after the address of an element that is read or written."""
        if isinstance(kind, Lanes):
            return f", align 8, !tbaa !{FLOAT}{self._access}"
        return f", !tbaa !{kind}{self._access}"

    def _load(self, node: ast.Subscript) -> Value:
        if isinstance(node.value, ast.Attribute) and node.value.attr == "shape":
            array = self.value(node.value.value)
            if not (isinstance(node.slice, ast.Constant) and isinstance(node.slice.value, int)):
                raise self.refuse(node, "the shape of an array takes a number")
            return Value(INT, array.shape[node.slice.value])
        place = self.place(node)
        return self.emit(place.kind, f"load {llvm_type(place.kind)}, ptr {place.name}{self.access(place.kind)}")

    # ---------------------------------------------------------------- calls

    def _call(self, node: ast.Call) -> Value:
        if node.keywords:
            raise self.refuse(node, "calls take plain arguments")
        arguments = [self.value(a) for a in node.args]
        match node.func:
            case ast.Attribute(value=ast.Name(id="math"), attr=attr) if attr in METHODS:
                if lanes_of(*(a.kind for a in arguments)):
                    return self._method_in_lanes(attr, arguments, node)
                return self._method(attr, [self.to(a, FLOAT, node) for a in arguments], node)
            case ast.Name(id=name):
                if name in ("min", "max", "abs", "int", "round", "float", "bool") and name not in self.unit.functions:
                    return self.builtin(name, arguments, node)
                meaning = self.unit.meaning(name)
                if isinstance(meaning, tuple):
                    if self._mask is not None:
                        raise self.refuse(node, "what some lanes would call all of them would: too dear")
                    return self._function(meaning[0], meaning[1], arguments)
                if hasattr(meaning, "instruction"):
                    return self._instruction(meaning.instruction, arguments, node)
        raise self.refuse(node, f"{ast.unparse(node.func)} cannot be called")

    def _method(self, name: str, arguments: list[Value], node: ast.AST) -> Value:
        method = METHODS[name]
        if len(arguments) != method.arguments:
            raise self.refuse(node, f"math.{name} takes {method.arguments} arguments")
        if name == "isfinite":
            size = self.intrinsic("llvm.fabs.f64", arguments)
            return self.emit(TRUTH, f"fcmp olt double {size.name}, {real(math.inf)}")
        if name == "isnan":
            return self.emit(TRUTH, f"fcmp uno double {arguments[0].name}, {arguments[0].name}")
        return self.intrinsic(method.symbol, arguments)

    def _method_in_lanes(self, name: str, arguments: list[Value], node: ast.AST) -> Value:
        count, method = lanes_of(*(a.kind for a in arguments)), METHODS[name]
        if name not in VECTOR_METHODS or len(arguments) != method.arguments:
            return self.lane_by_lane(
                arguments, lambda one: self._method(name, [self.to(a, FLOAT, node) for a in one], node)
            )
        kind = Lanes(count)
        symbol = method.symbol.replace(".f64", f".v{count}f64")
        return self.intrinsic(symbol, [self.to(a, kind, node) for a in arguments], kind)

    def _function(self, unit: Any, name: str, arguments: list[Value]) -> Value:
        if self.program.one_by_one(unit, name, tuple(a.kind for a in arguments)):
            return self.lane_by_lane(arguments, lambda one: self._function(unit, name, one))
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
