"""Calibration: uncertain parameters fitted to records, within their priors and bounds, by full simulation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from estimation.fit.calibration import Calibration, Fit, UncertainParameter
from estimation.fit.elsewhere import better_place, log_size
from estimation.fit.fit_problem import FitProblem
from estimation.fit.intervals import block_sandwich
from estimation.fit.least_squares import AT_LIMIT, Piece, solve
from estimation.fit.weights import weights_of
from estimation.response.experiment import Experiment, Response
from estimation.response.sensors import SensorError
from estimation.signals.correlation import correlation_time, cut_rows
from multibody.base.parallel import parallel_map
from multibody.base.quantity_text import count_text

if TYPE_CHECKING:
    from multibody.machine.model import System

__all__ = ["Calibration", "Fit", "UncertainParameter", "calibrate", "evaluate", "simulated_at"]

#: Relative decrease of the weighted cost that a further step must predict, in the final round and in the others.  The
#: cost is of the order of the effective number of samples, so that the remaining decrease moves no parameter by more
#: than a few hundredths of its deviation.
FINAL_TOLERANCE, TRIAL_TOLERANCE = 1e-6, 1e-4
#: Simulations of all records in a round, at most: an ordinary fit takes ten, one along a curved valley (a preload that
#: both a stiffness and a start value make) a hundred.  A trial is stopped earlier: one of many.
EVALUATIONS, TRIAL_EVALUATIONS = 200, 20
#: Rounds of weighting and fitting, those of a trial, and the logarithm of the change of an output's weight from which
#: it takes another; chosen.
ROUNDS, TRIAL_ROUNDS, WEIGHT_CHANGE = 3, 4, 0.2
#: Relative change of the outputs' weights from one round to the next below which they have settled; chosen.
SETTLED = 0.05
#: How often a fit begins again where it sees smaller errors elsewhere, at most; chosen.
BEGUN_AGAIN = 3


def calibrate(
    system: System,
    experiments: Sequence[Experiment],
    parameters: Sequence[UncertainParameter],
    *,
    noise: Mapping[str, float] | None = None,
    sensors: Sequence[SensorError] = (),
    base: np.ndarray | None = None,
    start: Sequence[float] | None = None,
    own: Sequence[np.ndarray] | None = None,
    scale: Mapping[str, float] | None = None,
    rounds: int | None = None,
    max_evaluations: int | None = None,
    hold: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Calibration:
    """Fit uncertain parameters to records by full simulation.

    Each output is weighted by the size of its own residual (at least its noise), iterated in a few rounds, and by the
    correlation time of that residual, so that a thousand correlated samples do not outweigh a prior.  A fit that leaves
    more than noise looks elsewhere within the priors, and begins again where the error is smaller.

    Parameters
    ----------
    system : System
    experiments : sequence of Experiment
        Several records are fitted at once; each may have start values and offsets of its own.
    parameters : sequence of UncertainParameter
    noise : mapping of str to float, optional
        Standard deviation of the noise of outputs, SI.
    sensors : sequence of SensorError
        Known errors of sensors.
    base : ndarray, optional
        Values of all parameters that are not fitted; default: the model's.
    start : sequence of float, optional
        Start values, if not the priors' means.
    own : sequence of ndarray, optional
        Start values of each record's own unknowns.
    scale : mapping of str to float, optional
        Weight each output by this (as in `Calibration.scale`) and fit with a coarser tolerance: a trial without
        intervals (they are nan).  Where the outputs' residuals have changed much, it updates the weights and fits
        again.
    rounds : int, optional
        Rounds of weighting and fitting, at most; default: `ROUNDS`, for a trial `TRIAL_ROUNDS`.
    max_evaluations : int, optional
        Simulations of all records in a round, at most; default: `EVALUATIONS`, for a trial `TRIAL_EVALUATIONS`.
    hold : bool
        Keep the start values and the given ``scale``: the result of an earlier fit.
    progress : callable, optional
        Takes a line of text for each round.

    Raises
    ------
    SimulationError
        If the model cannot be simulated at its start values.
    """
    base = system.p if base is None else base
    problem = FitProblem(
        system=system, experiments=experiments, parameters=list(parameters), sensors=sensors, base=base
    )
    outputs = experiments[0].outputs
    floor = np.array([(noise or {}).get(n, 0.0) for n in outputs])
    theta = problem.start(start, own)
    low, high = problem.bounds()
    theta = np.clip(theta, low, high)
    problem.scale = np.ones(len(outputs))
    first = problem.respond_all(theta, True)
    not_excited = _not_excited(problem, first)
    insensitive = _insensitive(problem, first)
    moving = np.array([k for k in range(theta.size) if k not in insensitive], dtype=int)
    problem.scale = (
        weights_of(problem, first, floor, theta, moving) if scale is None else np.array([scale[n] for n in outputs])
    )
    trial = scale is not None and not hold
    message = "nothing to fit"
    if moving.size and not hold:
        rounds = rounds or (TRIAL_ROUNDS if trial else ROUNDS)
        most = max_evaluations or (TRIAL_EVALUATIONS if trial else EVALUATIONS)
        theta, message = _fitted(problem, theta, moving, floor, rounds, most, trial, progress)
        for _ in range(0 if trial else BEGUN_AGAIN):
            place = better_place(problem, theta, moving, floor)
            if place is None:
                break
            if progress is not None:
                progress("calibration begins again: the errors are smaller with a parameter farther away")
            weights = problem.scale
            problem.scale = weights_of(problem, problem.respond_all(place, True), floor, place, moving)
            there, ended = _fitted(problem, place, moving, floor, rounds, most, trial, progress)
            if log_size(problem, there, floor) >= log_size(problem, theta, floor):
                problem.scale = weights
                break
            theta, message = there, ended
    return _result(problem, theta, moving, low, high, not_excited, message, trial)


def _fitted(
    problem: FitProblem,
    theta: np.ndarray,
    moving: np.ndarray,
    floor: np.ndarray,
    rounds: int,
    most: int,
    trial: bool,
    progress: Callable[[str], None] | None,
) -> tuple[np.ndarray, str]:
    """Fit and weight the outputs in rounds; return where that ends, and how.

    Parameters
    ----------
    problem : FitProblem
        With the weights to begin with; those of the end are left in it.
    theta : ndarray, shape (k,)
        Where it begins.
    moving : ndarray of int
        The unknowns that are fitted.
    floor : ndarray, shape (n_channels,)
        Noise, SI.
    rounds, most : int
        Rounds, and simulations of all records in each, at most.
    trial : bool
    progress : callable or None
    """
    if not problem.parameters:
        return _fitted_one_by_one(problem, theta, moving, floor, rounds, most)
    low, high = problem.bounds()
    final = not trial and rounds == 1  # while the weights still change, an exact minimum is of no use
    message = ""
    pieces: list[Piece] = []
    for k in range(rounds):
        full = partial(_with_moved, theta, moving)
        solution = solve(
            lambda part, full=full: problem.residuals(full(part)),  # type: ignore[misc]
            lambda part, full=full: problem.pieces(full(part), moving),  # type: ignore[misc]
            theta[moving],
            low[moving],
            high[moving],
            tolerance=FINAL_TOLERANCE if final else TRIAL_TOLERANCE,
            max_evaluations=most,
            confirm=final,
            begin=pieces,
            keep=trial,
        )
        theta = full(solution.x)
        message = solution.message
        if trial and k + 1 == rounds:
            break
        weights = weights_of(problem, problem.respond_all(theta, not trial), floor, theta, moving)
        if trial:
            if np.all(np.abs(np.log(weights / problem.scale)) < WEIGHT_CHANGE):
                break
            pieces = _weighted_anew(solution.pieces, problem.scale / weights)
            problem.scale = weights
            continue
        if progress is not None:
            progress(
                f"calibration round {k + 1}: {count_text(solution.evaluations, 'simulation')}, "
                f"{solution.jacobians} with derivatives, cost {solution.cost:.4g}"
            )
        converged = bool(np.all(np.abs(weights / problem.scale - 1.0) < SETTLED))
        problem.scale = weights
        if final and converged:
            break
        final = converged or k + 2 >= rounds
    return theta, message


def _fitted_one_by_one(
    problem: FitProblem, theta: np.ndarray, moving: np.ndarray, floor: np.ndarray, rounds: int, most: int
) -> tuple[np.ndarray, str]:
    """Fit what is unknown of each record, where no parameter is fitted that the records share.

    Together they would take common steps, and one record that no step improves, as where dry friction holds it from
    its beginning, would keep all others where they are.
    """
    message = ""
    for _ in range(rounds):
        ends = parallel_map(
            partial(_own_unknowns_fitted, problem, theta, moving, most), range(len(problem.experiments))
        )
        theta = np.concatenate([own for own, _ in ends])
        message = next((m for _, m in ends if m == AT_LIMIT), ends[0][1])
        weights = weights_of(problem, problem.respond_all(theta, True), floor, theta, moving)
        settled = bool(np.all(np.abs(weights / problem.scale - 1.0) < SETTLED))
        problem.scale = weights
        if settled:
            break
    return theta, message


def _own_unknowns_fitted(
    problem: FitProblem, theta: np.ndarray, moving: np.ndarray, most: int, index: int
) -> tuple[np.ndarray, str]:
    """Return what is unknown of one record, fitted to that record alone, and how the fit has ended."""
    first, end = problem.first[index], problem.first[index + 1]
    mine = moving[(moving >= first) & (moving < end)] - first
    here = theta[first:end]
    if not mine.size:
        return here, "nothing to fit"
    alone = problem.of_record(index)
    low, high = alone.bounds()

    full = partial(_with_moved, here, mine)
    solution = solve(
        lambda part: alone.residuals(full(part)),
        lambda part: alone.pieces(full(part), mine),
        here[mine],
        low[mine],
        high[mine],
        tolerance=FINAL_TOLERANCE,
        max_evaluations=most,
    )
    problem.evaluations += alone.evaluations
    return full(solution.x), solution.message


def _with_moved(whole: np.ndarray, moving: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Return all unknowns, with other values of those that are fitted."""
    moved = whole.copy()
    moved[moving] = part
    return moved


def _weighted_anew(pieces: Sequence[Piece], factor: np.ndarray) -> list[Piece]:
    """Return the pieces of the records, and last that of the priors, with each output's rows times a factor."""

    def weighted(piece: Piece) -> Piece:
        factors = np.tile(factor, piece.residual.size // factor.size)
        return Piece(piece.jacobian * factors[:, None], piece.columns, piece.residual * factors)

    return [*map(weighted, pieces[:-1]), pieces[-1]]


def _insensitive(problem: FitProblem, responses: Sequence[Response]) -> set[int]:
    """Return the unknowns, of the model and of each record, that no output depends on."""
    names = _not_excited(problem, responses)
    unknowns = {k for k, p in enumerate(problem.parameters) if p.name in names}
    for i, r in enumerate(responses):
        size = np.max(np.abs(r.derivatives[:, :, problem.k :]), axis=(0, 1), initial=0.0)
        unknowns |= {int(problem.first[i]) + j for j, s in enumerate(size) if s == 0.0}
    return unknowns


def _not_excited(problem: FitProblem, responses: Sequence[Response]) -> tuple[str, ...]:
    size = np.zeros(problem.k)
    spread = np.maximum(np.std(np.concatenate([e.measured for e in problem.experiments]), axis=0), 1e-300)
    for r in responses:
        size = np.maximum(
            size, np.max(np.abs(r.derivatives[:, :, : problem.k]) / spread[:, None], axis=(0, 1), initial=0.0)
        )
    return tuple(p.name for p, s in zip(problem.parameters, size, strict=True) if s == 0.0)


def _result(
    problem: FitProblem,
    theta: np.ndarray,
    moving: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    not_excited: tuple[str, ...],
    message: str,
    trial: bool,
) -> Calibration:
    k = problem.k
    fits, errors = [], []
    slopes: list[tuple[np.ndarray, np.ndarray]] = []  # of each record, and by which of ``moving``
    lengths = [e.measured.size for e in problem.experiments]
    for i, (e, response) in enumerate(zip(problem.experiments, problem.respond_all(theta, not trial), strict=True)):
        own = dict(zip(e.own_unknowns, map(float, theta[problem.first[i] : problem.first[i + 1]]), strict=True))
        plain = Response(response.outputs, np.empty((*response.outputs.shape, 0)), response.evaluations)
        fits.append(Fit(e, plain, own))
        if not trial:
            slopes.append(problem.weighted(response, i, moving))
        errors.append(((e.measured - response.outputs) / problem.scale).ravel())
    std = np.full(k, np.nan if trial else np.inf)
    degrees = 1
    confounded: tuple[tuple[str, ...], ...] = ()
    values = theta[:k].copy()
    at_bound = tuple(
        p.name
        for j, p in enumerate(problem.parameters)
        if _touches(values[j], low[j], p.value) or _touches(values[j], high[j], p.value)
    )
    loose = np.array([j for j in moving if j >= k or problem.parameters[j].name not in at_bound], dtype=int)
    if loose.size and not trial:
        n_channels = len(problem.experiments[0].outputs)
        memory = max(correlation_time(f.residual[:, c]) for f in fits for c in range(n_channels))
        longest = max(lengths) // 2  # the sandwich needs two blocks, however long the correlation time
        blocks = cut_rows(lengths, min(int(3 * memory) * n_channels, longest))
        prior = np.array([1.0 / problem.parameters[j].std ** 2 if j < k else 0.0 for j in loose])
        error = np.concatenate(errors)
        if loose.size < moving.size:
            slopes = [
                (part[:, kept], np.searchsorted(loose, moving[columns[kept]]))
                for part, columns in slopes
                for kept in [np.isin(moving[columns], loose)]
            ]
        rows = [(int(b[0]), int(b[-1]) + 1) for b in blocks]  # that follow one another, none across two records
        begins = np.concatenate([[0], np.cumsum(lengths)])
        of = np.searchsorted(begins, [a for a, _ in rows], side="right") - 1
        interval = block_sandwich(
            [slopes[i][0][a - begins[i] : b - begins[i]] for i, (a, b) in zip(of, rows, strict=True)],
            [error[a:b] for a, b in rows],
            np.diag(prior),
            columns=[slopes[i][1] for i in of],
        )
        degrees = int(interval.dof)
        globals_ = loose[loose < k]
        std[globals_] = interval.std[: globals_.size]
        confounded = _confounded(problem, slopes, prior, globals_)
    scale = dict(zip(problem.experiments[0].outputs, map(float, problem.scale), strict=True))
    return Calibration(
        parameters=tuple(problem.parameters),
        values=values,
        std=std,
        degrees=degrees,
        fits=tuple(fits),
        scale=scale,
        not_excited=not_excited,
        at_bound=at_bound,
        confounded=confounded,
        message=message,
        evaluations=problem.evaluations,
    )


def _touches(value: float, bound: float, size: float) -> bool:
    return bool(np.isfinite(bound)) and abs(value - bound) <= 1e-6 * max(1e-12, abs(bound), abs(size), abs(value))


def _confounded(
    problem: FitProblem,
    slopes: Sequence[tuple[np.ndarray, np.ndarray]],
    prior: np.ndarray,
    columns: np.ndarray,
    limit: float = 1e-4,
) -> tuple[tuple[str, ...], ...]:
    """Return groups of parameters whose effects nearly cancel: small singular values of the scaled sensitivities."""
    n = columns.size
    own = np.zeros((n, n))
    for part, of in slopes:
        mine = of[of < n]
        normal = part.T @ part
        common, both, rest = (
            normal[: mine.size, : mine.size],
            normal[: mine.size, mine.size :],
            normal[mine.size :, mine.size :],
        )
        if rest.size:  # project out each record's own unknowns
            size = np.sqrt(np.maximum(np.diag(rest), 1e-300))
            common = common - (both / size) @ np.linalg.pinv(rest / np.outer(size, size), hermitian=True) @ (
                both.T / size[:, None]
            )
        own[np.ix_(mine, mine)] += common
    own = own + np.diag(prior[:n])
    size = np.sqrt(np.maximum(np.diag(own), 0.0))
    ok = size > 0
    if np.count_nonzero(ok) < 2:
        return ()
    square, directions = np.linalg.eigh(own[np.ix_(ok, ok)] / np.outer(size[ok], size[ok]))
    s, vt = np.sqrt(np.maximum(square[::-1], 0.0)), directions.T[::-1]
    names = [problem.parameters[j].name for j in columns[ok]]
    groups = []
    for value, direction in zip(s, vt, strict=True):
        if value < limit**0.5 * s[0]:
            members = tuple(n for n, w in zip(names, direction, strict=True) if abs(w) > 0.2)
            if len(members) > 1:
                groups.append(members)
    return tuple(groups)


def evaluate(
    system: System,
    experiments: Sequence[Experiment],
    calibration: Calibration,
    *,
    noise: Mapping[str, float] | None = None,
    sensors: Sequence[SensorError] = (),
    base: np.ndarray | None = None,
) -> Calibration:
    """Evaluate a calibrated machine on further records: only each record's own unknowns are fitted."""
    base = (system.p if base is None else base).copy()
    held = {s.name: s for s in sensors}
    for name, value in calibration.to_dict().items():
        if name.startswith("sensor."):
            output, _, kind = name[7:].rpartition(".")
            held[name] = SensorError(output, kind, value)
        else:
            base[system.index("parameter", name)] = value
    return calibrate(system, experiments, (), noise=noise, sensors=tuple(held.values()), base=base, rounds=2)


def simulated_at(
    system: System,
    experiments: Sequence[Experiment],
    parameters: Sequence[UncertainParameter],
    *,
    values: Sequence[float],
    own: Sequence[np.ndarray],
    scale: Mapping[str, float],
    not_excited: Sequence[str],
    sensors: Sequence[SensorError] = (),
    base: np.ndarray | None = None,
) -> Calibration:
    """Simulate the records at values that were found elsewhere, without intervals: nothing is differentiated.

    Parameters
    ----------
    system, experiments, parameters, sensors, base
        As of `calibrate`.
    values : sequence of float
        Of the parameters.
    own : sequence of ndarray
        Each record's own unknowns.
    scale : mapping of str to float
        Of the outputs, as in `Calibration.scale`.
    not_excited : sequence of str
        Parameters that no output depends on, as is known from an earlier fit.
    """
    base = system.p if base is None else base
    problem = FitProblem(
        system=system, experiments=experiments, parameters=list(parameters), sensors=sensors, base=base
    )
    low, high = problem.bounds()
    theta = np.clip(problem.start(values, own), low, high)
    problem.scale = np.array([scale[n] for n in experiments[0].outputs])
    nothing = np.empty(0, dtype=int)
    return _result(problem, theta, nothing, low, high, tuple(not_excited), "nothing to fit", trial=True)
