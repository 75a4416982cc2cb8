"""The stiff method: Rodas5P, a Rosenbrock method of order 5 with the exact Jacobian."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from multibody.solvers.base import NativeSolver
from multibody.solvers.kernels import rodas
from multibody.solvers.problem import NativeProblem, ProblemError

__all__ = ["Rodas5P", "relative_cost"]


class Rodas5P(NativeSolver):
    """Steinebach's stiffly accurate, L-stable Rosenbrock method of order 5 with a compiled loop over many
    steps.

    Every step takes the Jacobian from ``problem.tangent`` (as many directional derivatives as the problem has
    colours) and factorizes one matrix.  Cost hardly depends on stiffness.  Parameters are those of
    `NativeSolver`.
    """

    ORDER = 5
    STAGES = 4
    KERNEL: ClassVar[Any] = rodas
    IMPLICIT = True

    def __init__(self, fun: Any, t0: float, y0: Any, t_bound: float, problem: Any = None, **options: Any) -> None:
        if problem is not None and problem.tangent is None:
            raise ProblemError("Rodas5P needs the tangent of the right-hand side: NativeProblem(..., tangent=...)")
        super().__init__(fun, t0, y0, t_bound, problem=problem, **options)

    def _allocate(self, slots: int) -> None:
        super()._allocate(slots)
        n, size = self.problem.n, self.problem.size
        vectors = 14 * size + 2 * n * n + max(self.problem.table.n_inputs, self.problem.p.size, 1)
        self._work = np.zeros(vectors)
        self._owner = np.ascontiguousarray(self.problem.owners(), dtype=np.int64)
        self._pivots = np.zeros(n, dtype=np.int64)
        self._largest = np.zeros(size)

    def _extra(self) -> tuple[Any, ...]:
        return self._owner, self._pivots, self._largest


def relative_cost(problem: NativeProblem) -> float:
    """Return the cost of a step of the stiff method over one of the explicit method, from counts of operations.

    The explicit step takes 6 evaluations of the right-hand side; the stiff one 10, the columns of the Jacobian, and
    linear algebra, which takes less where the Jacobian is sparse.  Along a direction the explicit step takes 6
    directional derivatives; the stiff one 16, and eight solutions.  The factors were fitted to measured times; measured
    ratios (and this function's): 3.7 (3.6) for a chain with 2 states, 4.5 (6.2) with 6, 12 (11) with 18, 19 (18) with
    40; 3.6 (3.3) for the lift with 12 states, 8.6 (7.9) with 17, 6.8 (6.6) with 37.
    """
    n, m, colours = problem.n, problem.n_directions, len(problem.owners())
    filled = 1.0 if problem.pattern is None else np.count_nonzero(problem.pattern) / n**2
    rates = _operations(problem.rhs.origin[0]) or 40 * n
    # Directional derivatives repeat what they share with the rates, which the processor does at the same time.
    tangent = 0.75 * ((_operations(problem.tangent.origin[0]) if problem.tangent is not None else 0) or 120 * n)
    jacobian = colours * tangent
    if problem.columns is not None:  # as vectors
        jacobian = 0.42 * -(-colours // 4) * _operations(problem.columns.origin[0])
    explicit = 6 * (rates + m * tangent) + 320 + 13 * n * (1 + m)
    linear_algebra = 600 + 330 * n + 5 * n**2 + 1.06 * filled * n**3
    along = m * (16 * tangent + 16 * filled * n**2 + 100 * n)
    return (10 * rates + jacobian + linear_algebra + along) / explicit


@lru_cache(maxsize=256)
def _operations(text: str) -> int:
    """Return the number of operations in the text of a flat function."""
    return len(re.findall(r" [-+*/] | \*\* |math\.", text))
