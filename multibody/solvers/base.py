"""What the compiled methods share: SciPy's side of a solver that takes many steps per call."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from typing import Any, ClassVar, Self

import numpy as np
from scipy.integrate import DenseOutput, OdeSolver

from multibody.base.errors import Stop, StopMessage
from multibody.base.stopping import raise_if_stopped
from multibody.solvers.kernels.dense_output import interpolate_many
from multibody.solvers.kernels.stepping import (
    BUFFER_FULL,
    COUNTS,
    DONE,
    EVALUATIONS,
    FACTORIZATIONS,
    FINISHED,
    FIRST,
    JACOBIANS,
    LEAST_ERROR,
    LONGEST,
    MORE,
    SAMPLE,
    TICKS,
    TOO_SMALL,
    WANTED,
    WORST,
    T,
)
from multibody.solvers.limits import (
    RUNAWAY,
    allowed_by_then,
    cause_of_small_steps,
    most_evaluations,
    too_many,
)
from multibody.solvers.problem import NativeProblem, ProblemError

__all__ = ["NativeSolver", "Samples"]

STORE_BYTES = 1 << 20
CHUNK_BYTES = 1 << 23
SAMPLED_STEPS = 1 << 14
LEAST_RTOL = 100 * sys.float_info.epsilon


class Samples:
    """States at given times, written by the compiled loop while it integrates.

    Without it, what happens between steps is seen through SciPy's dense output, which keeps every stage of
    every step of a call: too much for a problem with hundreds of directions.

    Parameters
    ----------
    times : ndarray, shape (nt,), s
        In the direction of integration and within its interval.
    receive : callable, optional
        ``receive(first, times, states)`` gets the samples in pieces, states of shape (len(times), size),
        which are overwritten afterwards.  Without it they are kept in ``states``.

    Attributes
    ----------
    states : ndarray, shape (nt, size)
        The samples, if there is no ``receive``.
    count : int
        Number of samples written so far.
    longest : float, s
        Largest step that was taken.
    """

    def __init__(self, times: Any, receive: Callable[[int, np.ndarray, np.ndarray], None] | None = None) -> None:
        self.times = np.ascontiguousarray(times, dtype=np.float64)
        self.receive = receive
        self.states = np.empty((0, 0))
        self.count = 0
        self.longest = 0.0

    def follow(self, direction: float) -> bool:
        """Tell whether the times go in a direction, or stand."""
        ahead = self.times[1:] >= self.times[:-1] if direction > 0.0 else self.times[1:] <= self.times[:-1]
        return bool(ahead.all())

    def begin(self, size: int) -> np.ndarray:
        """Return the buffer for states of the given size."""
        rows = len(self.times)
        if self.receive is not None:
            rows = min(rows, max(1, CHUNK_BYTES // (8 * max(size, 1))))
        self.states = np.empty((rows, size))
        self.count = 0
        return self.states

    def flush(self, first: int, end: int) -> int:
        """Hand over the samples first..end; return the first sample of the buffer from now on."""
        self.count = end
        if self.receive is None:
            return 0
        if end > first:
            self.receive(first, self.times[first:end], self.states[: end - first])
        return end


class StoredSteps(DenseOutput):
    """The solution between two calls: the interpolants of the steps in between."""

    def __init__(self, t_old: float, t: float, direction: float, steps: int, store: Any) -> None:
        super().__init__(t_old, t)
        self._direction = direction
        self._steps = steps
        self._store = tuple(part[:steps].copy() for part in store)

    def _call_impl(self, t: Any) -> np.ndarray:
        at = np.ascontiguousarray(np.atleast_1d(t), dtype=np.float64)
        out = np.empty((at.size, self._store[1].shape[1]))
        interpolate_many(at, self._direction, self._steps, *self._store, out)
        return out[0] if np.ndim(t) == 0 else out.T


def _tolerance(name: str, value: Any, problem: NativeProblem, least: float = 0.0) -> np.ndarray:
    if type(value) is float and problem.directions is None and 0.0 <= value < np.inf:
        full = np.empty(problem.n)
        full.fill(max(value, least))
        return full
    given = np.asarray(value, dtype=np.float64)
    if given.shape not in ((), (problem.n,), (problem.size,)):
        raise ProblemError(f"{name} has the shape {given.shape}; give a number or one for each of {problem.n} states")
    if not np.all(np.isfinite(given)) or np.any(given < 0.0):
        raise ProblemError(f"{name} must be finite and not negative")
    given = np.maximum(given, least)
    if given.shape == () and problem.directions is None:
        return np.full(problem.n, given)
    if given.shape == (problem.size,):
        return given.copy()
    full = np.tile(np.broadcast_to(given, (problem.n,)), 1 + problem.n_directions)
    if name == "atol" and problem.directions is not None:
        full[problem.n :] /= np.repeat(np.asarray(problem.directions.scale), problem.n)
    return full


class NativeSolver(OdeSolver):
    """Base of the compiled methods; use `DormandPrince54` or `Rodas5P`.

    Parameters
    ----------
    fun : callable
        Asked for by SciPy and not used: the right-hand side is that of ``problem``.
    t0, t_bound : float, s
        Interval of integration, in either direction.
    y0 : ndarray, shape (size,)
        ``problem.initial(x0)``.
    problem : NativeProblem
    rtol, atol : float or ndarray, shape (n,) or (size,)
        The error of a step is at most about atol + rtol·|y|, as a root mean square over the states.
    max_step : float, s
        Largest step.
    first_step : float, s, optional
        First step; default: estimated.
    internal_steps : int, optional
        Steps per call.  SciPy looks for events only between calls, so events ask for 1 (`integrate` does
        that).
    samples : Samples, optional
        Write the states at these times and do without dense output, which is faster than ``t_eval``
        (`integrate` does that).
    control_directions : bool
        Count the components of the directions among those of the state, with the same tolerances.
    direction_rtol : float
        Otherwise the error of a step in a direction is at most about this share of the direction's own size.  A
        direction can need smaller steps than the state: where the state rests and the direction grows or stiffly
        decays, the state's error says nothing.  Infinity leaves the directions without control.
    max_evaluations : int, optional
        Give up, with a message, after a call that has taken the right-hand side beyond this number of evaluations;
        default: `LEAST_EVALUATIONS` and `EVALUATIONS_PER_SAMPLE` for each sample and each time of the input table
        within the interval.
    """

    ORDER: ClassVar[int] = 5
    STAGES: ClassVar[int] = 7
    KERNEL: ClassVar[Any]
    IMPLICIT: ClassVar[bool] = False

    def __init__(
        self,
        fun: Any,
        t0: float,
        y0: Any,
        t_bound: float,
        problem: NativeProblem | None = None,
        rtol: Any = 1e-3,
        atol: Any = 1e-6,
        max_step: float = np.inf,
        first_step: float | None = None,
        vectorized: bool = False,
        internal_steps: int | None = None,
        samples: Samples | None = None,
        control_directions: bool = False,
        direction_rtol: float = 1e-3,
        max_evaluations: int | None = None,
        **extraneous: Any,
    ) -> None:
        if problem is None:
            raise ProblemError(f"{type(self).__name__} needs a NativeProblem: solve_ivp(..., problem=...)")
        if extraneous:
            warnings.warn(f"{type(self).__name__} ignores: {', '.join(sorted(extraneous))}", stacklevel=3)
        super().__init__(fun, t0, y0, t_bound, vectorized)
        # SciPy's wrappers refer to the solver: with them its samples would wait for the garbage collector.
        self.fun = self.fun_single = self.fun_vectorized = fun
        size = problem.size
        if self.n != size:
            raise ProblemError(
                f"y0 has {self.n} components, the problem {size} "
                f"({problem.n} states, {problem.n_directions} directions): use problem.initial(x0)"
            )
        if not max_step > 0.0:
            raise ProblemError(f"max_step must be positive, it is {max_step}")
        span = abs(t_bound - t0)
        if first_step is not None and not 0.0 < first_step <= max(span, sys.float_info.min):
            raise ProblemError(f"first_step must be positive and within the interval of {span:g} s, it is {first_step}")
        self.problem, self._from = problem, float(t0)
        self.y = self.y.astype(np.float64)
        self.max_step = min(max_step, problem.largest_step)
        self.max_evaluations = most_evaluations(
            problem.table.times, (t0, t_bound), 0 if samples is None else samples.times.size
        )
        if max_evaluations is not None:
            self.max_evaluations = max_evaluations
        self.rtol = _tolerance("rtol", rtol, problem, LEAST_RTOL)
        self.atol = _tolerance("atol", atol, problem)
        if not direction_rtol > 0.0:
            raise ProblemError(f"direction_rtol must be positive, it is {direction_rtol}")
        if problem.directions is not None and not control_directions and np.shape(rtol) != (size,):
            self.rtol[problem.n :] = min(direction_rtol, 1e300)
        alike = type(rtol) is float and problem.n > 0
        self.tolerance = min(1.0, float(self.rtol[0] if alike else self.rtol[: problem.n].min(initial=1.0)))
        self.field = problem.field(self.tolerance, self.IMPLICIT)
        self._count = size if control_directions else problem.n
        self._samples, self._unasked = samples, internal_steps is None
        if samples is not None:
            self._steps = internal_steps or SAMPLED_STEPS
            slots = 1
        else:
            fitting = STORE_BYTES // (8 * max(size, 1) * (self.STAGES + 1))
            self._steps = internal_steps or min(max(fitting, 1), 64)
            slots = self._steps
        self._allocate(slots)
        self._state = self.y.copy()
        self._clock = np.zeros(TICKS)
        self._tally = np.zeros(COUNTS, dtype=np.int64)
        self._tally[WANTED] = self._steps
        self._begin_samples()
        # The driver finds the first step by itself where it is zero.
        begin = 0.0 if first_step is None else first_step
        # Infinity would become nan in products with zero, and no interval is longer than this.
        self._clock[:6] = self.t, begin, LEAST_ERROR, self.t_bound, self.direction, min(self.max_step, 1e300)

    def _allocate(self, slots: int) -> None:
        """Make the room in which the driver works, with so many slots for the steps of a call."""
        size = self.problem.size
        self._store = (np.empty((slots, 2)), np.empty((slots, size)), np.empty((slots, self.STAGES, size)))
        self._work = np.zeros(3 * size)
        self._call: Callable[[], int] | None = None

    @classmethod
    def sharing_with(cls, other: NativeSolver, problem: NativeProblem) -> Self:
        """Return this method on clock, state, tolerances and samples of another, for a problem of the same states."""
        solver = cls.__new__(cls)
        vars(solver).update(vars(other))
        solver.problem = problem
        solver.field = problem.field(other.tolerance, cls.IMPLICIT)
        solver._allocate(len(other._store[0]))
        return solver

    def _begin_samples(self) -> None:
        if self._samples is None:
            self._sample_t, self._sample_y = np.empty(0), np.empty((0, self.n))
            return
        t = self._samples.times
        if not self._samples.follow(float(self.direction)):
            raise ProblemError("sample times must follow the direction of integration")
        if t.size and (self.direction * (t[0] - self.t) < 0.0 or self.direction * (t[-1] - self.t_bound) > 0.0):
            raise ProblemError(f"sample times must be within {self.t:g} s and {self.t_bound:g} s")
        self._sample_t, self._sample_y = t, self._samples.begin(self.n)
        forward = self.direction > 0.0
        at_start = int(t.searchsorted(self.t, "right") if forward else (-t).searchsorted(-self.t, "right"))
        self._sample_y[: min(at_start, len(self._sample_y))] = self.y
        self._tally[SAMPLE] = at_start
        self._samples.count = at_start

    def _extra(self) -> tuple[Any, ...]:
        """Arguments of the driver beyond those that all methods share."""
        return ()

    def _advance(self) -> int:
        if self._call is None:
            self._call = self._bound()
        return self._call()

    def _bound(self) -> Callable[[], int]:
        """Return the driver's call with this solver's arrays."""
        return self.KERNEL.advance.bound(
            self.field.numbers[None],
            self._clock[None],
            self._tally[None],
            self._state[None],
            self._work,
            *self._store,
            self.rtol,
            self.atol,
            self._count,
            self._sample_t,
            self._sample_y[None],
            *self._extra(),
        )

    def _step_impl(self) -> tuple[bool, str | None]:
        clock, tally, samples = self._clock, self._tally, self._samples
        # Where nobody looks between calls, SciPy need not hear of them.
        unseen = self._unasked and samples is not None
        while True:
            raise_if_stopped()
            status = self._advance()
            self.problem.check()
            within = tally[EVALUATIONS] <= self._allowed() and not self._runs_away()
            if status == MORE and unseen and within:
                continue
            if samples is not None:
                tally[FIRST] = samples.flush(int(tally[FIRST]), int(tally[SAMPLE]))
            if status != BUFFER_FULL:
                break
        self.nfev, self.njev, self.nlu = (
            int(tally[EVALUATIONS]),
            int(tally[JACOBIANS]),
            int(tally[FACTORIZATIONS]),
        )
        if samples is not None:
            samples.longest = float(clock[LONGEST])
        self.t = float(clock[T])
        self.y = self._state.copy()
        if status == TOO_SMALL and tally[DONE] == 0:
            return False, self._explanation()
        if self._runs_away() or (self.nfev > self._allowed() and status != FINISHED):
            return False, self._given_up()
        return True, None

    def _runs_away(self) -> bool:
        """Tell whether a state has become larger than anything that a machine can be."""
        return not bool(np.all(np.abs(self._state[: self.problem.n]) < RUNAWAY))

    def _allowed(self) -> int:
        """Return the evaluations that are allowed up to here."""
        done = (float(self._clock[T]) - self._from) / (self.t_bound - self._from)
        return allowed_by_then(self.max_evaluations, done)

    def _given_up(self) -> StopMessage:
        problem, x = self.problem, self.y[: self.problem.n]
        if self._runs_away():
            text = problem.explain(self.t, x) if problem.explain is not None else ""
            return StopMessage(text or f"the states are beyond {RUNAWAY:g} at t = {self.t:.9g} s", Stop.NOT_FINITE)
        cause = cause_of_small_steps(
            lambda state: problem.derivative(self.t, state), x, abs(self.t_bound - self._from), problem.name_of
        )
        return StopMessage(too_many(self.nfev, self._allowed(), self.t, cause), Stop.TOO_MANY_EVALUATIONS)

    def _explanation(self) -> StopMessage:
        problem = self.problem
        if problem.explain is not None and (text := problem.explain(self.t, self.y[: problem.n])):
            return StopMessage(text, Stop.NOT_FINITE)
        derivative = problem.derivative(self.t, self.y[: problem.n])
        bad = np.flatnonzero(~np.isfinite(derivative))
        if bad.size:
            text = f"the derivative of {self.problem.name_of(int(bad[0]))} is not finite at t = {self.t:.9g} s" + (
                f" ({bad.size} derivatives in all)" if bad.size > 1 else ""
            )
            return StopMessage(text, Stop.NOT_FINITE)
        return StopMessage(
            f"the step became too small at t = {self.t:.9g} s; the largest scaled error was that of "
            f"{self.problem.name_of(int(self._tally[WORST]))}",
            Stop.STEP_TOO_SMALL,
        )

    def _dense_output_impl(self) -> DenseOutput:
        if self._samples is not None:
            raise RuntimeError("samples replace dense output: leave out samples to use t_eval, events or dense_output")
        steps = int(self._tally[DONE])
        return StoredSteps(self.t_old, self.t, float(self.direction), steps, self._store)
