"""Values of parameters that nobody knows, found from the records: a coarse search over decades, then a fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.problem.problem import Problem
from discrepancy.questions.plausibility import shown_deviations
from discrepancy.residual.windows import sub_record
from estimation.response.experiment import Experiment
from multibody.base.errors import SimulationError
from multibody.base.progress import silent

if TYPE_CHECKING:
    from multibody.machine.model import System

__all__ = ["find_values"]

#: Decades to each side of a typical value that are searched; chosen: a kilogram stands for a gram and for a ton.
DECADES = 3.0
#: Points of the coarse search, and what is used of the records there: chosen for some seconds of computing.
POINTS, SAMPLES, RECORDS = 128, 1500, 3
#: Of its points, those from which short fits begin, the typical values among them, and the simulations of each.
BEST, ROUNDS = 16, 15
#: Of these fits, those that go on with more of the records, and the simulations of each at most.
CONTINUED_FITS, FINAL_SAMPLES, FINAL_ROUNDS = 3, 6000, 40
#: Evaluations of the equations for each sample after which a trial is given up: its values make the model stiff.
EFFORT = 100
#: Deviation, as share of the value, above which a parameter is not shown by the records; chosen: a third leaves open
#: whether it is twice as large.
UNSHOWN = 0.33


@dataclass(frozen=True)
class FoundValues:
    """What the records say of the parameters.

    Parameters
    ----------
    values : dict of str to float
        SI, of every parameter that was looked for.
    unshown : tuple of str
        Those that the records cannot show beside the others; they keep a value of the right size.
    """

    values: dict[str, float]
    unshown: tuple[str, ...]


def find_values(problem: Problem, progress: Callable[[str], None] = silent) -> FoundValues:
    """Find values of the uncertain parameters from the records for identification.

    Parameters
    ----------
    problem : Problem
        Its uncertain parameters have typical values and no priors.
    progress : callable
        Takes a line of text for each step.

    Raises
    ------
    SimulationError
        If the model cannot be simulated with any values that were tried.
    """
    if not problem.uncertain:
        return FoundValues({}, ())
    progress("search the size of every parameter")
    ends = _fits(problem, _coarse(problem), SAMPLES, ROUNDS)
    values = _best(problem, [theta for theta, _ in ends[:CONTINUED_FITS]])
    unshown: list[str] = []
    while True:
        problem = _with_values(problem, values)
        left_out = _least_shown(problem)
        if left_out is None:
            break
        unshown.append(left_out)
        problem = replace(
            problem,
            model=problem.model.with_values({left_out: values[left_out]}),
            uncertain=tuple(q for q in problem.uncertain if q.name != left_out),
        )
    if unshown and problem.uncertain:
        progress("fit the parameters")
        values |= _best(problem, [[values[q.name] for q in problem.uncertain]])
    return FoundValues(values, tuple(unshown))


def _with_values(problem: Problem, values: dict[str, float]) -> Problem:
    return replace(problem, uncertain=tuple(replace(q, value=values[q.name]) for q in problem.uncertain))


def _least_shown(problem: Problem) -> str | None:
    """Return the parameter that the records show least, where that is not enough."""
    system = problem.model.build(outputs=problem.identify[0].outputs)
    p = system.parameter_vector({q.name: q.value for q in problem.uncertain})
    names = [q.name for q in problem.uncertain]
    try:
        responses = [e.respond_with_own(system, p, {}, parameters=names) for e in problem.identify[:RECORDS]]
    except SimulationError:
        return None
    shown = shown_deviations(problem, responses)
    unfelt = [n for n in names if not shown[n][1]]
    if unfelt:
        return unfelt[-1]
    share = {q.name: shown[q.name][0] / max(abs(q.value), 1e-300) for q in problem.uncertain}
    # of parameters that only act together, the last one named is the one to fix
    worst = max(reversed(names), key=lambda n: share[n])
    return worst if share[worst] > UNSHOWN else None


def _coarse(problem: Problem) -> list[list[float]]:
    """Return the best points of a search over decades, by what is left of the outputs beside their own size."""
    from scipy.stats import qmc

    system = problem.model.build(outputs=problem.identify[0].outputs)
    experiments = [_short(e, SAMPLES) for e in problem.identify[:RECORDS]]
    sizes = [_sizes(e) for e in experiments]
    centre = np.log10([max(abs(q.value), 1e-12) for q in problem.uncertain])

    def cost(decades: np.ndarray) -> float:
        values = {q.name: float(10.0**d) for q, d in zip(problem.uncertain, decades, strict=True)}
        p = system.parameter_vector(values)
        try:
            return sum(_misfit(e, system, p, size) for e, size in zip(experiments, sizes, strict=True))
        except SimulationError:
            return np.inf

    cube = qmc.Sobol(centre.size, scramble=False).random(POINTS)
    points = [centre, *(centre + DECADES * (2.0 * row - 1.0) for row in cube)]
    costs = [cost(point) for point in points]
    order = [0, *(int(k) for k in np.argsort(costs) if k != 0)]
    return [[float(10.0**d) for d in points[k]] for k in order[:BEST] if np.isfinite(costs[k])] or [
        [float(10.0**d) for d in centre]
    ]


def _sizes(experiment: Experiment) -> np.ndarray:
    """Return the size of what each output does."""
    return np.maximum(experiment.measured.std(axis=0), 1e-12)


def _best(problem: Problem, starts: Sequence[Sequence[float]]) -> dict[str, float]:
    """Return the values to which the best of the fits from some starts leads."""
    values, _ = _fits(problem, starts, FINAL_SAMPLES, FINAL_ROUNDS)[0]
    return dict(zip((q.name for q in problem.uncertain), values, strict=True))


def _fits(
    problem: Problem, starts: Sequence[Sequence[float]], samples: int, rounds: int
) -> list[tuple[list[float], float]]:
    """Return the values of fits of logarithms from some starts, and their costs, the least first.

    Logarithms keep an inertia from becoming zero while another parameter still is far off.  Unknown start values of
    each record are fitted beside them.
    """
    from scipy.optimize import least_squares

    system = problem.model.build(outputs=problem.identify[0].outputs)
    experiments = [_short(e, samples) for e in problem.identify[:RECORDS]]
    names = [q.name for q in problem.uncertain]
    owns = [len(e.own_unknowns) for e in experiments]
    rows = sum(e.measured.size for e in experiments)

    def respond(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        p = system.parameter_vector({n: float(np.exp(v)) for n, v in zip(names, theta, strict=False)})
        left, slopes, row, column = np.empty(rows), np.zeros((rows, theta.size)), 0, len(names)
        for e, own in zip(experiments, owns, strict=True):
            size = _sizes(e)
            given = dict(zip(e.own_unknowns, theta[column : column + own], strict=True))
            try:
                response = e.respond_with_own(system, p, given, parameters=names)
            except SimulationError:
                return None
            part = slice(row, row + e.measured.size)
            left[part] = ((response.outputs - e.measured) / size).ravel()
            dy = (response.derivatives / size[:, None]).reshape(e.measured.size, -1)
            slopes[part, : len(names)] = dy[:, : len(names)] * np.exp(theta[: len(names)])
            slopes[part, column : column + own] = dy[:, len(names) :]
            row, column = row + e.measured.size, column + own
        return (left, slopes) if np.all(np.isfinite(left)) and np.all(np.isfinite(slopes)) else None

    def residuals(theta: np.ndarray) -> np.ndarray:
        response = respond(theta)
        return np.full(rows, 1e6) if response is None else response[0]

    def jacobian(theta: np.ndarray) -> np.ndarray:
        response = respond(theta)
        return np.zeros((rows, theta.size)) if response is None else response[1]

    begin = np.concatenate([_start_of(e, system) for e in experiments]) if sum(owns) else np.empty(0)
    ends = []
    for start in starts:
        theta = np.concatenate([np.log(start), begin])
        if respond(theta) is None:
            continue
        low, high = np.full(theta.size, -np.inf), np.full(theta.size, np.inf)
        reach = DECADES * np.log(10.0)
        low[: len(names)], high[: len(names)] = theta[: len(names)] - reach, theta[: len(names)] + reach
        ends.append(least_squares(residuals, theta, jacobian, (low, high), x_scale="jac", max_nfev=rounds))
    fits = [([float(np.exp(v)) for v in end.x[: len(names)]], float(end.cost)) for end in ends]
    return sorted(fits, key=lambda each: each[1]) or [([float(v) for v in starts[0]], np.inf)]


def _start_of(experiment: Experiment, system: System) -> np.ndarray:
    """Return where the fit of a record's own unknowns begins."""
    x0 = experiment.start_vector(system)
    states = [x0[system.index("state", n)] for n in experiment.free]
    return np.array([*states, *(0.0 for _ in range(len(experiment.own_unknowns) - len(states)))])


def _short(experiment: Experiment, samples: int) -> Experiment:
    record = experiment.record
    if record.time.size > samples:
        record = sub_record(record, slice(0, samples), record.name)
    return replace(experiment, record=record, max_evaluations=EFFORT * record.time.size)


def _misfit(experiment: Experiment, system: System, p: np.ndarray, size: np.ndarray) -> float:
    """Return the mean square of what is left, beside the best start values, by the size of each output."""
    response = experiment.respond_with_own(system, p, {})
    left = ((experiment.measured - response.outputs) / size).ravel()
    own = (response.derivatives / size[:, None]).reshape(left.size, -1)
    if own.shape[1] and np.all(np.isfinite(own)):
        scale = np.maximum(np.linalg.norm(own, axis=0), 1e-300)
        left = left - (own / scale) @ np.linalg.lstsq(own / scale, left, rcond=1e-9)[0]
    value = float(left @ left) / left.size
    return value if np.isfinite(value) else np.inf
