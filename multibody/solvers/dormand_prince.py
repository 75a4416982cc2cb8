"""The explicit method: Dormand-Prince 5(4), for problems that are not stiff."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np

from multibody.compile.emitter.kinds import address_of
from multibody.compile.settings import jit_enabled
from multibody.solvers.base import NativeSolver
from multibody.solvers.kernels import dormand_prince
from multibody.solvers.kernels.dormand_prince_batched import LANES, advance_batched

__all__ = ["DormandPrince54"]


class DormandPrince54(NativeSolver):
    """Dormand and Prince's pair of orders 5 and 4 with a compiled loop over many steps.

    SciPy's ``RK45`` in method, several times to tens of times faster.  Held inputs end the steps at their
    jumps. Parameters are those of `NativeSolver`.

    Examples
    --------
    ``solve_ivp(problem.fun, (0, 6), problem.initial(x0), method=DormandPrince54, problem=problem,
    rtol=1e-6)``
    """

    ORDER = 5
    STAGES = 7
    KERNEL: ClassVar[Any] = dormand_prince

    def _bound(self) -> Callable[[], int]:
        if not jit_enabled():  # plain Python looks up what stands at an address more slowly than in an array
            return super()._bound()
        arrays = (  # all of them are the solver's own, and so outlive the call
            self.field.numbers,
            self._clock,
            self._tally,
            self._state,
            self._work,
            *self._store,
            self.rtol,
            self.atol,
            self._sample_t,
            self._sample_y,
        )
        numbers = (self.problem.size, self._count, len(self._store[0]), self._sample_t.size, len(self._sample_y))
        return self.KERNEL.advance_one.bound(np.array([*map(address_of, arrays), *numbers], dtype=np.int64))

    def advance_many(
        self,
        numbers: np.ndarray,
        clock: np.ndarray,
        tally: np.ndarray,
        y: np.ndarray,
        times: np.ndarray,
        samples: np.ndarray,
    ) -> None:
        """Integrate other runs from their start, one row of each array for each, samples (runs, nt, n).

        Tolerances are this one's.
        """
        self.KERNEL.advance(
            numbers, clock, tally, y, self._work, *self._store, self.rtol, self.atol, self._count, times, samples
        )

    def advance_batched(
        self,
        address: int,
        numbers: np.ndarray,
        clock: np.ndarray,
        tally: np.ndarray,
        y: np.ndarray,
        last: np.ndarray,
        times: np.ndarray,
        samples: np.ndarray,
        place: np.ndarray,
    ) -> None:
        """As `advance_many`, `LANES` runs at a time, from where they are.

        ``address`` is that of their equations in lanes, ``last`` (runs, n) holds the rates at the end of their last
        steps, ``place`` (runs,) the rows of samples that are theirs.
        """
        n, n_u, n_p = y.shape[1], self.problem.table.n_inputs, self.problem.p.size
        store = np.empty((LANES, 2)), np.empty((LANES, n)), np.zeros((LANES, self.STAGES, n))
        work = np.zeros((3 + LANES) * n)
        wide, steps = np.zeros((2 * n + self.STAGES * n + n_u + n_p, LANES)), np.zeros((7, LANES))
        lanes = np.zeros((4, LANES), dtype=np.int64)
        advance_batched(
            address, numbers, clock, tally, y, last, work, *store, self.rtol, self.atol, times, samples, place, wide,
            steps, lanes,
        )  # fmt: skip
