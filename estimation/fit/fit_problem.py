"""The least-squares problem of a calibration: all records stacked, priors and each record's own unknowns included."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from estimation.fit.calibration import UncertainParameter
from estimation.fit.least_squares import Piece
from estimation.response.experiment import Experiment, Response
from estimation.response.sensors import SensorError
from multibody.base.parallel import available_cores, parallel_map

if TYPE_CHECKING:
    from multibody.machine.model import System

__all__ = ["FitProblem"]


@dataclass(kw_only=True)
class FitProblem:
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
        self._responses: dict[bool, tuple[np.ndarray, list[Response]]] = {}
        sizes = [len(e.own_unknowns) for e in self.experiments]
        self.first = self.k + np.concatenate([[0], np.cumsum(sizes)]).astype(int)

    def of_record(self, index: int) -> FitProblem:
        """Return the problem of one record, which knows its response where this one has just been asked for it."""
        alone = replace(self, experiments=[self.experiments[index]], evaluations=0)
        mine = [*range(self.k), *range(self.first[index], self.first[index + 1])]
        alone._responses = {kind: (at[mine], [every[index]]) for kind, (at, every) in self._responses.items()}
        return alone

    def start(self, given: Sequence[float] | None, own: Sequence[np.ndarray] | None) -> np.ndarray:
        """Return the start values: those given, else the priors' means and the first samples of the sensors."""
        theta = [p.value for p in self.parameters] if given is None else [float(v) for v in given]
        for i, e in enumerate(self.experiments):
            if own is not None and own[i].size == len(e.own_unknowns):
                theta += own[i].tolist()
                continue
            x = e.start_vector(self.system)
            theta += [x[self.system.index("state", n)] for n in e.free]
            theta += [0.0] * (len(e.own_unknowns) - len(e.free))
        return np.array(theta, dtype=float)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the bounds of all unknowns; each record's own have none."""
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
        mine = theta[self.first[index] : self.first[index + 1]]
        self.evaluations += 1
        return experiment.respond_with_own(
            self.system,
            p,
            dict(zip(experiment.own_unknowns, mine, strict=True)),
            parameters=[q.name for q in self.parameters] if derivatives else [],
            sensors=tuple(sensors.values()),
            derivatives=derivatives,
            workers=available_cores(),
        )

    def respond_all(self, theta: np.ndarray, derivatives: bool) -> list[Response]:
        """Simulate every experiment in parallel; the last responses with and without derivatives are kept."""
        for kind in (True,) if derivatives else (True, False):
            point, responses = self._responses.get(kind, (None, []))
            if point is not None and np.array_equal(point, theta):
                return responses
        responses = parallel_map(lambda i: self.respond(theta, i, derivatives), range(len(self.experiments)))
        self._responses[derivatives] = (theta.copy(), responses)
        return responses

    def residuals(self, theta: np.ndarray) -> list[np.ndarray] | None:
        """Return the weighted residual of every experiment, then of the priors; None where a simulation fails."""
        from multibody.base.errors import SimulationError

        try:
            responses = self.respond_all(theta, False)
        except SimulationError:
            if not self._ran:
                raise
            return None
        self._ran = True
        return [
            *(
                ((r.outputs - e.measured) / self.scale).ravel()
                for r, e in zip(responses, self.experiments, strict=True)
            ),
            self.prior_residual(theta),
        ]

    def prior_residual(self, theta: np.ndarray) -> np.ndarray:
        """Return how far each parameter with a prior is from its mean, in standard deviations."""
        return np.array(
            [(v - p.value) / p.std for p, v in zip(self.parameters, theta, strict=False) if np.isfinite(p.std)]
        )

    def pieces(self, theta: np.ndarray, moving: np.ndarray) -> Iterator[Piece]:
        """Yield the rows with their Jacobians by the unknowns ``moving``: every experiment, then the priors."""
        from multibody.base.errors import SimulationError

        responses = self.respond_all(theta, True)
        self._ran = True
        for i, (e, response) in enumerate(zip(self.experiments, responses, strict=True)):
            jacobian, columns = self.weighted(response, i, moving)
            if not np.all(np.isfinite(jacobian)) or np.max(np.abs(jacobian), initial=0.0) > 1e100:
                raise SimulationError(
                    f"'{self.system.name}' on record '{e.name}': the derivatives grow beyond all bounds; the machine "
                    "runs away from these inputs, so its windows must be shorter"
                )
            yield Piece(jacobian, columns, ((response.outputs - e.measured) / self.scale).ravel())
        with_prior = [k for k, p in enumerate(self.parameters) if np.isfinite(p.std)]
        prior = np.zeros((len(with_prior), theta.size))
        prior[np.arange(len(with_prior)), with_prior] = [1.0 / self.parameters[k].std for k in with_prior]
        yield Piece(prior[:, moving], np.arange(moving.size), self.prior_residual(theta))

    def weighted(self, response: Response, index: int, moving: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return one record's derivatives by those of the unknowns ``moving`` that it depends on, and which these are.

        Each output is divided by its scale.
        """
        columns, picked = self.columns_of(index, moving)
        dy = response.derivatives[:, :, picked] / self.scale[:, None]
        return dy.reshape(dy.shape[0] * dy.shape[1], dy.shape[2]), columns

    def columns_of(self, index: int, moving: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return which of the unknowns ``moving`` a record depends on, and their columns in its derivatives."""
        first, end = self.first[index], self.first[index + 1]
        mine = (moving < self.k) | ((moving >= first) & (moving < end))
        picked = np.where(moving < self.k, moving, moving - first + self.k)[mine]
        return np.flatnonzero(mine), picked
