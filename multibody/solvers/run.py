"""The short way to a solution: `scipy.integrate.solve_ivp` with the options that fit the question."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from multibody.base.errors import Stop, StopMessage
from multibody.solvers.automatic import Automatic
from multibody.solvers.base import NativeSolver, Samples
from multibody.solvers.problem import NativeProblem, ProblemError

__all__ = ["integrate"]


def integrate(
    problem: NativeProblem,
    t_span: tuple[float, float],
    x0: Any,
    t_eval: Any = None,
    method: type[NativeSolver] | str = Automatic,
    events: Any = None,
    dense_output: bool = False,
    samples: Samples | None = None,
    **options: Any,
) -> Any:
    """Solve a problem through ``solve_ivp``, with a compiled method or one of SciPy's own.

    With a compiled method it differs from a direct call in two options.  With ``t_eval`` alone the compiled loop writes
    the states at these times itself; with ``events`` every call takes one step, so that no event between the steps of a
    call is missed, as with SciPy's own methods.

    Parameters
    ----------
    problem : NativeProblem
    t_span : (float, float), s
    x0 : array_like, shape (n,)
        Initial state; the directions' part comes from the problem.
    t_eval : array_like, shape (nt,), s, optional
    method : type or str
        `Automatic`, `DormandPrince54` or `Rodas5P`, or the name of a method of SciPy, whose steps then end at the
        breaks of the inputs as well (see `multibody.solvers.scipy_methods`).
    events, dense_output
        As in ``solve_ivp``.
    samples : Samples, optional
        In place of ``t_eval``, to receive states piece by piece.
    options
        Options of `NativeSolver`: rtol, atol, max_step, first_step, control_directions, direction_rtol, internal_steps,
        max_evaluations; or of SciPy's method.

    Returns
    -------
    OdeResult
        As from ``solve_ivp``; ``y`` has the shape (size, nt), see `NativeProblem.split`;
        ``longest_step`` (s) unless events or dense output were requested from a compiled method.

    Raises
    ------
    ProblemError
        If a method of SciPy is given ``samples``, which only the compiled loops write.
    """
    if isinstance(method, str):
        if samples is not None:
            raise ProblemError(f"{method} writes no samples: give t_eval, or a compiled method")
        options |= {"t_eval": t_eval, "events": events, "dense_output": dense_output}
        return _by_scipy(problem, t_span, x0, method, **options)
    import scipy.integrate

    # SciPy's stubs do not know that a method may take options of its own.
    solve_ivp: Any = scipy.integrate.solve_ivp
    y0 = problem.initial(x0)
    common: dict[str, Any] = dict(method=method, problem=problem, **options)
    if events is not None or dense_output:
        if events is not None:
            common.setdefault("internal_steps", 1)
        return solve_ivp(_unused, t_span, y0, t_eval=t_eval, events=events, dense_output=dense_output, **common)
    kept = samples is None and t_eval is not None
    if kept:
        samples = Samples(t_eval)
    if problem.rhs.elsewhere:
        solution = _elsewhere(problem, t_span, x0, method, samples, options)
    else:
        solution = solve_ivp(_unused, t_span, y0, samples=samples, **common)
    if samples is not None:
        solution.longest_step = samples.longest
    if kept and samples is not None:
        solution.t = samples.times[: samples.count]
        solution.y = np.asarray(samples.states[: samples.count].T)
    return solution


def _elsewhere(
    problem: NativeProblem,
    t_span: tuple[float, float],
    x0: Any,
    method: type[NativeSolver],
    samples: Samples | None,
    options: dict[str, Any],
) -> Any:
    """Return a solution that is integrated in the process in which the equations are compiled."""
    from scipy.optimize import OptimizeResult

    history, stiff = options.get("history"), options.get("stiff_problem")
    stiff_problem = stiff and replace(stiff(), explain=None)
    given = {name: value for name, value in options.items() if name not in ("history", "stiff_problem")}
    there = replace(problem, explain=None)
    times = None if samples is None else samples.times
    if samples is not None:
        states = samples.begin(problem.size)

    def receive(first: float, piece: np.ndarray) -> None:
        assert samples is not None
        begin, end = int(first), int(first) + len(piece)
        samples.count = end
        if samples.receive is None:
            states[begin:end] = piece
        else:
            samples.receive(begin, samples.times[begin:end], piece)

    result = problem.rhs.run(_solved, there, t_span, x0, method, times, given, stiff_problem, receive=receive)
    result["message"] = StopMessage(result["message"], Stop(result.pop("stop")))
    where = float(result["t"][-1]), result["y"][: problem.n, -1]
    if result["status"] < 0 and problem.explain is not None and (text := problem.explain(*where)):
        result["message"] = StopMessage(text, Stop.NOT_FINITE)
    longest, steps = result.pop("longest"), result.pop("history")
    if samples is not None:
        samples.longest = longest
    if history is not None:
        history[:] = [(float(t), str(name)) for t, name in steps]
    whole: Any = OptimizeResult  # SciPy's stubs do not know what solve_ivp puts into it
    return whole(t_events=None, y_events=None, sol=None, success=result["status"] >= 0, **result)


def _solved(
    problem: NativeProblem,
    t_span: tuple[float, float],
    x0: Any,
    method: type[NativeSolver],
    times: np.ndarray | None,
    options: dict[str, Any],
    stiff_problem: NativeProblem | None,
    send: Callable[[int, np.ndarray], None],
) -> dict[str, Any]:
    """Integrate, and send the states at some times piece by piece."""
    history: list[tuple[float, str]] = []
    if stiff_problem is not None:
        options |= {"stiff_problem": lambda: stiff_problem}
    if method is Automatic:
        options |= {"history": history}
    samples = None if times is None else Samples(times, lambda first, _, states: send(first, states))
    solution = integrate(problem, t_span, x0, method=method, samples=samples, **options)
    wanted = ("t", "y", "nfev", "njev", "nlu", "status")
    return {name: solution[name] for name in wanted} | {
        "message": str(solution.message),
        "stop": getattr(solution.message, "stop", Stop.OTHER).value,
        "longest": 0.0 if samples is None else samples.longest,
        "history": history,
    }


def _by_scipy(problem: NativeProblem, t_span: tuple[float, float], x0: Any, method: str, **options: Any) -> Any:
    from multibody.solvers.scipy_methods import IMPLICIT, solve_with_stops

    options["max_step"] = min(options.get("max_step", np.inf), problem.largest_step)
    if method in IMPLICIT and problem.tangent is not None and problem.directions is None:
        options.setdefault("jac", problem.jac)
    return solve_with_stops(problem.fun, t_span, problem.initial(x0), problem.table, problem.p, method, **options)


def _unused(t: float, y: np.ndarray) -> np.ndarray:
    """Stand in for the function that ``solve_ivp`` asks for; compiled methods take it from the problem."""
    raise RuntimeError("this right-hand side is in the problem")
