"""The stiff method: Rodas5P, a Rosenbrock method of order 5 with the exact Jacobian."""

from __future__ import annotations

from typing import Any

import numpy as np

from multibody.solvers.base import NativeSolver
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
    DRIVER = "multibody.solvers.kernels.rodas"

    def __init__(self, fun: Any, t0: float, y0: Any, t_bound: float, problem: Any = None, **options: Any) -> None:
        if problem is not None and problem.tangent is None:
            raise ProblemError("Rodas5P needs the tangent of the right-hand side: NativeProblem(..., tangent=...)")
        super().__init__(fun, t0, y0, t_bound, problem=problem, **options)
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

    In evaluations of the right-hand side: 6 for the explicit step; 9 for the stiff one, one for every
    directional derivative, and linear algebra.  Measured ratios on chains of masses with friction, one colour
    a state: 2.2 at 2 states, 4.2 at 12, 8.2 at 36 (this function: 1.9, 4.2, 10.9); with 4 colours 3.6 at 12,
    6.1 at 36.  Along each direction: 6 for the explicit step; 16 and eight solutions for the stiff one.
    """
    n, m = problem.n, problem.n_directions
    state = 9 + len(problem.owners()) + (n**2 / 3 + 8 * n) / 35
    return (state + m * (16 + 8 * n / 35)) / (6 * (1 + m))
