"""Implicit blocks that cannot be solved: found by evaluating them once, in plain Python, at the start."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from multibody.assembly.equation_set import Assembly
from multibody.assembly.ordering import Block

__all__ = ["unsolvable"]

_PIVOT = re.compile(r"/ ([AB])_(\d+)_\2$", re.MULTILINE)
_SMALL = 1e-14  # of the largest entry of its row: what rounding leaves of an exact zero


class _Singular(ArithmeticError):
    pass


def _pivot(value: float, row: Sequence[float]) -> float:
    if abs(value) <= _SMALL * max(map(abs, row)):
        raise _Singular
    return value


def unsolvable(work: Assembly, blocks: Sequence[Block], text: str, kernels: Sequence[str]) -> list[str]:
    """Return the faults of blocks whose matrix is singular at the start values.

    Two nodes without mass that a damper joins are the usual case: each seems to have damping, but only the
    difference of their speeds is damped.  The same holds for the voltages of a circuit without a ground.
    Only blocks that are affine in their unknowns are checked: for others the start may be a special point.

    Parameters
    ----------
    work : Assembly
        The equations.
    blocks : sequence of Block
        Its implicit blocks.
    text : str
        The function ``rhs`` of the unknowns as source, as `multibody.compile.generate` writes it.
    kernels : sequence of str
        Source of the functions it calls.
    """
    sizes = {f"# implicit: {', '.join(u.name for u in b.unknowns)}": len(b.unknowns) for b in blocks if b.affine}
    lines = text.splitlines()
    size, marks = 0, {}
    for k, line in enumerate(lines):
        if line.strip().startswith("# implicit:"):
            size = sizes.get(line.strip(), 0)
            mark = line.strip()
        pivot = _PIVOT.search(line)
        if pivot and size:
            i = pivot[2]
            row = ", ".join(f"A_{i}_{j}" for j in range(size))
            lines[k] = line[: pivot.start()] + f"/ _pivot({pivot[1]}_{i}_{i}, ({row},))"
            marks[k + 1] = mark
    space: dict[str, Any] = {"math": math, "_pivot": _pivot}
    exec(compile("\n\n".join(kernels), "<kernels>", "exec"), space)
    exec(compile("\n".join(lines), "<equations>", "exec"), space)
    vectors = [np.array([q.value for q in group]) for group in (work.states, work.inputs, work.parameters)]
    try:
        space["rhs"](0.0, *(v.tolist() for v in vectors), np.empty(len(work.unknowns)))
    except _Singular as error:
        trace: Any = error.__traceback__
        while trace is not None:
            if trace.tb_frame.f_code.co_filename == "<equations>":
                mark = marks[trace.tb_lineno]
            trace = trace.tb_next
        return [_undetermined(mark.removeprefix("# implicit: "))]
    except (ArithmeticError, ValueError, TypeError):
        pass  # the equations cannot be evaluated at the start itself; the simulation reports that
    return []


def _undetermined(names: str) -> str:
    if names.split(", ")[0].endswith(".voltage"):
        return (
            f"the voltages at {names} are not determined, only their differences are: no pin of this circuit is "
            "connected to the ground: connect one"
        )
    return (
        f"the equations do not determine the unknowns {names}: where these are nodes, damping acts only "
        "between them, so add a mass to one of them, or damping to a part that is held"
    )
