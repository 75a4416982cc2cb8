"""What goes through several lanes at once, as LLVM text: vectors where the processor has them, else lane by lane."""

from __future__ import annotations

import ast
from collections.abc import Callable
from typing import Any

from multibody.compile.emitter.inference import Kinds
from multibody.compile.emitter.kinds import (
    INT,
    NOTHING,
    TRUTH,
    Kind,
    Lanes,
    LanesAt,
    Outside,
    Truths,
    Value,
    in_lanes,
    lanes_of,
    llvm_type,
    of_one_lane,
)

__all__ = ["VECTOR_METHODS", "InLanes", "parts_lanes"]

_LEAVING = (ast.Return, ast.Break, ast.Continue)
VECTOR_METHODS = ("sqrt", "fabs", "floor", "ceil", "copysign")  # the others are functions of the C library


def parts_lanes(kinds: Kinds) -> bool:
    """Tell whether lanes part in a function: they leave it, or go round in it, at different places."""
    for part in ast.walk(kinds.node):
        around = isinstance(part, ast.If) and any(isinstance(inner, _LEAVING) for inner in ast.walk(part))
        asked = part.test if isinstance(part, ast.While) or (isinstance(part, ast.If) and around) else None
        if asked is not None and lanes_of(kinds.kind(asked)):
            return True
    return False


class InLanes:
    """Writes lanes; a part of `Arithmetic`."""

    emit: Callable[..., Value]
    to: Callable[..., Value]
    lines: list[str]

    def spread(self, value: Value, kind: Lanes | Truths, node: ast.AST) -> Value:
        """Return a plain value in every lane."""
        of = llvm_type(kind)
        one = self.to(value, of_one_lane(kind), node)
        first = self.emit(kind, f"insertelement {of} poison, {llvm_type(one.kind)} {one.name}, i64 0")
        every = f"<{kind.count} x i32> zeroinitializer"
        return self.emit(kind, f"shufflevector {of} {first.name}, {of} poison, {every}")

    def one_lane(self, value: Value, lane: int) -> Value:
        """Return what stands in one lane; a plain value stands in every lane."""
        kind = of_one_lane(value.kind)
        if isinstance(value.kind, LanesAt):
            return self.emit(kind, f"getelementptr double, ptr {value.name}, i64 {lane}")
        if kind == value.kind:
            return value
        return self.emit(kind, f"extractelement {llvm_type(value.kind)} {value.name}, i64 {lane}")

    def lane_by_lane(self, arguments: list[Value], write: Callable[[list[Value]], Value]) -> Value:
        """Write an operation for one lane after another, and return the results side by side."""
        count = lanes_of(*(a.kind for a in arguments))
        results = [write([self.one_lane(a, lane) for a in arguments]) for lane in range(count)]
        kind = results[0].kind
        if kind == NOTHING:  # it has written what it has to say
            return results[0]
        if not isinstance(kind, tuple):
            return self._side_by_side(results, count)
        columns = zip(*(self.parts(result, len(kind)) for result in results), strict=True)
        return self.together([self._side_by_side(list(c), count) for c in columns], in_lanes(kind, count))

    parts: Callable[..., list[Value]]
    together: Callable[..., Value]

    def _side_by_side(self, values: list[Value], count: int) -> Value:
        if values[0].kind == INT:
            raise Outside("whole numbers that differ from lane to lane")
        kind = in_lanes(values[0].kind, count)
        whole = Value(kind, "poison")
        for lane, value in enumerate(values):
            text = f"insertelement {llvm_type(kind)} {whole.name}, {llvm_type(value.kind)} {value.name}, i64 {lane}"
            whole = self.emit(kind, text)
        return whole

    def select(self, test: Value, first: Value, second: Value, kind: Kind) -> Value:
        """Return the first value where a condition holds, and the second elsewhere, lane by lane."""
        of = llvm_type(kind)
        text = f"select {llvm_type(test.kind)} {test.name}, {of} {first.name}, {of} {second.name}"
        return self.emit(kind, text)

    def both(self, a: Value, b: Value, word: str, node: ast.AST) -> Value:
        """Return conditions joined by ``and``, ``or`` or ``xor``, in lanes where one of them is."""
        count = lanes_of(a.kind, b.kind)
        kind: Any = Truths(count) if count else TRUTH
        a, b = self.to(a, kind, node), self.to(b, kind, node)
        return self.emit(kind, f"{word} {llvm_type(kind)} {a.name}, {b.name}")
