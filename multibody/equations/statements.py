"""Statements over global variable names, and what each reads, assigns, and may leave unassigned."""

from __future__ import annotations

import ast
import numbers
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from multibody.base.parsing import parse

__all__ = [
    "Statement",
    "constant",
    "copied",
    "flow",
    "local_variable",
    "merge_repeated",
    "names_read",
    "names_written",
    "readable",
    "variable",
]


def variable(*parts: str) -> str:
    """Return the global variable name of a dotted name, as used in the generated source.

    Names of components and declarations have no underscore at either end and no two in a row, so two
    different dotted names never share a variable.  Parts that only the assembly adds begin with an
    underscore.

    Examples
    --------
    >>> variable("carriage.guide", "a", "force")
    'carriage__guide__a__force'
    """
    return "__".join(part.replace(".", "__") for part in parts)


def local_variable(owner: str, scope: str, name: str) -> str:
    """Return the global variable of a local name in a component's method."""
    return f"{variable(owner)}___local{scope}__{name}"


def readable(name: str) -> str:
    """Return a variable's name as the user knows it.

    Examples
    --------
    >>> readable("spring__a__force"), readable("spring___local__stretch")
    ('spring.a.force', 'stretch')
    """
    if "___local" in name:
        return name.partition("___local")[2].partition("__")[2]
    return name.replace("___", ".").replace("__", ".")


def constant(value: Any) -> ast.expr:
    """Return a number as an expression; a negative one is a minus before a number, as in Python's grammar."""
    if isinstance(value, bool | str):
        return ast.Constant(value)
    plain: int | float = int(value) if isinstance(value, numbers.Integral) else float(value)
    return ast.UnaryOp(ast.USub(), ast.Constant(-plain)) if plain < 0 else ast.Constant(plain)


def names_written(node: ast.AST) -> set[str]:
    """Return the names that a node assigns."""
    return _names(node)[1]


def names_read(node: ast.AST) -> set[str]:
    """Return the names that a node reads, the names of called functions left out."""
    return _names(node)[0]


def _names(node: ast.AST) -> tuple[set[str], set[str]]:
    """Return the names that a node reads and those that it assigns, in one walk: most of a build is spent here."""
    reads: set[str] = set()
    writes: set[str] = set()
    waiting: list[ast.AST] = [node]
    while waiting:
        one = waiting.pop()
        kind = one.__class__
        if kind is ast.Name:
            if one.ctx.__class__ is ast.Store:  # type: ignore[attr-defined]
                writes.add(one.id)  # type: ignore[attr-defined]
            elif one.ctx.__class__ is ast.Load:  # type: ignore[attr-defined]
                reads.add(one.id)  # type: ignore[attr-defined]
            continue
        called = one.func if kind is ast.Call else None  # type: ignore[attr-defined]
        for name in one._fields:
            value = getattr(one, name, None)
            if value.__class__ is list:
                waiting += [item for item in value if isinstance(item, ast.AST)]
            elif isinstance(value, ast.AST) and value._fields and not (value is called and isinstance(value, ast.Name)):
                waiting.append(value)
    reads.discard("math")
    return reads, writes


def copied(node: ast.stmt) -> ast.stmt:
    """Return an independent copy of a statement."""
    return parse(ast.unparse(node)).body[0]


@dataclass(frozen=True)
class Flow:
    """What a sequence of statements reads from before it, and what it assigns.

    Parameters
    ----------
    reads : frozenset of str
        Names read on some path before the sequence has assigned them.
    sure : frozenset of str
        Names assigned on every path.
    maybe : frozenset of str
        Names assigned on some path; ``sure`` is among them.
    returns : bool
        Whether every path returns.
    """

    reads: frozenset[str]
    sure: frozenset[str]
    maybe: frozenset[str]
    returns: bool = False


def flow(nodes: Iterable[ast.stmt]) -> Flow:
    """Follow every path through a sequence of statements; the variable of a loop stays inside it."""
    reads: set[str] = set()
    sure: set[str] = set()
    maybe: set[str] = set()
    returns = False
    for node in nodes:
        if isinstance(node, ast.If):
            inner = _branches(node)
        elif isinstance(node, ast.For):
            inner = _loop(node)
        elif isinstance(node, ast.Return):
            inner = Flow(frozenset(names_read(node)), frozenset(), frozenset(), True)
        else:
            read, assigned = _names(node)
            written = frozenset(assigned)
            inner = Flow(frozenset(read), written, written)
        reads |= inner.reads - sure
        sure |= inner.sure
        maybe |= inner.maybe
        returns = returns or inner.returns
    return Flow(frozenset(reads), frozenset(sure), frozenset(maybe), returns)


def _branches(node: ast.If) -> Flow:
    first, second = flow(node.body), flow(node.orelse)
    if first.returns != second.returns:
        sure = second.sure if first.returns else first.sure
    else:
        sure = first.sure & second.sure
    reads = first.reads | second.reads | frozenset(names_read(node.test))
    return Flow(reads, sure, first.maybe | second.maybe, first.returns and second.returns)


def _loop(node: ast.For) -> Flow:
    own = frozenset(names_written(node.target))
    body = flow(node.body)
    sure = body.sure if _runs(node.iter) else frozenset()
    return Flow((body.reads - own) | frozenset(names_read(node.iter)), sure - own, body.maybe - own)


def _runs(count: ast.expr) -> bool:
    """Tell whether ``range(...)`` of constants has at least one element."""
    if not isinstance(count, ast.Call):
        return False
    try:
        return len(range(*(ast.literal_eval(a) for a in count.args))) > 0
    except (TypeError, ValueError):
        return False


@dataclass
class Statement:
    """One assignment, or a compound that has to stay together (if/else, loop, accumulation).

    ``reads`` and ``writes`` are global variable names; ``origin`` names component and source line.
    """

    nodes: list[ast.stmt]
    reads: set[str]
    writes: set[str]
    origin: str

    @classmethod
    def of(cls, nodes: list[ast.stmt], origin: str) -> Statement:
        """Return nodes as a statement, with what they read and assign."""
        for node in nodes:
            ast.fix_missing_locations(node)
        return cls.parsed(nodes, origin)

    @classmethod
    def parsed(cls, nodes: list[ast.stmt], origin: str) -> Statement:
        """Return nodes that come from a text, and have their places in it, as a statement."""
        paths = flow(nodes)
        return cls(nodes, set(paths.reads), set(paths.maybe), origin)

    @property
    def text(self) -> str:
        """The statement as Python text."""
        return "\n".join(ast.unparse(node) for node in self.nodes)

    @property
    def unsure(self) -> set[str]:
        """Names that only some paths assign."""
        paths = flow(self.nodes)
        return set(paths.maybe - paths.sure)


def merge_repeated(statements: list[Statement]) -> list[Statement]:
    """Keep statements together that assign the same name more than once (an accumulation)."""
    merged: list[Statement] = []
    for statement in statements:
        for k, earlier in enumerate(merged):
            if earlier.writes & statement.writes:
                group = [*merged[k:], statement]
                merged[k:] = [Statement.of([n for s in group for n in s.nodes], earlier.origin)]
                break
        else:
            merged.append(statement)
    return merged
