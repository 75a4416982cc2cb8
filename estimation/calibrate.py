"""Calibration: uncertain parameters moved, within their priors and bounds, until the model follows the records."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from estimation.correlation import correlation_time, cut_rows
from estimation.experiment import Experiment, Response, SensorError
from estimation.intervals import block_sandwich
from estimation.least_squares import solve

if TYPE_CHECKING:
    import pandas

    from multibody.system import System

T = TypeVar("T")

__all__ = ["Calibration", "Fit", "UncertainParameter", "calibrate", "evaluate"]


@dataclass(frozen=True)
class UncertainParameter:
    """A parameter that calibration may move.

    Parameters
    ----------
    name : str
        Model parameter, or ``sensor.<output>.<offset|gain|drift|delay>``.
    value : float
        Where it starts, and the mean of its prior, SI.
    std : float
        Standard deviation of its prior; infinite without one.
    min, max : float
        Bounds.
    unit : str
    """

    name: str
    value: float
    std: float = np.inf
    min: float = -np.inf
    max: float = np.inf
    unit: str = ""


@dataclass(frozen=True, eq=False)
class Fit:
    """One experiment at the fitted parameters.

    Parameters
    ----------
    experiment : Experiment
    response : Response
        Outputs, and derivatives by the parameters and then by this record's own unknowns.
    own : dict of str to float
        Start values and sensor offsets of this record.
    """

    experiment: Experiment
    response: Response
    own: dict[str, float]

    @property
    def residual(self) -> np.ndarray:
        """Measured minus modelled, shape (n, n_channels)."""
        return self.experiment.measured - self.response.outputs


@dataclass(frozen=True, eq=False)
class Calibration:
    """The result of a calibration.

    Parameters
    ----------
    parameters : tuple of UncertainParameter
        What was moved; those that the records do not excite stay where they were.
    values, std : ndarray, shape (k,)
        Fitted values and standard deviations (block sandwich: they hold for coloured residuals); the deviation of
        what ended at a bound or was not excited is infinite, because the records do not give it.
    degrees : int
        Degrees of freedom of the intervals (Student's t).
    fits : tuple of Fit
        Every experiment at the fitted values.
    scale : dict of str to float
        Standard deviation by which each output's residual was weighed.
    not_excited : tuple of str
        Parameters without influence on any output of these records.
    at_bound : tuple of str
        Parameters that ended at a bound.
    confounded : tuple of tuple of str
        Groups that the records cannot tell apart.
    message : str
        How the optimisation ended.
    """

    parameters: tuple[UncertainParameter, ...]
    values: np.ndarray
    std: np.ndarray
    degrees: int
    fits: tuple[Fit, ...]
    scale: dict[str, float]
    not_excited: tuple[str, ...] = ()
    at_bound: tuple[str, ...] = ()
    confounded: tuple[tuple[str, ...], ...] = ()
    message: str = ""
    evaluations: int = 0

    def __getitem__(self, name: str) -> float:
        for parameter, value in zip(self.parameters, self.values, strict=True):
            if parameter.name == name:
                return float(value)
        raise KeyError(f"'{name}' was not calibrated; calibrated: {', '.join(p.name for p in self.parameters)}")

    def std_of(self, name: str) -> float:
        """Return the standard deviation of a parameter."""
        return float(self.std[[p.name for p in self.parameters].index(name)])

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Return the confidence interval of a parameter."""
        from scipy.stats import t

        half = float(t.ppf(0.5 + level / 2, self.degrees)) * self.std_of(name)
        return self[name] - half, self[name] + half

    def to_dict(self) -> dict[str, float]:
        """Return the values by name."""
        return {p.name: float(v) for p, v in zip(self.parameters, self.values, strict=True)}

    def to_frame(self) -> pandas.DataFrame:
        """Return a table: start, value, standard deviation, unit and remarks."""
        import pandas

        rows = []
        for p, v, s in zip(self.parameters, self.values, self.std, strict=True):
            remarks = [w for w, names in (("not excited", self.not_excited), ("at its bound", self.at_bound)) if p.name in names]
            remarks += [f"confounded with {', '.join(n for n in g if n != p.name)}" for g in self.confounded if p.name in g]
            rows.append((p.value, v, s, p.unit, "; ".join(remarks)))
        return pandas.DataFrame(
            rows, columns=["start", "value", "std", "unit", "remark"],
            index=pandas.Index([p.name for p in self.parameters], name="parameter"))

    def __repr__(self) -> str:
        told = ", ".join(f"{p.name} = {v:.4g} ± {s:.2g} {p.unit}".rstrip()
                         for p, v, s in zip(self.parameters, self.values, self.std, strict=True))
        return f"Calibration({told or 'nothing to move'})"


@dataclass
class _Problem:
    """The stacked least-squares problem over parameters and every record's own unknowns."""

    system: System
    experiments: Sequence[Experiment]
    parameters: Sequence[UncertainParameter]
    sensors: Sequence[SensorError]
    base: np.ndarray
    scale: np.ndarray = field(default_factory=lambda: np.ones(0))
    evaluations: int = 0

    def __post_init__(self) -> None:
        self.k = len(self.parameters)
        self._ran = False
        self.own = [(e.free, e.offsets) for e in self.experiments]
        sizes = [len(f) + len(o) for f, o in self.own]
        self.first = self.k + np.concatenate([[0], np.cumsum(sizes)]).astype(int)

    def start(self, given: Sequence[float] | None, own: Sequence[np.ndarray] | None) -> np.ndarray:
        theta = [p.value for p in self.parameters] if given is None else [float(v) for v in given]
        for i, e in enumerate(self.experiments):
            if own is not None and own[i].size == len(e.free) + len(e.offsets):
                theta += own[i].tolist()
                continue
            x = e.start_vector(self.system)
            theta += [x[self.system.index("state", n)] for n in e.free] + [0.0] * len(e.offsets)
        return np.array(theta, dtype=float)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        low = np.full(self.first[-1], -np.inf)
        high = np.full(self.first[-1], np.inf)
        low[: self.k] = [p.min for p in self.parameters]
        high[: self.k] = [p.max for p in self.parameters]
        return low, high

    def respond(self, theta: np.ndarray, index: int, derivatives: bool) -> Response:
        """Simulate one experiment at a point; derivatives by parameters, then by its own unknowns."""
        experiment = self.experiments[index]
        p, sensors = self.base.copy(), {s.name: s for s in self.sensors}
        for parameter, value in zip(self.parameters, theta, strict=False):
            if parameter.name.startswith("sensor."):
                output, _, kind = parameter.name[7:].rpartition(".")
                sensors[parameter.name] = SensorError(output, kind, float(value))
            else:
                p[self.system.index("parameter", parameter.name)] = value
        x0 = experiment.start_vector(self.system)
        mine = theta[self.first[index] : self.first[index + 1]]
        for name, value in zip(experiment.free, mine, strict=False):
            x0[self.system.index("state", name)] = value
        wanted = [q.name for q in self.parameters] if derivatives else []
        states = experiment.free if derivatives else ()
        self.evaluations += 1
        found = experiment.respond(
            self.system, p, x0, parameters=wanted, states=states, sensors=tuple(sensors.values()))
        outputs = found.outputs.copy()
        extra = []
        for name, value in zip(experiment.offsets, mine[len(experiment.free) :], strict=True):
            c = experiment.outputs.index(name)
            outputs[:, c] += value
            one = np.zeros_like(outputs)
            one[:, c] = 1.0
            extra.append(one)
        dy = found.derivatives
        if derivatives and extra:
            dy = np.concatenate([dy, np.stack(extra, axis=2)], axis=2)
        return Response(outputs, dy)

    def respond_all(self, theta: np.ndarray, derivatives: bool) -> list[Response]:
        """Simulate every experiment, two at a time: the compiled loops leave the interpreter free."""
        count = len(self.experiments)
        if count < 2:
            return [self.respond(theta, i, derivatives) for i in range(count)]
        from concurrent.futures import ThreadPoolExecutor

        with ThreadPoolExecutor(min(count, os.cpu_count() or 1)) as pool:
            return list(pool.map(lambda i: self.respond(theta, i, derivatives), range(count)))

    def cost(self, theta: np.ndarray) -> float:
        """Return half the weighted sum of squares, priors included; infinite where a simulation fails."""
        from multibody.errors import SimulationError

        try:
            found = self.respond_all(theta, False)
        except SimulationError:
            if not self._ran:
                raise
            return np.inf
        self._ran = True
        parts = [((r.outputs - e.measured) / self.scale).ravel() for r, e in zip(found, self.experiments, strict=True)]
        return 0.5 * (sum(float(e @ e) for e in parts) + float(np.sum(self.prior_residual(theta) ** 2)))

    def prior_residual(self, theta: np.ndarray) -> np.ndarray:
        return np.array([(v - p.value) / p.std for p, v in zip(self.parameters, theta, strict=False) if np.isfinite(p.std)])

    def rows_of(self, moving: np.ndarray) -> Callable[[np.ndarray], Iterator[tuple[np.ndarray, np.ndarray]]]:
        """Return `rows` for what moves."""
        return lambda theta: self.rows(theta, moving)

    def rows(self, theta: np.ndarray, moving: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield blocks of the Jacobian by what moves, and of the residual."""
        from multibody.errors import SimulationError

        for i, (e, response) in enumerate(zip(self.experiments, self.respond_all(theta, True), strict=True)):
            jacobian = self._rows(response, i)[:, moving]
            if not np.all(np.isfinite(jacobian)) or np.max(np.abs(jacobian), initial=0.0) > 1e100:
                raise SimulationError(
                    f"'{self.system.name}' on record '{e.name}': the derivatives grow beyond all bounds; the machine "
                    "runs away from these inputs, so its windows must be shorter")
            yield jacobian, ((response.outputs - e.measured) / self.scale).ravel()
        with_prior = [k for k, p in enumerate(self.parameters) if np.isfinite(p.std)]
        prior = np.zeros((len(with_prior), theta.size))
        prior[np.arange(len(with_prior)), with_prior] = [1.0 / self.parameters[k].std for k in with_prior]
        yield prior[:, moving], self.prior_residual(theta)

    def _rows(self, response: Response, index: int) -> np.ndarray:
        dy = response.derivatives / self.scale[:, None]
        full = np.zeros((dy.shape[0] * dy.shape[1], self.first[-1]))
        flat = dy.reshape(full.shape[0], dy.shape[2])
        full[:, : self.k] = flat[:, : self.k]
        full[:, self.first[index] : self.first[index + 1]] = flat[:, self.k :]
        return full


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
    rounds: int = 3,
    max_evaluations: int = 40,
    progress: Callable[[str], None] | None = None,
) -> Calibration:
    """Fit uncertain parameters to records by full simulation.

    Each output is weighed by the size of its own residual (at least its noise), found in a few rounds, and by how
    long that residual remembers, so that a thousand correlated samples do not outweigh a prior.

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
        Parameter vector for everything that is not moved; default: the model's.
    start : sequence of float, optional
        Where to begin, if not at the priors' means.
    own : sequence of ndarray, optional
        Where to begin with each record's own unknowns.
    scale : mapping of str to float, optional
        Weigh each output by this (as in `Calibration.scale`) and fit once, less finely: a trial.
    rounds : int
        Rounds of weighing and fitting.
    max_evaluations : int
        Simulations of all records in a round, at most.
    progress : callable, optional
        Gets a line of text now and then.

    Raises
    ------
    SimulationError
        If the model cannot be simulated at its start values.
    """
    base = system.p if base is None else base
    problem = _Problem(system, experiments, list(parameters), sensors, base)
    outputs = experiments[0].outputs
    floor = np.array([(noise or {}).get(n, 0.0) for n in outputs])
    theta = problem.start(start, own)
    low, high = problem.bounds()
    theta = np.clip(theta, low, high)
    problem.scale = np.ones(len(outputs))
    first = problem.respond_all(theta, True)
    not_excited = _not_excited(problem, first)
    still = _still(problem, first)
    moving = np.array([k for k in range(theta.size) if k not in still], dtype=int)
    problem.scale = _weights(problem, first, floor) if scale is None else np.array([scale[n] for n in outputs])
    trial = scale is not None
    message = "nothing to move"
    for k in range((1 if trial else rounds) if moving.size else 0):
        here = theta.copy()

        def full(part: np.ndarray, here: np.ndarray = here) -> np.ndarray:
            whole = here.copy()
            whole[moving] = part
            return whole

        inside = theta[moving]
        solution = solve(
            _after(full, problem.cost), _after(full, problem.rows_of(moving)), inside,
            low[moving], high[moving], tolerance=1e-4 if trial else 1e-7, max_evaluations=max_evaluations)
        theta = full(solution.x)
        message = solution.message
        if trial:
            break
        responses = problem.respond_all(theta, False)
        weights = _weights(problem, responses, floor)
        if progress is not None:
            progress(f"calibration round {k + 1}: {solution.evaluations} simulations, cost {solution.cost:.4g}")
        settled = np.all(np.abs(weights / problem.scale - 1.0) < 0.05)
        problem.scale = weights
        if settled:
            break
    return _result(problem, theta, moving, low, high, not_excited, message)


def _after(first: Callable[[np.ndarray], np.ndarray], then: Callable[[np.ndarray], T]) -> Callable[[np.ndarray], T]:
    return lambda x: then(first(x))


def _weights(problem: _Problem, responses: Sequence[Response], floor: np.ndarray) -> np.ndarray:
    errors = [e.measured - r.outputs for e, r in zip(problem.experiments, responses, strict=True)]
    stacked = np.concatenate(errors)
    rms = np.sqrt(np.mean(stacked**2, axis=0))
    memory = np.array([np.mean([correlation_time(e[:, c]) for e in errors]) for c in range(stacked.shape[1])])
    spread = np.std(np.concatenate([e.measured for e in problem.experiments]), axis=0)
    return np.maximum(np.maximum(rms, floor), 1e-9 * np.maximum(spread, 1e-300)) * np.sqrt(memory)


def _still(problem: _Problem, responses: Sequence[Response]) -> set[int]:
    """Return the unknowns, of the model and of each record, that no output feels."""
    names = _not_excited(problem, responses)
    found = {k for k, p in enumerate(problem.parameters) if p.name in names}
    for i, r in enumerate(responses):
        size = np.max(np.abs(r.derivatives[:, :, problem.k :]), axis=(0, 1), initial=0.0)
        found |= {int(problem.first[i]) + j for j, s in enumerate(size) if s == 0.0}
    return found


def _not_excited(problem: _Problem, responses: Sequence[Response]) -> tuple[str, ...]:
    size = np.zeros(problem.k)
    spread = np.maximum(np.std(np.concatenate([e.measured for e in problem.experiments]), axis=0), 1e-300)
    for r in responses:
        size = np.maximum(size, np.max(np.abs(r.derivatives[:, :, : problem.k]) / spread[:, None], axis=(0, 1), initial=0.0))
    return tuple(p.name for p, s in zip(problem.parameters, size, strict=True) if s == 0.0)


def _result(
    problem: _Problem, theta: np.ndarray, moving: np.ndarray, low: np.ndarray, high: np.ndarray,
    not_excited: tuple[str, ...], message: str,
) -> Calibration:
    k = problem.k
    fits, rows, errors = [], [], []
    for i, (e, response) in enumerate(zip(problem.experiments, problem.respond_all(theta, True), strict=True)):
        names = [*e.free, *(f"offset of {n}" for n in e.offsets)]
        own = dict(zip(names, map(float, theta[problem.first[i] : problem.first[i + 1]]), strict=True))
        fits.append(Fit(e, response, own))
        rows.append(problem._rows(response, i)[:, moving])
        errors.append(((e.measured - response.outputs) / problem.scale).ravel())
    std = np.full(k, np.inf)
    degrees = 1
    confounded: tuple[tuple[str, ...], ...] = ()
    values = theta[:k].copy()
    at_bound = tuple(
        p.name for j, p in enumerate(problem.parameters)
        if _touches(values[j], low[j], p.value) or _touches(values[j], high[j], p.value))
    loose = np.array([j for j in moving if j >= k or problem.parameters[j].name not in at_bound], dtype=int)
    if loose.size:
        n_channels = len(problem.experiments[0].outputs)
        lengths = [r.shape[0] for r in rows]
        memory = max(
            correlation_time(f.residual[:, c]) for f in fits for c in range(n_channels))
        longest = max(lengths) // 2  # the sandwich needs two blocks, however long the residual remembers
        blocks = cut_rows(lengths, min(int(3 * memory) * n_channels, longest))
        prior = np.array([1.0 / problem.parameters[j].std ** 2 if j < k else 0.0 for j in loose])
        jacobian, error = np.vstack(rows)[:, np.searchsorted(moving, loose)], np.concatenate(errors)
        interval = block_sandwich([jacobian[b] for b in blocks], [error[b] for b in blocks], np.diag(prior))
        degrees = int(interval.dof)
        globals_ = loose[loose < k]
        std[globals_] = interval.std[: globals_.size]
        confounded = _confounded(problem, jacobian, prior, globals_)
    scale = dict(zip(problem.experiments[0].outputs, map(float, problem.scale), strict=True))
    return Calibration(
        tuple(problem.parameters), values, std, degrees, tuple(fits), scale, not_excited, at_bound, confounded, message,
        problem.evaluations)


def _touches(value: float, bound: float, size: float) -> bool:
    return bool(np.isfinite(bound)) and abs(value - bound) <= 1e-6 * max(1e-12, abs(bound), abs(size), abs(value))


def _confounded(
    problem: _Problem, jacobian: np.ndarray, prior: np.ndarray, columns: np.ndarray, limit: float = 1e-4
) -> tuple[tuple[str, ...], ...]:
    """Return groups of parameters whose effects nearly cancel: small singular values of the scaled sensitivities."""
    rest = jacobian[:, columns.size :]
    own = jacobian[:, : columns.size]
    if rest.shape[1]:
        q = np.linalg.qr(rest)[0]
        own = own - q @ (q.T @ own)
    stacked = np.vstack([own, np.diag(np.sqrt(prior[: columns.size]))])
    size = np.linalg.norm(stacked, axis=0)
    ok = size > 0
    if np.count_nonzero(ok) < 2:
        return ()
    _, s, vt = np.linalg.svd(stacked[:, ok] / size[ok], full_matrices=False)
    names = [problem.parameters[j].name for j in columns[ok]]
    groups = []
    for value, direction in zip(s, vt, strict=True):
        if value < limit**0.5 * s[0]:
            members = tuple(n for n, w in zip(names, direction, strict=True) if abs(w) > 0.2)
            if len(members) > 1:
                groups.append(members)
    return tuple(groups)


def evaluate(
    system: System, experiments: Sequence[Experiment], calibration: Calibration, *,
    noise: Mapping[str, float] | None = None, sensors: Sequence[SensorError] = (), base: np.ndarray | None = None,
) -> Calibration:
    """Lay a calibrated machine beside further records: parameters stay, only each record's own unknowns are fitted."""
    base = (system.p if base is None else base).copy()
    held = {s.name: s for s in sensors}
    for name, value in calibration.to_dict().items():
        if name.startswith("sensor."):
            output, _, kind = name[7:].rpartition(".")
            held[name] = SensorError(output, kind, value)
        else:
            base[system.index("parameter", name)] = value
    found = calibrate(system, experiments, (), noise=noise, sensors=tuple(held.values()), base=base, rounds=2)
    return found


