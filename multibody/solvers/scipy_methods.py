"""SciPy's own methods, whose steps end where the inputs jump, turn a corner or bend, as those of the compiled ones do.

By themselves they know nothing of a table of inputs.  A limit of one sample for every step would keep them from jumping
over one, and cost two to four times the steps where the samples are finer than the motion.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from multibody.base.errors import SimulationError, Stop
from multibody.inputs.table import InputTable
from multibody.solvers.limits import most_evaluations, too_many

__all__ = ["SCIPY_METHODS", "Stops", "solve_with_stops"]

SCIPY_METHODS = ("RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA")
IMPLICIT = ("Radau", "BDF", "LSODA")
NEAR = 1e-9  # share of a step within which its end counts as the stop itself

Function = Callable[[float, np.ndarray], np.ndarray]


class Stops:
    """The times at which steps end, and how far an integration has come among them.

    Parameters
    ----------
    times : ndarray, shape (ns,), s
    jumps : ndarray of bool, shape (ns,)
        Whether an input jumps there: then the rates on one side say nothing about those on the other.
    span : (float, float), s
        Start and end of the integration, in either direction.

    Attributes
    ----------
    longest : float, s
        Longest step that was taken.
    """

    def __init__(self, times: np.ndarray, jumps: np.ndarray, span: tuple[float, float]) -> None:
        self.direction = 1.0 if span[1] >= span[0] else -1.0
        low, high = min(span), max(span)
        inside = (times > low) & (times < high)
        times, jumps = times[inside], jumps[inside]
        order = np.argsort(self.direction * times, kind="stable")
        self.longest = 0.0
        self._times: list[float] = []
        self._jumps: list[bool] = []
        for t, jump in zip(times[order].tolist(), jumps[order].tolist(), strict=True):
            if self._times and abs(t - self._times[-1]) <= 1e-12 * max(abs(t), high - low):
                self._jumps[-1] |= jump
            else:
                self._times.append(t)
                self._jumps.append(jump)
        self._next, self._reached = 0, False
        self._window()

    @classmethod
    def of(cls, table: InputTable, p: np.ndarray, span: tuple[float, float], tolerance: float) -> Stops:
        """Return where steps of a relative tolerance must end for the sake of a table of inputs."""
        kernel = table.kernel_for(tolerance) if tolerance > 0.0 else table.kernel
        times, start = kernel["breaks"].copy(), kernel["break_start"]
        for g, delay in enumerate(kernel["break_delay"]):
            if delay >= 0:
                times[start[g] : start[g + 1]] += p[delay]
        return cls(times, kernel["jumps"].astype(bool), span)

    def _window(self) -> None:
        """Set the times between which rates are evaluated: up to the next stop, where a jump has not come yet."""
        at, times = self._next, self._times
        behind = times[at - 1] if at > 0 else -np.inf * self.direction
        ahead = times[at] if at < len(times) else np.inf * self.direction
        self._low, self._high = min(behind, ahead), np.nextafter(max(behind, ahead), -np.inf)

    def kept(self, function: Function) -> Function:
        """Return a function of time and state that sees the inputs on this side of a jump."""
        if not any(self._jumps):
            return function

        def inside(t: float, x: np.ndarray) -> np.ndarray:
            return function(min(max(t, self._low), self._high), x)

        return inside

    def ahead(self) -> float | None:
        """Return the next stop, or None."""
        return self._times[self._next] if self._next < len(self._times) else None

    def ended(self, t: float, step: float) -> None:
        """Note where a step ended.  Dense output, evaluated between steps, still belongs to that step."""
        self.longest = max(self.longest, step)
        stop = self.ahead()
        self._reached = stop is not None and self.direction * (t - stop) >= -NEAR * step

    def go_on(self) -> bool:
        """Begin the next step; return whether it begins at a jump."""
        if not self._reached:
            return False
        self._reached = False
        self._next += 1
        self._window()
        return self._jumps[self._next - 1]


@cache
def _lapack(name: str, kind: str) -> Any:
    from scipy.linalg import get_lapack_funcs

    routines: Any = get_lapack_funcs((name,), dtype=np.dtype(kind))
    return routines[0]


def _solve(factors: tuple[np.ndarray, np.ndarray], right: np.ndarray) -> np.ndarray:
    return _lapack("getrs", factors[0].dtype.char)(*factors, right, overwrite_b=True)[0]


@cache
def _ending(name: str) -> Any:
    """Return one of SciPy's methods with steps that end at stops."""
    import scipy.integrate

    base = getattr(scipy.integrate, name)

    class Ending(base):  # type: ignore[misc, valid-type]
        def __init__(
            self, fun: Function, t0: float, y0: Any, t_bound: float, stops: Stops, max_step: float = np.inf,
            jac: Any = None, **options: Any,
        ) -> None:  # fmt: skip
            self._stops, self._limit = stops, max_step
            if jac is not None:
                options["jac"] = stops.kept(jac)
            super().__init__(stops.kept(fun), t0, y0, t_bound, max_step=max_step, **options)
            self.lu, self.solve_lu = self._factors, _solve  # of the implicit methods, without the checks around them

        def _step_impl(self) -> tuple[bool, str | None]:
            if self._stops.go_on():
                self._start_anew()
            end, stop, begin = self.t_bound, self._stops.ahead(), self.t
            proposed = self._aim(stop) if stop is not None else 0.0
            try:
                success, message = super()._step_impl()
            finally:
                self._release(end)
            if success:
                step = abs(self.t - begin)
                self._restore_step(proposed, step)
                self._stops.ended(self.t, step)
            return success, message

        def _factors(self, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            self.nlu += 1
            factor = _lapack("getrf", matrix.dtype.char)
            return factor(matrix, overwrite_a=True)[:2]

        def _aim(self, stop: float) -> float:
            """Fit the next step to a stop; return the step that was cut off there, or zero."""
            h, remaining = min(self.h_abs, self._limit), abs(stop - self.t)
            if abs(h - remaining) <= 0.5 * NEAR * h:
                self.t_bound = stop + self.direction * NEAR * h
                return 0.0
            self.t_bound = stop
            if 2.0 * h <= remaining:
                return 0.0
            self._forget_factors()
            if h < remaining:  # two equal steps are better than a long one and a short one
                self.max_step = 0.5 * remaining
            return h

        def _release(self, end: float) -> None:
            self.t_bound, self.max_step = end, self._limit

        def _restore_step(self, proposed: float, step: float) -> None:
            """Go on with what was proposed before a stop cut the step, unless the step asks for less."""

        def _forget_factors(self) -> None:
            """Drop what belongs to another size of step."""

        def _start_anew(self) -> None:
            """Forget the rates from before a jump."""
            self.f = self.fun(self.t, self.y)

    own: dict[str, Any] = {"RK23": _Explicit, "RK45": _Explicit, "DOP853": _Explicit, "Radau": _Radau, "BDF": _BDF}
    mixin = own.get(name, _LSODA)
    return type(name, (mixin, Ending), {"__doc__": base.__doc__, "__module__": __name__})


class _Explicit:
    """What is particular to the explicit methods."""

    h_abs: float

    def _restore_step(self, proposed: float, step: float) -> None:
        if self.h_abs >= step:
            self.h_abs = max(self.h_abs, proposed)


class _Radau(_Explicit):
    LU_real: Any
    LU_complex: Any

    def _forget_factors(self) -> None:
        self.LU_real = self.LU_complex = None

    def _restore_step(self, proposed: float, step: float) -> None:
        before = self.h_abs
        super()._restore_step(proposed, step)
        if self.h_abs != before:
            self._forget_factors()


class _BDF:
    LU: Any

    def _forget_factors(self) -> None:
        self.LU = None

    def _start_anew(self) -> None:
        """Keep the differences: the test of the error sees the jump."""


class _LSODA:
    t: float
    t_bound: float
    _lsoda_solver: Any

    def _aim(self, stop: float) -> float:
        self.t_bound = self._lsoda_solver._integrator.rwork[0] = stop
        return 0.0

    def _release(self, end: float) -> None:
        self.t_bound = self._lsoda_solver._integrator.rwork[0] = end

    def _start_anew(self) -> None:
        """Keep the differences: the test of the error sees the jump."""


def solve_with_stops(
    fun: Function,
    span: tuple[float, float],
    x0: np.ndarray,
    table: InputTable,
    p: np.ndarray,
    method: str,
    dense_output: bool = False,
    **options: Any,
) -> Any:
    """Solve with one of SciPy's methods through ``solve_ivp``, with steps that end where the inputs ask for it.

    Parameters
    ----------
    fun : callable
        ``fun(t, x)``, with the inputs of the table in it.
    span : (float, float), s
    x0 : ndarray, shape (n,)
    table : InputTable
    p : ndarray, shape (n_p,)
        Parameters, for inputs with a delay.
    method : str
        One of `SCIPY_METHODS`.
    dense_output, options
        As in ``solve_ivp``: t_eval, events, rtol, atol, max_step, first_step, jac.

    Returns
    -------
    OdeResult
        As from ``solve_ivp``, with ``longest_step`` (s).
    """
    import scipy.integrate

    asked = options.get("t_eval")
    points = 0 if asked is None else len(asked)
    most, used = most_evaluations(table.times, span, points), 0

    def counted(t: float, x: np.ndarray) -> np.ndarray:
        nonlocal used
        used += 1
        if used > most:
            raise SimulationError(too_many(used - 1, most, t), Stop.TOO_MANY_EVALUATIONS)
        return fun(t, x)

    tolerance = float(np.min(options.get("rtol", 1e-3)))
    stops = Stops.of(table, p, (float(span[0]), float(span[1])), tolerance)
    solve: Any = scipy.integrate.solve_ivp  # its stubs know no options by keyword
    solution = solve(counted, span, x0, method=_ending(method), stops=stops, dense_output=dense_output, **options)
    solution.longest_step = stops.longest
    if not np.size(solution.t):  # lists, where it failed before the first sample
        solution.t, solution.y = np.empty(0), np.empty((np.size(x0), 0))
    if solution.sol is not None and method in ("BDF", "LSODA"):
        # their interpolants do not meet: at the end of a step that of this step counts, as in SciPy
        solution.sol = scipy.integrate.OdeSolution(solution.sol.ts, solution.sol.interpolants, alt_segment=True)
    return solution
