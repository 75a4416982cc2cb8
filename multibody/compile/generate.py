"""Ordered equations written out as one flat source file: rates, outputs, and the exact derivatives of both.

The text is plain Python over arrays.  It is compiled by numba, it can be stepped through in a debugger, and
it is the same text that is hashed for the cache on disk.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from multibody.assembly.called_functions import kernel_sources, tangent_name
from multibody.assembly.equation_set import Assembly
from multibody.assembly.ordering import Block, Item, dependencies, ordered
from multibody.base.cache import kept_text
from multibody.base.errors import EquationError, ModelError
from multibody.equations.differentiate import Differentiator, active_names, d

__all__ = ["Source", "generate"]

_HEADER = "import math\n"
_NEWTON_STEPS = 40


class Texts(Mapping[str, str]):
    """Texts by name, each written when it is first needed: a simulation alone needs no tangent."""

    def __init__(self, names: tuple[str, ...], write: Callable[[str], str]) -> None:
        self._names, self._write = names, cache(write)

    def __getitem__(self, name: str) -> str:
        if name not in self._names:
            raise KeyError(name)
        return self._write(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __reduce__(self) -> tuple[type[dict[str, str]], tuple[dict[str, str]]]:
        return dict, (dict(self),)


@dataclass(frozen=True)
class Source:
    """Generated source text and what is known of its structure.

    Parameters
    ----------
    texts : mapping of str
        Python source of each of the functions ``rhs``, ``outputs``, ``speeds``, ``rhs_tangent``,
        ``outputs_tangent`` and ``rhs_columns``, which is ``rhs_tangent`` along states alone.
        Each stands in a file of its own: functions with the same text then share one compiled version,
        whatever else their models have.
    sparsity : ndarray of bool, shape (n, n)
        Whether the rate of state i can depend on state j.
    """

    texts: Mapping[str, str]
    sparsity: np.ndarray


def generate(work: Assembly, speeds: Sequence[str] = ()) -> Source:
    """Order the equations of an assembled model and write them out.

    ``speeds`` are the states and outputs that the function ``speeds`` writes.

    Raises
    ------
    ModelError
        If the equations cannot be ordered (see `multibody.assembly.ordering.ordered`).
    """
    rates = [work.derivatives[q.variable] for q in work.states]
    shown = [q.variable for q in work.outputs]
    variables = {q.name: q.variable for q in (*work.outputs, *work.states)}
    speed_variables = [variables[name] for name in speeds]
    try:
        kernel_texts, tangents = kernel_sources(work.kernels, work.statements)
    except EquationError as error:
        raise ModelError(work.name, str(error).splitlines()) from error
    unknowns = [u.variable for u in work.unknowns]
    rate_items, output_items, unknown_items, speed_items = ordered(work, rates, shown, unknowns, speed_variables)
    if blocks := [item for item in unknown_items if isinstance(item, Block)]:
        from multibody.assembly.solvability import unsolvable

        implicit = _function(work, "rhs", "dx", unknown_items, unknowns, tangent=False)
        if faults := unsolvable(work, blocks, implicit, [*kernel_texts, *tangents()]):
            raise ModelError(work.name, faults)

    def text(name: str) -> str:
        base = name.partition("_")[0]
        if name == base:
            return written(name)
        # A derivative follows from the text that it is the derivative of: one of an earlier process serves.
        return kept_text(name, (texts[base],), lambda: written(name))

    def written(name: str) -> str:
        of_outputs, tangent = name.startswith("outputs"), name.endswith(("_tangent", "_columns"))
        items, wanted = (output_items, shown) if of_outputs else (rate_items, rates)
        if name == "speeds":
            items, wanted = speed_items, speed_variables
        result = "out" if tangent else "dx" if name == "rhs" else "y"
        along = ("x",) if name.endswith("_columns") else ("x", "u", "p")
        body = _function(work, name, result, items, wanted, tangent=tangent, along=along)
        return "\n\n".join([_HEADER, *kernel_texts, *(tangents() if "_tangent(" in body else ()), body]) + "\n"

    texts = Texts(("rhs", "outputs", "speeds", "rhs_tangent", "outputs_tangent", "rhs_columns"), text)
    for name in ("rhs", "outputs"):  # what cannot be written is reported when the model is built
        texts[name]
    deps = dependencies(rate_items, [q.variable for q in work.states])
    sparsity = np.array([[s.variable in deps.get(r, ()) for s in work.states] for r in rates], dtype=bool)
    return Source(texts, sparsity.reshape(len(rates), len(rates)))


def _function(
    work: Assembly,
    name: str,
    result: str,
    items: list[Item],
    wanted: list[str],
    *,
    tangent: bool,
    along: tuple[str, ...] = ("x", "u", "p"),
) -> str:
    used = {n for item in items for n in item.reads} | set(wanted)
    lines: list[str] = []
    seeds: set[str] = set()
    for array, group in (("x", work.states), ("u", work.inputs), ("p", work.parameters)):
        for k, q in enumerate(group):
            if q.variable in used:
                lines.append(f"{q.variable} = {array}[{k}]")
                if tangent and array in along:
                    lines.append(f"{d(q.variable)} = {array}_dot[{k}]")
                    seeds.add(q.variable)
    lines += [f"{c} = {value}" for c, value in work.constants.items() if c in used]
    if "p" in used and "p" in along:
        seeds.add("p")
    nodes = [n for item in items for n in item.nodes]
    active = active_names(nodes, seeds) if tangent else set()
    for item in items if tangent else ():  # an unknown follows from everything that its block reads
        if isinstance(item, Block) and item.reads & active:
            active = active_names(nodes, active | {u.variable for u in item.unknowns})
    writer = Differentiator(active, tangent_name)
    for item in items:
        if isinstance(item, Block):
            lines += _block_lines(item, writer if tangent else None)
        else:
            lines.append(f"# {item.origin.partition(', ')[0]}")
            try:
                body = writer.statements(item.nodes) if tangent else item.nodes
            except EquationError as error:
                raise ModelError(work.name, [f"{item.origin}: {error}"]) from error
            lines += [line for node in body for line in ast.unparse(node).splitlines()]
    for k, var in enumerate(wanted):
        if not tangent:
            lines.append(f"{result}[{k}] = {var}")
        else:
            lines.append(f"{result}[{k}] = {d(var) if var in active else '0.0'}")
    arguments = "t, x, u, p, x_dot, u_dot, p_dot" if tangent else "t, x, u, p"
    return "\n    ".join([f"def {name}({arguments}, {result}):", *lines, "return"])


def _block_lines(block: Block, outer: Differentiator | None) -> list[str]:
    """Solve a block for its unknowns; with ``outer``, carry its tangents through the block as well."""
    z = [u.variable for u in block.unknowns]
    r = [u.residual for u in block.unknowns]
    m = len(z)
    inner_active = active_names(block.nodes, set(z))
    inner = Differentiator(inner_active, tangent_name, "z")  # not the tangents along the directions of the caller
    lines = [f"# implicit: {', '.join(u.name for u in block.unknowns)}", *(f"{v} = 0.0" for v in z)]
    sweep: list[str] = []
    for j in range(m):
        sweep += [f"{inner.d(v)} = {1.0 if k == j else 0.0}" for k, v in enumerate(z)]
        sweep += _unparse(inner.statements(block.nodes))
        for i in range(m):
            sweep.append(f"A_{i}_{j} = {inner.d(r[i]) if r[i] in inner_active else '0.0'}")
    sweep += [f"r_{i} = {r[i]}" for i in range(m)]
    sweep += _solution(m, "r", "s")
    if block.affine:
        lines += sweep + [f"{z[i]} = -s_{i}" for i in range(m)]
    else:
        sweep += [f"{z[i]} = {z[i]} - s_{i}" for i in range(m)]
        done, failed = (
            " and ".join(f"abs(s_{i}) <= {relative} * abs({z[i]}) + {absolute}" for i in range(m))
            for relative, absolute in (("1e-12", "1e-14"), ("1e-06", "1e-09"))
        )
        lines += [
            f"for step in range({_NEWTON_STEPS}):",
            *("    " + s for s in sweep),
            f"    if {done}:",
            "        break",
        ]
        # rounding may keep the last steps above the first bound; beyond the second there is no solution
        lines += [f"if not ({failed}):", *(f"    {v} = math.nan" for v in z)]
    if outer is None:
        return lines + _unparse(block.nodes)
    lines += [f"{d(v)} = 0.0" for v in z] + _unparse(outer.statements(block.nodes))
    lines += [f"dr_{i} = {d(r[i]) if r[i] in outer.active else '0.0'}" for i in range(m)]
    lines += _solution(m, "dr", "ds") + [f"{d(z[i])} = -ds_{i}" for i in range(m)]
    return lines + _unparse(outer.statements(block.nodes))


def _unparse(nodes: list[ast.stmt]) -> list[str]:
    return [line for node in nodes for line in ast.unparse(node).splitlines()]


def _solution(m: int, right: str, result: str) -> list[str]:
    """Write out the solution of A s = r by elimination (the matrices are conductances and masses: no
    pivoting).
    """
    lines = [f"B_{i}_{j} = A_{i}_{j}" for i in range(m) for j in range(m)] if m > 1 else []
    a = "B" if m > 1 else "A"
    lines += [f"{result}_{i} = {right}_{i}" for i in range(m)]
    for k in range(m):
        for i in range(k + 1, m):
            lines.append(f"f_{i} = {a}_{i}_{k} / {a}_{k}_{k}")
            lines += [f"{a}_{i}_{j} = {a}_{i}_{j} - f_{i} * {a}_{k}_{j}" for j in range(k + 1, m)]
            lines.append(f"{result}_{i} = {result}_{i} - f_{i} * {result}_{k}")
    for i in reversed(range(m)):
        terms = "".join(f" - {a}_{i}_{j} * {result}_{j}" for j in range(i + 1, m))
        lines.append(f"{result}_{i} = ({result}_{i}{terms}) / {a}_{i}_{i}")
    return lines
