"""One simulation: inputs and start values by name, integration through `solve_ivp`, a trajectory."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from multibody.base.errors import SimulationError, Stop, StopMessage
from multibody.base.spelling import nearest
from multibody.inputs.table import InputTable
from multibody.system.compiled import CompiledSystem
from multibody.system.narrow_features import StepLimits, finer_step, narrow_features, step_limits
from multibody.system.not_finite import not_finite_beyond
from multibody.system.stepped import run_stepped
from multibody.system.trajectory import Trajectory

if TYPE_CHECKING:
    from multibody.solvers.problem import Directions, NativeProblem

__all__ = ["input_table", "native_problem", "simulate"]

NATIVE = ("Automatic", "DormandPrince54", "Exponential43", "Rodas5P")
SCIPY = ("RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA")
_FEATURE_RUNS = 4


def simulate(
    system: CompiledSystem,
    until: float | tuple[float, float],
    *,
    inputs: Mapping[str, Any] | InputTable | None = None,
    parameters: Mapping[str, float] | np.ndarray | None = None,
    initial: Mapping[str, float] | np.ndarray | None = None,
    times: np.ndarray | None = None,
    step: float | None = None,
    method: str = "auto",
    interpolation: str = "linear",
    rtol: float = 1e-6,
    atol: float | np.ndarray = 1e-9,
    max_step: float | None = None,
    events: Any = None,
) -> Trajectory:
    """Simulate a machine.

    Parameters
    ----------
    system : CompiledSystem
        The machine.
    until : float or (float, float), s
        End, or start and end.
    inputs : mapping or InputTable, optional
        For each model input a number, a pair ``(times, values)``, or a function of time.
    parameters, initial : mapping or ndarray, optional
        Values that replace the model's own, by name, SI.
    times : ndarray, shape (nt,), s, optional
        When to record; alternatively ``step`` in s; default: 1001 even times.
    method : str
        ``"auto"``, a compiled method (``"Automatic"``: explicit, and stiff where that pays;
        ``"DormandPrince54"``: explicit; ``"Rodas5P"``: stiff; ``"Exponential43"``: one fast motion apart, such
        as a stiff damper's) or any method of SciPy (``"RK45"``, ``"LSODA"``, …).  ``statistics`` names the one used.
    interpolation : {"linear", "hold", "cubic"}
        Between the samples of recorded inputs.
    rtol, atol : float
        Tolerances of the integrator.
    max_step : float, s, optional
        Largest step.  By default no step jumps over a break of an input (see `multibody.inputs.breaks`) or over a
        narrow feature that passes by (see `multibody.system.narrow_features`): the compiled methods evaluate its
        speed in every step; a run by a method of SciPy that turns out to have jumped is repeated with shorter steps.
    events : callable or list, optional
        As in ``solve_ivp``, functions of ``(t, x)``; their times are in ``statistics["events"]``.

    Raises
    ------
    SimulationError
        If an input is missing or unknown, or the integrator stops early: the message gives time and state.
    """
    t0, t1 = (0.0, float(until)) if np.ndim(until) == 0 else (float(until[0]), float(until[1]))  # type: ignore[index,arg-type]
    if not t1 > t0:
        raise SimulationError(f"'{system.name}': the end {t1:g} s must be later than the start {t0:g} s")
    if step is not None and not step > 0.0:
        raise SimulationError(f"'{system.name}': the step is {step:g} s, it must be positive")
    if times is None:
        times = np.linspace(t0, t1, 1001) if step is None else t0 + step * np.arange(int((t1 - t0) / step + 1e-9) + 1)
    times = np.ascontiguousarray(times, dtype=float)
    inside = times.ndim == 1 and times.size and times[0] >= t0 and times[-1] <= t1 and np.all(np.diff(times) > 0)
    if not inside:
        raise SimulationError(f"'{system.name}': times must increase and lie between {t0:g} s and {t1:g} s")
    p, x0 = system.parameter_vector(parameters), system.state_vector(initial)
    functions = {} if not isinstance(inputs, Mapping) else {k: v for k, v in inputs.items() if callable(v)}
    table = input_table(system, inputs, interpolation=interpolation)
    if system.stepped:
        return _stepped(system, p, x0, table, times, functions, events, rtol)
    limits = step_limits(system, p) if max_step is None else StepLimits(largest_step=max_step)
    unchecked = limits.of_signals  # by the steps themselves: the finished run is checked
    if max_step is None and (functions or method not in ("auto", *NATIVE)):  # SciPy's methods evaluate no speeds
        unchecked = tuple(narrow_features(system, p))
    name, reason = _method(method, functions)
    task = _Task(
        system=system,
        table=table,
        functions={system.index("input", n): f for n, f in functions.items()},
        p=p,
        x0=x0,
        span=(t0, t1),
        times=times,
        method=name,
        reason=reason,
        rtol=rtol,
        atol=atol,
        events=events,
    )
    run = task.run(limits)
    for _ in range(_FEATURE_RUNS):  # a run that jumped over a motion does not show the speeds that it has
        if not unchecked or (finer := finer_step(run, unchecked, limits.largest_step)) is None:
            break
        limits = replace(limits, largest_step=finer)
        run = task.run(limits)
    return run


def _stepped(
    system: CompiledSystem,
    p: np.ndarray,
    x0: np.ndarray,
    table: InputTable,
    times: np.ndarray,
    functions: Mapping[str, Any],
    events: Any,
    rtol: float,
) -> Trajectory:
    """Return the trajectory of a model with a part that steps itself."""
    if functions or events is not None:
        raise SimulationError(
            f"'{system.name}' has a unit that is stepped (Co-Simulation): give inputs as numbers or (times, values), "
            "and no events"
        )
    run = run_stepped(system, p, x0, table, times, rtol=rtol)
    statistics = {"method": "communication steps", "why": "a unit steps itself", "nfev": run.evaluations}
    return Trajectory(system=system, times=times, states=run.states, inputs=run.inputs, p=p, statistics=statistics)


def input_table(
    system: CompiledSystem, inputs: Mapping[str, Any] | InputTable | None, *, interpolation: str = "linear"
) -> InputTable:
    """Return the inputs of a system as one table on a common time grid.

    Raises
    ------
    SimulationError
        With every unknown or missing input and every pair that does not fit.
    """
    if isinstance(inputs, InputTable):
        if tuple(inputs.names) != system.input_names:
            raise SimulationError(
                f"'{system.name}' takes the inputs {', '.join(system.input_names)}, the table has "
                f"{', '.join(inputs.names)}"
            )
        return inputs
    given = dict(inputs or {})
    faults = [f"there is no input '{n}'{nearest(n, system.input_names)}" for n in given if n not in system.input_names]
    declared = system.model.inputs
    columns: dict[str, Any] = {}
    grids: list[np.ndarray] = []
    for q in system.inputs:
        value = given.get(q.name)
        if value is None:
            if q.name in declared and declared[q.name].default is None:
                faults.append(f"input '{q.name}' ({q.unit}) is missing: give a number, (times, values) or a function")
            columns[q.name] = q.value
        elif callable(value):
            columns[q.name] = 0.0
        elif np.ndim(value) == 0 and not isinstance(value, tuple | list):
            columns[q.name] = float(value)
        else:
            try:
                t, v = (np.asarray(part, dtype=float) for part in value)
            except (TypeError, ValueError):
                faults.append(f"input '{q.name}': give a number, (times, values) or a function of time")
                continue
            if t.ndim != 1 or t.shape != v.shape or t.size == 0:
                faults.append(f"input '{q.name}': there are {t.size} times and {v.size} values")
            elif np.any(np.diff(t) <= 0):
                faults.append(f"input '{q.name}': times must increase")
            elif not np.all(np.isfinite(v)):
                faults.append(f"input '{q.name}': {int(np.sum(~np.isfinite(v)))} values are not finite")
            else:
                columns[q.name] = (t, v)
                grids.append(t)
    if faults:
        raise SimulationError(f"'{system.name}' cannot be simulated:\n" + "\n".join(f"  - {f}" for f in faults))
    if not grids:
        return InputTable.constant(columns)
    delays = dict(system.input_delays)
    grid = (
        grids[0]
        if all(g is grids[0] or np.array_equal(g, grids[0]) for g in grids)
        else np.unique(np.concatenate(grids))
    )
    same = {n: _on_grid(c, grid, interpolation) if isinstance(c, tuple) else c for n, c in columns.items()}
    return InputTable.from_columns(grid, same, interpolation, delays)


def _on_grid(column: tuple[np.ndarray, np.ndarray], grid: np.ndarray, interpolation: str) -> np.ndarray:
    t, v = column
    if t.shape == grid.shape and np.array_equal(t, grid):
        return v
    if interpolation == "hold":
        return v[np.clip(np.searchsorted(t, grid, side="right") - 1, 0, t.size - 1)]
    if interpolation == "cubic":
        from scipy.interpolate import PchipInterpolator

        return PchipInterpolator(t, v)(np.clip(grid, t[0], t[-1]))
    return np.interp(grid, t, v)


def native_problem(
    system: CompiledSystem,
    p: np.ndarray,
    table: InputTable,
    directions: Directions | None = None,
    *,
    tangent: bool = False,
    limits: StepLimits | None = None,
) -> NativeProblem:
    """Return the initial value problem of a system for the compiled solvers; see `NativeProblem`.

    ``limits`` keep steps from jumping over narrow features; by default those of the model (see `step_limits`).
    """
    from multibody.solvers.problem import NativeProblem

    limits = step_limits(system, p) if limits is None else limits
    widths = limits.widths
    wants_tangent = tangent or directions is not None
    return NativeProblem(
        rhs=system.rhs_function,
        p=p,
        table=table,
        n=len(system.states),
        tangent=system.rhs_tangent if wants_tangent else None,
        columns=system.rhs_columns if tangent else None,
        directions=directions,
        colours=system.colours if wants_tangent else None,
        pattern=system.sparsity if wants_tangent else None,
        state_names=system.state_names,
        speeds=system.speeds_function if widths else None,
        widths=np.array([widths.get(n, np.inf) for n in system.speed_names]) if widths else None,
        largest_step=limits.largest_step,
        explain=lambda t, x: not_finite_beyond(system, t, x, table(t, p), p),
    )


@dataclass(frozen=True, kw_only=True)
class _Task:
    """One initial value problem with its inputs and its method; ``functions`` are inputs by their index."""

    system: CompiledSystem
    table: InputTable
    functions: dict[int, Callable[[float], float]]
    p: np.ndarray
    x0: np.ndarray
    span: tuple[float, float]
    times: np.ndarray
    method: str
    reason: str
    rtol: float
    atol: float | np.ndarray
    events: Any

    def run(self, limits: StepLimits) -> Trajectory:
        """Integrate and return the trajectory."""
        if not self.system.states:
            return self._trajectory(self.times, np.empty((self.times.size, 0)), {"why": "no states"})
        solution, reason = self._compiled(limits) if self.method in NATIVE else self._by_scipy(limits)
        if solution.status < 0 or not np.all(np.isfinite(solution.y)):
            message = solution.message
            stop = message.stop if isinstance(message, StopMessage) else Stop.OTHER
            raise SimulationError(self._failure(solution), stop, int(solution.nfev))
        statistics = {
            "why": reason,
            "nfev": solution.nfev,
            "njev": solution.njev,
            "nlu": solution.nlu,
            "max_step": limits.largest_step,
            "longest_step": getattr(solution, "longest_step", np.inf),
            "rtol": self.rtol,
            "atol": self.atol,
        }
        if self.events is not None:
            statistics["events"] = solution.t_events
        return self._trajectory(solution.t, np.ascontiguousarray(solution.y.T), statistics)

    def _options(self, limits: StepLimits) -> dict[str, Any]:
        tolerances = {"rtol": self.rtol, "atol": self.atol, "max_step": limits.largest_step}
        return {"t_eval": self.times, "events": self.events, **tolerances}

    def _compiled(self, limits: StepLimits) -> tuple[Any, str]:
        """Return the solution of a compiled method, and the reason for the method."""
        from multibody.solvers.automatic import Automatic, in_words
        from multibody.solvers.dormand_prince import DormandPrince54
        from multibody.solvers.exponential import Exponential43
        from multibody.solvers.rosenbrock import Rodas5P
        from multibody.solvers.run import integrate

        def problem(*, tangent: bool) -> NativeProblem:
            return native_problem(self.system, self.p, self.table, tangent=tangent, limits=limits)

        solver = {s.__name__: s for s in (Automatic, DormandPrince54, Exponential43, Rodas5P)}[self.method]
        options = self._options(limits)
        history: list[tuple[float, str]] = []
        if solver is Automatic:
            options |= {"stiff_problem": lambda: problem(tangent=True), "history": history}
        first = problem(tangent=solver in (Rodas5P, Exponential43))
        solution = integrate(first, self.span, self.x0, method=solver, **options)
        return solution, in_words(history, float(solution.t[-1])) if solver is Automatic else self.reason

    def _by_scipy(self, limits: StepLimits) -> tuple[Any, str]:
        """Return the solution of a method of SciPy, and the reason for the method."""
        from multibody.solvers.scipy_methods import IMPLICIT, solve_with_stops

        system, p, options = self.system, self.p, self._options(limits)
        # inputs and rates in one compiled call, where no input is a function and the model is compiled
        in_one_call = system.compiled and not self.functions

        def rates(t: float, x: np.ndarray) -> np.ndarray:
            return system.rhs(t, x, self._inputs_at(t), p)

        if self.method in IMPLICIT and in_one_call:
            options["jac"] = native_problem(system, p, self.table, tangent=True).jac
        elif self.method in IMPLICIT:
            options["jac"] = lambda t, x: system.jacobian("x", t, x, self._inputs_at(t), p)
        fun = native_problem(system, p, self.table).fun if in_one_call else rates
        return solve_with_stops(fun, self.span, self.x0, self.table, p, self.method, **options), self.reason

    def _inputs_at(self, t: float) -> np.ndarray:
        u = self.table(t, self.p)
        for k, function in self.functions.items():
            u[k] = function(t)
        return u

    def _failure(self, solution: Any) -> str:
        """Return in words how far an integration came, and why not further."""
        good = np.all(np.isfinite(solution.y), axis=0) if solution.y.size else np.zeros(0, dtype=bool)
        t, x = (solution.t[good][-1], solution.y[:, good][:, -1]) if good.any() else (self.span[0], self.x0)
        head = f"'{self.system.name}': {self.method} stopped between t = {t:.6g} s and the end at {self.span[1]:g} s. "
        message = str(solution.message)
        if solution.status >= 0:  # the method has not noticed: its states are not finite
            message = not_finite_beyond(self.system, t, x, self._inputs_at(t), self.p) or "the states are not finite"
        stop = getattr(solution.message, "stop", None)
        values = ", ".join(f"{n} = {v:.4g}" for n, v in list(zip(self.system.state_names, x, strict=True))[:12])
        text = f"{head}{message.rstrip('.')}. Last good state: {values}."
        if stop in (Stop.TOO_MANY_EVALUATIONS, Stop.NOT_FINITE):
            return text
        return (
            f"{text} Check what acts on that state there: a stiff contact, a force that jumps, or a parameter far from "
            "its usual size."
        )

    def _trajectory(self, times: np.ndarray, states: np.ndarray, statistics: dict[str, Any]) -> Trajectory:
        inputs = self.table(times, self.p).reshape(times.size, -1)
        for k, function in self.functions.items():
            inputs[:, k] = [function(t) for t in times]
        statistics = {"method": self.method, **statistics}
        return Trajectory(
            system=self.system, times=times, states=states, inputs=inputs, p=self.p, statistics=statistics
        )


def _method(method: str, functions: Mapping[str, Any]) -> tuple[str, str]:
    """Return the name of the method for a simulation, and the reason for it."""
    if method == "auto":
        if functions:
            return "LSODA", "inputs that are Python functions need a method that can call them"
        return "Automatic", ""
    if method not in (*NATIVE, *SCIPY):
        raise SimulationError(f"there is no method '{method}': take one of {', '.join(('auto', *NATIVE, *SCIPY))}")
    if method in NATIVE and functions:
        raise SimulationError(
            f"'{method}' is compiled and cannot call the function given for '{next(iter(functions))}': "
            "give (times, values), or take a SciPy method such as 'LSODA'"
        )
    return method, "asked for"
