"""A few runs of one structure in one call of the compiled loop, in SIMD lanes where their equations allow it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from multibody.base.stopping import raise_if_stopped
from multibody.compile.batched_rates import batched_rhs, batched_rhs_is_cached
from multibody.solvers.automatic import LOOK, Automatic
from multibody.solvers.base import Samples
from multibody.solvers.dormand_prince import DormandPrince54
from multibody.solvers.kernels.dormand_prince_batched import LANES
from multibody.solvers.kernels.stepping import (
    EVALUATIONS,
    FINISHED,
    LARGEST,
    SAMPLE,
    STATUS,
    STEP,
    TOO_SMALL,
    WANTED,
    WATCH,
)
from multibody.solvers.limits import most_evaluations
from multibody.solvers.problem import NativeProblem

__all__ = ["Group", "Item", "Run"]

GROUP_SECONDS, MOST_RUNS, GROUP_BYTES = 4e-3, 16, 1 << 22  # of one group
MOST_BYTES = 1 << 24  # of a group that is as small as there are lanes
FEWEST_BATCHED = 3  # runs that are faster in lanes than one after another
COMPILATION = 0.5  # s, of equations in lanes
MOST_STEPS = 1 << 22
SUCCESS = "The solver successfully reached the end of the integration interval."

Item = tuple[int, NativeProblem, Any]


@dataclass(frozen=True, eq=False, kw_only=True)
class Run:
    """One integration of a batch.

    Parameters
    ----------
    index : int
        Place in the order given.
    success : bool
    message : str
        Why it ended; in case of failure the time and the state.
    t : ndarray, shape (nt,), s
        Times reached.
    y : ndarray, shape (size, nt)
    """

    index: int
    success: bool
    message: str
    t: np.ndarray
    y: np.ndarray


class Group:
    """The explicit method, or the default one, on several problems at once, as far as that goes by itself.

    Parameters
    ----------
    options : dict
        Of `integrate`.
    """

    def __init__(self, options: dict[str, Any]) -> None:
        self.options = options
        method, times = options.get("method", Automatic), options.get("t_eval")
        known = {"method", "t_span", "t_eval", "rtol", "atol", "max_step", "first_step", "stiff_problem"}
        self.usable = method in (Automatic, DormandPrince54) and times is not None and options.keys() <= known
        self.watches, self.batched, self._looked = method is Automatic, False, 0
        if not self.usable:
            return
        self.times = np.ascontiguousarray(times, dtype=np.float64)
        self.start, self.end = map(float, options["t_span"])
        self.usable = self.end > self.start and self.times.ndim == 1 and self.times.size > 0
        self.usable &= bool(np.all(np.diff(self.times) >= 0.0))
        self.usable &= self.usable and self.start <= self.times[0] and self.times[-1] <= self.end

    def bytes_of(self, problem: NativeProblem) -> int:
        """Return the size of a result, as far as it is known beforehand."""
        return 8 * problem.size * self.times.size if self.usable else 0

    def look_for_lanes(self, problem: NativeProblem, spent: float) -> None:
        """Go on with several runs at once if their equations are in the cache, or once compiling them would have paid.

        Parameters
        ----------
        problem : NativeProblem
            One of the runs.
        spent : float, s
            What all the runs so far took.
        """
        if self.batched or self._looked > 1 or not self.usable:
            return
        if spent > COMPILATION:
            self._looked = 2
        elif self._looked == 0:
            self._looked = 1
            if not batched_rhs_is_cached(problem.rhs, LANES):
                return
        else:
            return
        self.batched = batched_rhs(problem.rhs, LANES) != 0

    def size(self, result: int, pace: float = np.inf) -> int:
        """Return how many runs to take in one group, from the bytes of a result and the seconds that a run takes."""
        least = LANES if self.batched and LANES * result <= MOST_BYTES else 1
        return max(least, min(MOST_RUNS, GROUP_BYTES // max(1, result), int(GROUP_SECONDS / max(pace, 1e-9))))

    def __call__(self, items: list[Item]) -> dict[int, Run]:
        """Integrate some runs, and return by index those that came to their end."""
        fit = [item for item in items if self._fits(item, items[0][1].n)] if self.usable else []
        return _Rows(self, fit).run() if fit else {}

    def _fits(self, item: Item, n: int) -> bool:
        _, problem, x0 = item
        plain = problem.directions is None and problem.n == n and problem.rhs.compiled
        return plain and np.shape(x0) == (n,) and bool(np.all(np.isfinite(x0)))


class _Into(Samples):
    """Samples that are written into rows that are there already."""

    def __init__(self, times: np.ndarray, rows: np.ndarray) -> None:
        super().__init__(times)
        self.rows = rows

    def begin(self, size: int) -> np.ndarray:
        """Return the rows."""
        self.states = self.rows
        return self.rows


class _Rows:
    """Runs as rows of the arrays that the compiled loop takes."""

    def __init__(self, group: Group, items: list[Item]) -> None:
        self.group, self.items = group, items
        self._defaults: dict[int, Automatic] = {}  # of runs that were looked at for stiffness

    def run(self) -> dict[int, Run]:
        """Integrate them, and return by index those that came to their end; `solve_ivp` reports on the others."""
        group, items = self.group, self.items
        try:
            self._lay_out()
        except Exception:
            return {}
        going, address = np.arange(len(items)), self._address()
        while going.size:
            self._advance(going, address)
            going = np.array([r for r in going.tolist() if group.watches and self._goes_on(r)], dtype=np.int64)
        good = self.tally[:, STATUS] == FINISHED
        return {
            item[0]: Run(index=item[0], success=True, message=SUCCESS, t=group.times, y=self.states[r].T)
            for r, item in enumerate(items)
            if good[r]
        }

    def _options(self) -> dict[str, Any]:
        return {k: v for k, v in self.group.options.items() if k in ("rtol", "atol", "max_step", "first_step")}

    def _lay_out(self) -> None:
        group, items = self.group, self.items
        first, runs, times = items[0][1], len(items), group.times
        start = np.asarray(items[0][2], dtype=np.float64)
        self.solver = solver = DormandPrince54(
            _never, group.start, start, group.end, problem=first, samples=Samples(times[:0]), **self._options()
        )
        self.fields = [solver.field, *(item[1].field(solver.tolerance, False) for item in items[1:])]
        self.numbers = np.array([f.numbers for f in self.fields])
        self.y = np.array([item[2] for item in items], dtype=np.float64)
        self.last = np.zeros_like(self.y)
        self.clock, self.tally = np.tile(solver._clock, (runs, 1)), np.tile(solver._tally, (runs, 1))
        most = min(group.options.get("max_step", np.inf), 1e300)
        self.clock[:, LARGEST] = [min(most, item[1].largest_step) for item in items]
        self.states = np.empty((runs, times.size, first.n))
        begun = int(np.searchsorted(times, group.start, side="right"))
        self.states[:, :begun] = self.y[:, None]
        self.tally[:, SAMPLE], self.tally[:, WANTED] = begun, LOOK if group.watches else MOST_STEPS
        if group.watches:
            self.tally[:, WATCH] = [item[1].tangent is not None or "stiff_problem" in group.options for item in items]

    def _address(self) -> int:
        """Return the address of the equations for several runs at once, or 0 to take one after another."""
        first = self.items[0][1]
        alike = (p.rhs is first.rhs and p.p.size == first.p.size and p.table.n_inputs == first.table.n_inputs
                 for _, p, _ in self.items)  # fmt: skip
        return batched_rhs(first.rhs, LANES) if self.group.batched and all(alike) else 0

    def _advance(self, going: np.ndarray, address: int) -> None:
        """Take explicit steps of some runs, until each has as many as are wanted or goes no further."""
        solver, times = self.solver, self.group.times
        if address and going.size >= FEWEST_BATCHED:
            clock, tally, y, last = (part[going] for part in (self.clock, self.tally, self.y, self.last))
            solver.advance_batched(address, self.numbers[going], clock, tally, y, last, times, self.states, going)
            self.clock[going], self.tally[going], self.y[going], self.last[going] = clock, tally, y, last
            return
        rates = solver._store[2][0, solver.STAGES - 1]
        for r in going.tolist():
            row = slice(r, r + 1)
            rates[:] = self.last[r]
            solver.advance_many(
                self.numbers[row], self.clock[row], self.tally[row], self.y[row], times, self.states[row]
            )
            self.last[r] = rates

    def _goes_on(self, r: int) -> bool:
        """Let the default method look at a run; return whether it wants further explicit steps."""
        status = int(self.tally[r, STATUS])
        if status in (FINISHED, TOO_SMALL):
            return False
        raise_if_stopped()
        times = self.group.times
        most = most_evaluations(self.items[r][1].table.times, (self.group.start, self.group.end), times.size)
        if self.tally[r, EVALUATIONS] > most:
            self.tally[r, STATUS] = TOO_SMALL  # `solve_ivp` reports it
            return False
        try:
            status = self._default(r).go_on(status, self.clock[r], self.tally[r], self.y[r], self.last[r])
        except Exception:  # `solve_ivp` reports it
            status = TOO_SMALL
        self.tally[r, STATUS] = status
        return status not in (FINISHED, TOO_SMALL)

    def _default(self, r: int) -> Automatic:
        if r not in self._defaults:
            _, problem, x0 = self.items[r]
            options = self._options()
            if "stiff_problem" in self.group.options:
                options["stiff_problem"] = self.group.options["stiff_problem"]
            if self.clock[r, STEP] == 0.0:
                raise RuntimeError("the run has not begun")
            self._defaults[r] = Automatic(
                _never, self.group.start, np.asarray(x0, dtype=np.float64), self.group.end, problem=problem,
                samples=_Into(self.group.times, self.states[r]), **options,
            )  # fmt: skip
        return self._defaults[r]


def _never(t: float, y: np.ndarray) -> np.ndarray:
    raise RuntimeError("this right-hand side is in the problem")
