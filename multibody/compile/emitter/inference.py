"""Which kind each name of a function holds, and what the function returns, for given kinds of arguments."""

from __future__ import annotations

import ast
from collections.abc import Callable
from typing import Any

import numpy as np

from multibody.compile.emitter.instructions import METHODS, result_kind
from multibody.compile.emitter.kinds import (
    FLOAT,
    INT,
    NOTHING,
    TRUTH,
    Array,
    Kind,
    Outside,
    Truths,
    element,
    in_lanes,
    joined,
    lanes_of,
)
from multibody.compile.emitter.units import Unit

__all__ = ["Kinds", "store_counts"]

_RETURN = "return"


def store_counts(body: list[ast.stmt]) -> dict[str, int]:
    """Return how often each name is assigned; what stands in a branch or a loop counts twice."""
    counts: dict[str, int] = {}

    def note(target: ast.expr, weight: int) -> None:
        if isinstance(target, ast.Name):
            counts[target.id] = counts.get(target.id, 0) + weight
        elif isinstance(target, ast.Tuple):
            for part in target.elts:
                note(part, weight)

    def walk(nodes: list[ast.stmt], weight: int) -> None:
        for node in nodes:
            if isinstance(node, ast.Assign):
                for target in node.targets:
                    note(target, weight)
            elif isinstance(node, ast.AugAssign):
                note(node.target, 2)
            elif isinstance(node, ast.If | ast.While):
                walk(node.body, 2)
                walk(node.orelse, 2)
            elif isinstance(node, ast.For):
                note(node.target, 2)
                walk(node.body, 2)

    walk(body, 1)
    return counts


class Kinds:
    """The kinds of one function's names.

    Parameters
    ----------
    unit : Unit
        Where the function stands.
    node : ast.FunctionDef
    arguments : tuple of kinds
    returned : callable
        ``returned(unit, name, kinds)`` gives what another function returns.
    """

    def __init__(
        self, unit: Unit, node: ast.FunctionDef, arguments: tuple[Kind, ...], returned: Callable[..., Kind]
    ) -> None:
        self.unit, self.node, self._returned = unit, node, returned
        names = [a.arg for a in node.args.args]
        if len(names) != len(arguments) or node.args.vararg or node.args.kwonlyargs or node.args.kwarg:
            raise Outside(f"{node.name} takes {len(names)} arguments, {len(arguments)} are given")
        self.of: dict[str, Kind] = dict(zip(names, arguments, strict=True))
        self._asked = 0  # lanes of the conditions around the statement that is looked at
        again = lanes_of(*arguments) > 0 or any(isinstance(n, ast.For | ast.While) for n in ast.walk(node))
        while True:
            before = dict(self.of)
            self._block(node.body)
            if not again or before == self.of:
                break

    @property
    def returns(self) -> Kind:
        """What the function returns."""
        return self.of.get(_RETURN, NOTHING)

    def _note(self, name: str, kind: Kind) -> None:
        if self._asked:
            kind = in_lanes(kind, self._asked)
        self.of[name] = joined(kind, self.of.get(name))

    def _block(self, nodes: list[ast.stmt]) -> None:
        for node in nodes:
            match node:
                case ast.Assign(targets=targets, value=value) if not isinstance(targets[0], ast.Tuple):
                    for target in targets:
                        if isinstance(target, ast.Name):
                            self._note(target.id, self.kind(value))
                case ast.Assign(targets=[ast.Tuple(elts=targets)], value=value):
                    kinds = [self.kind(v) for v in value.elts] if isinstance(value, ast.Tuple) else self.kind(value)
                    for target, kind in zip(targets, kinds, strict=True):
                        if isinstance(target, ast.Name):
                            self._note(target.id, kind)
                case ast.AugAssign(target=ast.Name(id=name), value=value):
                    self._note(name, self.kind(ast.BinOp(ast.Name(name, ast.Load()), node.op, value)))
                case ast.If() | ast.While():
                    around = self._asked
                    self._asked = max(around, lanes_of(self.kind(node.test)))
                    self._block(node.body)
                    self._block(node.orelse)
                    self._asked = around
                case ast.For(target=ast.Name(id=name)):
                    self._note(name, INT)
                    self._block(node.body)
                case ast.Return(value=value):
                    self._note(_RETURN, NOTHING if value is None else self.kind(value))

    def kind(self, node: ast.expr) -> Kind:
        """Return the kind of an expression."""
        match node:
            case ast.Name(id=name):
                return self.of[name] if name in self.of else self._constant(self.unit.meaning(name))
            case ast.BinOp(left=left, op=op, right=right):
                a, b = self.kind(left), self.kind(right)
                return joined(joined(a, b), FLOAT if isinstance(op, ast.Div) else INT)
            case ast.Constant(value=value):
                return self._constant(value)
            case ast.Subscript(value=value):
                return self._element(value)
            case ast.Call():
                return self._call(node)
            case ast.UnaryOp(op=op, operand=operand):
                inner = self.kind(operand)
                if isinstance(op, ast.Not):
                    return inner if isinstance(inner, Truths) else TRUTH
                return joined(inner, INT)
            case ast.Compare(left=left, comparators=others):
                return self._condition([left, *others])
            case ast.BoolOp(values=values):
                return self._condition(values)
            case ast.IfExp(test=test, body=body, orelse=orelse):
                result, lanes = joined(self.kind(body), self.kind(orelse)), lanes_of(self.kind(test))
                return in_lanes(result, lanes) if lanes else result
            case ast.Tuple(elts=elts):
                return tuple(self.kind(e) for e in elts)
            case ast.Attribute(value=ast.Name(id="math")):
                return FLOAT
            case ast.Attribute(attr="size"):
                return INT
        raise Outside(f"{self.unit.name}, line {getattr(node, 'lineno', '?')}: {ast.unparse(node)}")

    def _condition(self, nodes: list[ast.expr]) -> Kind:
        lanes = lanes_of(*map(self.kind, nodes))
        return Truths(lanes) if lanes else TRUTH

    def _constant(self, value: Any) -> Kind:
        if isinstance(value, bool):
            return TRUTH
        if isinstance(value, int):
            return INT
        if isinstance(value, float):
            return FLOAT
        if isinstance(value, np.ndarray) and value.dtype in (np.float64, np.int64):
            return Array(FLOAT if value.dtype == np.float64 else INT, value.ndim)
        raise Outside(f"{self.unit.name}: a {type(value).__name__} in the place of a number")

    def _element(self, value: ast.expr) -> Kind:
        if isinstance(value, ast.Attribute) and value.attr == "shape":
            return INT
        return element(self.kind(value))

    def _call(self, node: ast.Call) -> Kind:
        arguments = tuple(self.kind(a) for a in node.args)
        match node.func:
            case ast.Attribute(value=ast.Name(id="math"), attr=attr) if attr in METHODS:
                lanes = lanes_of(*arguments)
                return in_lanes(METHODS[attr].kind, lanes) if lanes else METHODS[attr].kind
            case ast.Name(id=name):
                result = result_kind(name, arguments)
                if result is not None and name not in self.unit.functions:
                    return result
                meaning = self.unit.meaning(name)
                if isinstance(meaning, tuple):
                    return self._returned(*meaning, arguments)
                if hasattr(meaning, "instruction"):
                    return result_kind(meaning.instruction, arguments)
        raise Outside(f"{self.unit.name}, line {node.lineno}: {ast.unparse(node.func)} cannot be called")
