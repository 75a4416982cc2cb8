"""A whole program as LLVM text: functions with a C address, what they call, and their constants."""

from __future__ import annotations

from typing import Any

import numpy as np

from multibody.compile.emitter.functions import FunctionWriter
from multibody.compile.emitter.inference import Kinds
from multibody.compile.emitter.kinds import (
    FLOAT,
    INT,
    NOTHING,
    TRUTH,
    Array,
    Kind,
    OneLaneAt,
    Outside,
    in_lanes,
    lanes_of,
    llvm_type,
    of_one_lane,
    real,
)
from multibody.compile.emitter.lanes import parts_lanes
from multibody.compile.emitter.units import Unit

__all__ = ["Program"]

_ALIASES = """
!0 = !{!"numbers"}
!1 = !{!"double", !0}
!2 = !{!"int", !0}
!3 = !{!1, !1, i64 0}
!4 = !{!2, !2, i64 0}
"""
_FIRST_NOTE = 5


def _parameters(kind: Kind, name: str) -> list[str]:
    """Return a parameter as LLVM writes it; an array's shape comes after it."""
    shape = [f"i64 {name}s{d}" for d in range(kind.dimensions)] if isinstance(kind, Array) else []
    return [f"{llvm_type(kind)} {name}", *shape]


class Program:
    """Collects functions, each written once for the kinds it is called with."""

    def __init__(self) -> None:
        self._kinds: dict[Any, Kinds] = {}
        self._open: set[Any] = set()
        self._symbols: dict[Any, str] = {}
        self._texts: list[str] = []
        self._declared: dict[str, tuple[int, str]] = {}
        self._tables: dict[int, tuple[str, np.ndarray]] = {}
        self._notes: list[str] = []

    def add(self, unit: Unit, name: str, arguments: tuple[Kind, ...], symbol: str) -> tuple[str, ...]:
        """Add a function under a symbol for C, and return the kinds of what it returns.

        The numbers that it returns are written one after another, as 8 bytes each, to an address that comes after
        the arguments, if there are any.

        Raises
        ------
        Outside
            If the function, or one that it calls, is outside the subset.
        """
        kinds = self._of(unit, name, arguments)
        if kinds.returns == NOTHING:
            self._texts.append(FunctionWriter(self, kinds).write(symbol, ""))
            return ()
        inner, _ = self.function(unit, name, arguments)
        parameters = [part for k, kind in enumerate(arguments) for part in _parameters(kind, f"%a{k}")]
        returns = kinds.returns if isinstance(kinds.returns, tuple) else (kinds.returns,)
        whole = llvm_type(kinds.returns)
        lines = [f"  %r = call {whole} @{inner}({', '.join(parameters)})"]
        for k, kind in enumerate(returns):
            if kind not in (FLOAT, INT, TRUTH):
                raise Outside(f"{unit.name}: {name} returns {kind} to Python")
            part, of = "%r", llvm_type(kind)
            if isinstance(kinds.returns, tuple):
                part = f"%p{k}"
                lines.append(f"  {part} = extractvalue {whole} %r, {k}")
            if kind == TRUTH:
                lines.append(f"  %w{k} = zext i1 {part} to i64")
                part, of = f"%w{k}", "i64"
            lines += [f"  %e{k} = getelementptr i64, ptr %out, i64 {k}", f"  store {of} {part}, ptr %e{k}"]
        head = f"define void @{symbol}({', '.join([*parameters, 'ptr %out'])}) nounwind {{"
        self._texts.append("\n".join([head, *lines, "  ret void", "}"]))
        return returns

    def function(self, unit: Unit, name: str, arguments: tuple[Kind, ...]) -> tuple[str, Kind]:
        """Return symbol and result of a function that others call."""
        key = (unit, name, arguments)
        kinds = self._of(unit, name, arguments)
        if key not in self._symbols:
            self._symbols[key] = f"f{len(self._symbols)}.{name}"
            alone = any(isinstance(kind, OneLaneAt) for kind in arguments)  # called once for each lane
            words = "noinline " if alone else "alwaysinline " if unit.flat else ""
            self._texts.append(FunctionWriter(self, kinds).write(self._symbols[key], "internal", words))
        return self._symbols[key], kinds.returns

    def _of(self, unit: Unit, name: str, arguments: tuple[Kind, ...]) -> Kinds:
        key = (unit, name, arguments)
        if key not in self._kinds:
            if key in self._open:
                raise Outside(f"{unit.name}: {name} calls itself")
            self._open.add(key)
            self._kinds[key] = Kinds(unit, unit.functions[name], arguments, self.returned)
        return self._kinds[key]

    def one_by_one(self, unit: Unit, name: str, arguments: tuple[Kind, ...]) -> bool:
        """Tell whether a function is called for one lane after another, because lanes part in it."""
        if not lanes_of(*arguments):
            return False
        try:
            return parts_lanes(self._of(unit, name, arguments))
        except Outside:
            return True

    def returned(self, unit: Unit, name: str, arguments: tuple[Kind, ...]) -> Kind:
        """Return what a function returns for kinds of arguments."""
        if not self.one_by_one(unit, name, arguments):
            return self._of(unit, name, arguments).returns
        alone = self._of(unit, name, tuple(map(of_one_lane, arguments))).returns
        return in_lanes(alone, lanes_of(*arguments))

    def declare(self, symbol: str, arguments: int, of: str = "double") -> None:
        """Note a function of real numbers, or of vectors of them, that others bring."""
        self._declared[symbol] = arguments, of

    def independent_loop(self) -> tuple[str, str]:
        """Return the notes for the accesses and the end of a loop whose turns do not depend on each other.

        LLVM then makes vectors of four numbers without asking at run time whether arrays overlap.  One vector a turn:
        a machine has few states, and what is left over after many at once would be done singly.
        """
        group = len(self._notes) + _FIRST_NOTE
        loop = group + 1
        self._notes += [
            f"!{group} = distinct !{{}}",
            f"!{loop} = distinct !{{!{loop}, !{loop + 1}, !{loop + 2}, !{loop + 3}}}",
            f'!{loop + 1} = !{{!"llvm.loop.parallel_accesses", !{group}}}',
            f'!{loop + 2} = !{{!"llvm.loop.interleave.count", i32 1}}',
            f'!{loop + 3} = !{{!"llvm.loop.vectorize.width", i32 4}}',
        ]
        return f", !llvm.access.group !{group}", f", !llvm.loop !{loop}"

    def table(self, values: np.ndarray) -> str:
        """Return the name of a constant array."""
        return "@" + self._tables.setdefault(id(values), (f"t{len(self._tables)}", values))[0]

    def text(self) -> str:
        """Return the program's text."""
        parts = []
        for name, values in self._tables.values():
            kind = "double" if values.dtype == np.float64 else "i64"
            numbers = ", ".join(f"{kind} {real(v) if kind == 'double' else v}" for v in values.ravel().tolist())
            parts.append(f"@{name} = internal constant [{values.size} x {kind}] [{numbers}]")
        for symbol, (count, of) in self._declared.items():
            parts.append(f"declare {of} @{symbol}({', '.join([of] * count)}) nounwind willreturn memory(none)")
        text = "\n".join([*parts, *self._texts])
        return (
            text.replace("!tbaa !float", "!tbaa !3").replace("!tbaa !int", "!tbaa !4")
            + _ALIASES
            + "\n".join(self._notes)
        )
