"""Equations put into an order of evaluation; loops that an unknown closes become implicit blocks."""

from __future__ import annotations

import ast
from collections.abc import Iterable
from dataclasses import dataclass

from multibody.assembly.called_functions import tangent_name
from multibody.assembly.equation_set import Assembly, Unknown
from multibody.base.errors import ModelError
from multibody.equations.differentiate import Differentiator, active_names, d
from multibody.equations.statements import Statement, copied, names_read, readable

__all__ = ["Block", "dependencies", "ordered"]


@dataclass
class Block:
    """Statements that share unknowns: solved together by Newton's method, in one step where they are affine."""

    unknowns: list[Unknown]
    statements: list[Statement]
    affine: bool

    @property
    def reads(self) -> set[str]:
        """Names that the block takes from outside."""
        return set().union(*(s.reads for s in self.statements)) - self.writes

    @property
    def writes(self) -> set[str]:
        """Names that the block determines."""
        return set().union(*(s.writes for s in self.statements)) | {u.variable for u in self.unknowns}

    @property
    def nodes(self) -> list[ast.stmt]:
        """The statements' syntax trees."""
        return [n for s in self.statements for n in s.nodes]


Item = Statement | Block


def ordered(work: Assembly, *wanted: Iterable[str]) -> list[list[Item]]:
    """Return for each group of variables the statements that it needs, each after what it reads.

    Raises
    ------
    ModelError
        If a variable has no equation or two, an unknown has none that it influences, or equations form an
        algebraic loop.
    """
    faults: list[str] = []
    entries: list[Statement | Unknown] = [*work.statements, *work.unknowns]
    writer: dict[str, int] = {}
    for k, entry in enumerate(entries):
        for name in sorted({entry.variable} if isinstance(entry, Unknown) else entry.writes):
            if name in writer:
                both = " and ".join(_origin(entries[i]) for i in (writer[name], k))
                faults.append(f"'{readable(name)}' is given twice, by {both}: keep one of the two")
            writer[name] = k
    groups = [_order(work, names, entries, writer, faults) for names in wanted]
    if faults:
        raise ModelError(work.name, dict.fromkeys(faults))
    return groups


def _origin(entry: Statement | Unknown) -> str:
    return entry.name if isinstance(entry, Unknown) else entry.origin


def _order(
    work: Assembly,
    wanted: Iterable[str],
    entries: list[Statement | Unknown],
    writer: dict[str, int],
    faults: list[str],
) -> list[Item]:
    sources = {q.variable for group in (work.states, work.inputs, work.parameters) for q in group}
    sources |= {*work.constants, "t", "p"}
    pseudo = {u.variable for u in work.unknowns}
    reads: dict[int, list[int]] = {}
    stack = [(name, "the model") for name in wanted]
    while stack:
        name, reader = stack.pop()
        if name in sources:
            continue
        if name not in writer:
            faults.append(f"nothing determines '{readable(name)}', which {reader} reads{_remedy(name)}")
            continue
        k = writer[name]
        if k in reads:
            continue
        entry = entries[k]
        needed = {entry.residual} if isinstance(entry, Unknown) else entry.reads
        stack += [(n, _origin(entry)) for n in sorted(needed)]
        reads[k] = sorted({writer[n] for n in needed if n in writer and n not in sources})
    items: list[Item] = []
    for group in _components(reads):
        if len(group) == 1 and group[0] not in reads[group[0]]:
            entry = entries[group[0]]
            if isinstance(entry, Unknown):
                faults.append(_undetermined(entry))
            else:
                items.append(entry)
            continue
        unknowns = [e for e in (entries[k] for k in group) if isinstance(e, Unknown)]
        statements = [e for e in (entries[k] for k in sorted(group)) if isinstance(e, Statement)]
        inner = _inner_order(statements, pseudo)
        if not unknowns or inner is None:
            faults.append(_loop(statements))
        else:
            items.append(_block(unknowns, inner))
    return items


def _remedy(name: str) -> str:
    if name.endswith("__acceleration"):
        return ": where nothing has mass there is no acceleration, so add a Mass or Inertia there"
    if name.endswith("__reaction"):
        return ": only a port that prescribes its motion, or a transmission's, has a reaction"
    return ": give it an equation"


def _undetermined(unknown: Unknown) -> str:
    if unknown.name.endswith("voltage"):
        return f"nothing sets the voltage at '{unknown.name}': connect a resistor, a source or the ground"
    return (
        f"the node at '{unknown.name}' has neither mass nor damping, so its motion is not determined: add a Mass or "
        "Inertia there, or merge the parts on its two sides"
    )


def _loop(statements: list[Statement]) -> str:
    origins = list(dict.fromkeys(s.origin for s in statements))
    return (
        f"algebraic loop: each of these needs another's result at the same instant: {'; '.join(origins)}: "
        "break it with a state (a filter, a delay, a mass) or a declared Unknown"
    )


def _inner_order(statements: list[Statement], unknown: set[str]) -> list[Statement] | None:
    """Order a block's statements with the unknowns taken as given; None when a loop remains."""
    left, done, order = list(statements), set(unknown), []
    own = {n for s in statements for n in s.writes}
    while left:
        ready = [s for s in left if not ((s.reads & own) - done - s.writes)]
        if not ready:
            return None
        for s in ready:
            left.remove(s)
            done |= s.writes
        order += ready
    return order


def _block(unknowns: list[Unknown], statements: list[Statement]) -> Block:
    nodes = [n for s in statements for n in s.nodes]
    seeds = {u.variable for u in unknowns}
    active = active_names(nodes, seeds)
    derived = Differentiator(active, tangent_name).statements([copied(n) for n in nodes])
    bent = active_names(derived, seeds)
    branching = any(
        isinstance(n, ast.If | ast.IfExp) and names_read(n.test) & active for s in derived for n in ast.walk(s)
    )
    affine = not branching and not any(d(u.residual) in bent for u in unknowns)
    return Block(unknowns, statements, affine)


def _components(reads: dict[int, list[int]]) -> list[list[int]]:
    """Return strongly connected components, each after those it reads (Tarjan 1972, without recursion)."""
    index: dict[int, int] = {}
    low: dict[int, int] = {}
    on_stack: set[int] = set()
    stack: list[int] = []
    groups: list[list[int]] = []
    for root in sorted(reads):
        if root in index:
            continue
        work = [(root, iter(reads[root]))]
        index[root] = low[root] = len(index)
        stack.append(root)
        on_stack.add(root)
        while work:
            node, successors = work[-1]
            advanced = False
            for nxt in successors:
                if nxt not in index:
                    index[nxt] = low[nxt] = len(index)
                    stack.append(nxt)
                    on_stack.add(nxt)
                    work.append((nxt, iter(reads[nxt])))
                    advanced = True
                    break
                if nxt in on_stack:
                    low[node] = min(low[node], index[nxt])
            if advanced:
                continue
            work.pop()
            if work:
                low[work[-1][0]] = min(low[work[-1][0]], low[node])
            if low[node] == index[node]:
                group = []
                while True:
                    k = stack.pop()
                    on_stack.discard(k)
                    group.append(k)
                    if k == node:
                        break
                groups.append(group)
    return groups


def dependencies(items: list[Item], sources: Iterable[str]) -> dict[str, set[str]]:
    """Return for every name the sources (say, states) that it can depend on."""
    deps: dict[str, set[str]] = {s: {s} for s in sources}
    for item in items:
        sources_read = set().union(*(deps.get(n, set()) for n in item.reads)) if item.reads else set()
        for name in item.writes:
            deps[name] = sources_read
    return deps
