"""The stiff method: Rodas5P, a Rosenbrock method of order 5 with the exact Jacobian."""

from __future__ import annotations

from typing import Any

import numpy as np

from multibody.solvers.base import NativeSolver
from multibody.solvers.problem import ProblemError

__all__ = ["Rodas5P"]


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
