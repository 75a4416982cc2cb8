"""Many integrations side by side, in constant memory, with failures reported one by one.

Threads take runs in small groups, each group through one call of the compiled loop, which holds no interpreter lock.
What that loop cannot finish by itself (a stiff spell, a failure, an option that it does not have) is done again the
long way, through `solve_ivp`, so that results and messages are those of single runs.
"""

from __future__ import annotations

import itertools
import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from multibody.abreast import rhs_abreast, rhs_abreast_is_known
from multibody.solvers.automatic import LOOK, Automatic, held_by_stability
from multibody.solvers.base import Samples
from multibody.solvers.dormand_prince import DormandPrince54
from multibody.solvers.kernels.abreast import LANES
from multibody.solvers.kernels.stepping import (
    DONE,
    FINISHED,
    KNOWN,
    LARGEST,
    MORE,
    SAMPLE,
    STATUS,
    STEP_OLD,
    WANTED,
    WATCH,
    T,
)
from multibody.solvers.problem import NativeProblem
from multibody.solvers.run import integrate

__all__ = ["Run", "batch"]

AHEAD = 4  # groups of runs that wait or are worked on, for each thread
GROUP_SECONDS, MOST_RUNS, GROUP_BYTES = 4e-3, 16, 1 << 22  # of one group
MOST_BYTES = 1 << 24  # of a group that is as small as there are lanes
FEWEST_ABREAST = 3  # runs that are faster in lanes than one after another
COMPILATION = 0.5  # s, of equations in lanes
MOST_LOST = 8  # runs that went the long way in the end, before all do if they are more than half
MOST_STEPS = 1 << 22
SUCCESS = "The solver successfully reached the end of the integration interval."


_Item = tuple[int, NativeProblem, Any]


@dataclass(frozen=True, eq=False)
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


def _run(index: int, problem: NativeProblem, x0: Any, options: dict[str, Any]) -> Run:
    try:
        done = integrate(problem, x0=x0, **options)
    except Exception as error:
        return Run(index, False, f"{type(error).__name__}: {error}", np.empty(0), np.empty((problem.size, 0)))
    return Run(index, bool(done.success), str(done.message), done.t, done.y)


class _Group:
    """The explicit method on several problems at once, as far as it goes by itself.

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
        self.watches, self.abreast, self._looked = method is Automatic, False, 0
        self._tried = self._lost = 0  # runs that the explicit method began, and those that it could not finish
        if not self.usable:
            return
        self.times = np.ascontiguousarray(times, dtype=np.float64)
        self.start, self.end = map(float, options["t_span"])
        self.usable = self.end > self.start and self.times.ndim == 1 and self.times.size > 0
        self.usable &= bool(np.all(np.diff(self.times) >= 0.0))
        self.usable &= self.usable and self.start <= self.times[0] and self.times[-1] <= self.end

    def __call__(self, items: list[_Item]) -> list[Run]:
        """Integrate some runs and return what came of them, in their order."""
        found: dict[int, Run] = {}
        if self.usable and not (self._lost > MOST_LOST and 2 * self._lost > self._tried):
            fit = [item for item in items if self._fits(item, items[0][1].n)]
            if fit:
                found = self._together(fit)
        return [found.get(i) or _run(i, problem, x0, self.options) for i, problem, x0 in items]

    def _fits(self, item: _Item, n: int) -> bool:
        _, problem, x0 = item
        plain = problem.directions is None and problem.n == n and problem.rhs.compiled
        return plain and np.shape(x0) == (n,) and bool(np.all(np.isfinite(x0)))

    def _in_lanes(self, items: list[_Item]) -> int:
        """Return the address of the equations for several runs at once, or 0 to take one after another."""
        first = items[0][1]
        alike = (p.rhs is first.rhs and p.p.size == first.p.size and p.table.n_inputs == first.table.n_inputs
                 for _, p, _ in items)  # fmt: skip
        return rhs_abreast(first.rhs, LANES) if self.abreast and len(items) >= FEWEST_ABREAST and all(alike) else 0

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
        if self.abreast or self._looked > 1 or not self.usable:
            return
        if spent > COMPILATION:
            self._looked = 2
        elif self._looked == 0:
            self._looked = 1
            if not rhs_abreast_is_known(problem.rhs, LANES):
                return
        else:
            return
        self.abreast = rhs_abreast(problem.rhs, LANES) != 0

    def size(self, result: int, pace: float = np.inf) -> int:
        """Return how many runs to take in one group, from the bytes of a result and the seconds that a run takes."""
        least = LANES if self.abreast and LANES * result <= MOST_BYTES else 1
        return max(least, min(MOST_RUNS, GROUP_BYTES // max(1, result), int(GROUP_SECONDS / max(pace, 1e-9))))

    def _together(self, items: list[_Item]) -> dict[int, Run]:
        first, options = items[0][1], self.options
        n, runs, times = first.n, len(items), self.times
        try:
            solver = DormandPrince54(
                _never, self.start, np.asarray(items[0][2], dtype=np.float64), self.end, problem=first,
                **{k: options[k] for k in ("rtol", "atol", "max_step", "first_step") if k in options},
                samples=Samples(times[:0]),
            )  # fmt: skip
        except Exception:  # told for each run by the long way
            return {}
        fields = [solver.field, *(item[1].field(solver.tolerance, False) for item in items[1:])]
        y = np.array([item[2] for item in items], dtype=np.float64)
        clock, tally = np.tile(solver._clock, (runs, 1)), np.tile(solver._tally, (runs, 1))
        most = min(options.get("max_step", np.inf), 1e300)
        clock[:, LARGEST] = [min(most, item[1].largest_step) for item in items]
        states = np.empty((runs, times.size, n))
        begun = int(np.searchsorted(times, self.start, side="right"))
        states[:, :begun] = y[:, None]
        tally[:, SAMPLE], tally[:, WANTED] = begun, LOOK if self.watches else MOST_STEPS
        if self.watches:
            tally[:, WATCH] = [item[1].tangent is not None or "stiff_problem" in options for item in items]
        numbers, going, address = np.array([f.numbers for f in fields]), np.arange(runs), self._in_lanes(items)
        while going.size:
            whole = going.size == runs  # else copies, which are put back
            fields_of, ticks, counts, at, samples = (
                part if whole else part[going] for part in (numbers, clock, tally, y, states))
            if address and going.size >= FEWEST_ABREAST:
                solver.advance_abreast(address, fields_of, ticks, counts, at, times, samples)
            else:
                solver.advance_many(fields_of, ticks, counts, at, times, samples)
            if not whole:
                clock[going], tally[going], y[going], states[going] = ticks, counts, at, samples
            going = np.array([r for r in going if self._goes_on(items[r][1], solver, clock[r], tally[r], y[r])], int)
        good = tally[:, STATUS] == FINISHED
        self._tried, self._lost = self._tried + runs, self._lost + runs - int(good.sum())
        return {
            item[0]: Run(item[0], True, SUCCESS, times, states[r].T)
            for r, item in enumerate(items)
            if good[r]
        }

    def _goes_on(
        self, problem: NativeProblem, solver: DormandPrince54, clock: np.ndarray, tally: np.ndarray, y: np.ndarray
    ) -> bool:
        """Tell whether a run that has taken many steps is one for the explicit method, as `Automatic` does."""
        if not self.watches or tally[STATUS] != MORE:
            return False
        least = solver.atol / solver.rtol
        if tally[WATCH] and held_by_stability(problem.fun, float(clock[T]), y, float(clock[STEP_OLD]), least):
            return False
        tally[DONE] = tally[KNOWN] = 0  # the rates at y are worked out again
        return True


def _never(t: float, y: np.ndarray) -> np.ndarray:
    raise RuntimeError("this right-hand side is in the problem")


def batch(
    runs: Iterable[tuple[NativeProblem, Any]],
    t_span: tuple[float, float],
    t_eval: Any = None,
    workers: int | None = None,
    progress: Callable[[str], Any] | None = None,
    **options: Any,
) -> Iterator[Run]:
    """Integrate many problems by threads, which the compiled loops do not hold up.

    Parameters
    ----------
    runs : iterable of (NativeProblem, x0)
        Drawn as they are needed: a generator of a million is fine.
    t_span, t_eval, options
        As for `integrate`.
    workers : int, optional
        Threads; as many as processors without it.
    progress : callable, optional
        Takes a line of text now and then, such as `vtsdt.progress.Progress`.

    Yields
    ------
    Run
        In the order given.  At most a few results for each thread wait in memory.

    Examples
    --------
    ``for run in batch(((replace(problem, p=p), x0) for p in plan), (0, 6), t_eval): ...``
    """
    count = workers or os.cpu_count() or 1
    group = _Group(dict(options, t_span=t_span, t_eval=t_eval))
    waiting: deque[Future[tuple[list[Run], float]]] = deque()
    source: Iterator[_Item] = ((i, problem, x0) for i, (problem, x0) in enumerate(runs))
    first = next(source, None)
    if first is None:
        return
    source = itertools.chain([first], source)
    group.look_for_lanes(first[1], 0.0)
    size, spent, failed = group.size(group.bytes_of(first[1])), 0.0, 0
    with ThreadPoolExecutor(count) as pool:
        try:
            while True:
                ahead = AHEAD if 4 * size * group.bytes_of(first[1]) <= GROUP_BYTES else AHEAD // 2
                while len(waiting) < ahead * count and (items := list(itertools.islice(source, size))):
                    waiting.append(pool.submit(_timed, group, items))
                if not waiting:
                    return
                done, pace = waiting.popleft().result()
                spent += pace * len(done)
                group.look_for_lanes(first[1], spent)
                size = group.size(max(run.y.nbytes for run in done), pace)
                for run in done:
                    failed += not run.success
                    if progress is not None:
                        progress(f"run {run.index + 1}" + (f", {failed} failed" if failed else ""))
                    yield run
        finally:
            for future in waiting:
                future.cancel()


def _timed(group: _Group, items: list[_Item]) -> tuple[list[Run], float]:
    begun = time.perf_counter()
    return group(items), (time.perf_counter() - begun) / len(items)
