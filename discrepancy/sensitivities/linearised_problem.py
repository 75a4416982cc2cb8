"""The linearised problem of a fitted model: residual, sensitivities, motions and free curves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from discrepancy.effects.shape_grids import MotionRange
from discrepancy.residual.input_noise import input_noise_weighting
from discrepancy.sensitivities.free_curves import CURVE_POINTS, FreeCurves
from discrepancy.statistics.blocks import Residual, Sensitivities
from discrepancy.statistics.columns import columns_together, responses_together
from discrepancy.statistics.whitened import rms_projection
from estimation.response.perturbations import InputPerturbation, cheaper_by_transition_matrices
from multibody.base.memory import ArrayStore
from multibody.base.parallel import parallel_map
from multibody.system.simulate import simulate

if TYPE_CHECKING:
    from discrepancy.effects.catalogue import Entry
    from discrepancy.statistics.blocks import Weighting
    from discrepancy.statistics.low_rank_weighting import LowRankWeighting
    from estimation.fit.calibrate import Calibration
    from estimation.response.experiment import Experiment
    from estimation.response.sensors import SensorError
    from estimation.signals.preparation import Preparation
    from multibody.machine.model import System

__all__ = ["LinearisedProblem"]

Result = TypeVar("Result")


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearisedProblem:
    """A calibrated model linearised along the records that may be used to choose.

    Everything is computed on first use and kept here.  `weighted_by` returns a problem that shares what no weighting
    changes.

    Parameters
    ----------
    system : System
        Built with probes and with the places' motion among its outputs.
    slim : System
        The same with the measured outputs only, for the derivatives.
    calibration : Calibration
        Of the experiments in it.
    sensors : tuple of SensorError
        Errors of sensors that the model already has, at their calibrated values.
    preparation : Preparation
        For the scan: at least as coarse as that of the experiments.
    p : ndarray
        Parameter vector.
    noise : mapping of str to float
        Noise floor of each output, SI.
    weighting : tuple of Weighting
        Weight of each experiment's blocks where an unknown force disturbs the machine; empty: none.
    """

    system: System
    slim: System
    calibration: Calibration
    sensors: tuple[SensorError, ...]
    preparation: Preparation
    p: np.ndarray
    noise: Mapping[str, float] = field(default_factory=dict)
    weighting: tuple[Weighting, ...] = ()
    _unweighted: dict[Any, Any] = field(default_factory=dict, repr=False)
    _weighted: dict[Any, Any] = field(default_factory=dict, init=False, repr=False)
    _store: ArrayStore = field(default_factory=ArrayStore, init=False, repr=False)

    def weighted_by(self, weighting: Sequence[Weighting]) -> LinearisedProblem:
        """Return the same problem with other weights; what does not depend on them is shared."""
        return replace(self, weighting=tuple(weighting))

    def with_calibration(self, calibration: Calibration) -> LinearisedProblem:
        """Return the problem of the same model on the records of another calibration."""
        return replace(self, calibration=calibration, _unweighted={})

    # ---------------------------------------------------------------- runs

    @property
    def experiments(self) -> list[Experiment]:
        """The experiments, prepared for the scan."""
        fits = self.calibration.fits
        return _once(
            self._unweighted, "experiments", lambda: [f.experiment.with_preparation(self.preparation) for f in fits]
        )

    def initial_state(self, index: int) -> np.ndarray:
        """Return the fitted initial state of an experiment."""
        fit = self.calibration.fits[index]
        x = fit.experiment.start_vector(self.system)
        for name in fit.experiment.free:
            x[self.system.index("state", name)] = fit.own[name]
        return x

    def simulate(self) -> None:
        """Simulate all experiments in parallel, for the nominal outputs and the residual."""
        runs: list[Callable[[], object]] = [partial(self.nominal_outputs, i) for i in range(len(self.experiments))]
        parallel_map(lambda run: run(), [self.residual, *runs])

    def nominal_outputs(self, index: int) -> dict[str, np.ndarray]:
        """Return all outputs of the nominal run of an experiment on its full time grid, by name."""
        return _once(self._unweighted, ("outputs", index), lambda: self._run(index))

    def drop_runs(self) -> None:
        """Free the memory of nominal runs and matrices along them; they are computed again where they are needed."""
        for key in [k for k in self._unweighted if k == "free curves" or k[0] == "outputs"]:
            del self._unweighted[key]
        for experiment in self._unweighted.get("experiments", ()):
            experiment.drop_matrices()

    def _run(self, index: int) -> dict[str, np.ndarray]:
        experiment = self.experiments[index]
        run = simulate(
            self.system,
            (float(experiment.record.time[0]), float(experiment.record.time[-1])),
            inputs=experiment.table(self.system),
            parameters=self.p,
            initial=self.initial_state(index),
            times=experiment.record.time,
            rtol=experiment.rtol,
            atol=experiment.rtol * 1e-3,
        )
        return {n: run.outputs[:, k] for k, n in enumerate(self.system.output_names)}

    @property
    def step(self) -> float:
        """Time between the rows that the scan takes, s."""
        return float(np.median(np.diff(self.experiments[0].time)))

    def motion_range(self, entry: Entry) -> MotionRange:
        """Return how far and fast the connection of a catalogue entry moved."""
        place = entry.place
        assert place is not None
        low, high, speed = _once(self._unweighted, ("range", place.name), lambda: self._extent(entry))
        scale = self.p[self.system.index("parameter", entry.stiffness)] if entry.stiffness else 0.0
        times = [e.time for e in self.experiments]
        return MotionRange(
            low=low,
            high=high,
            speed=speed,
            turns=place.domain == "rotation",
            scale=float(scale),
            begin=float(times[0][0]),
            duration=float(max(t[-1] - t[0] for t in times)),
            step=self.step,
        )

    def _extent(self, entry: Entry) -> tuple[float, float, float]:
        assert entry.place is not None
        names = entry.place.motion_names()
        runs = [self.nominal_outputs(i) for i in range(len(self.experiments))]
        x = np.concatenate([r[f"place.{entry.place.name}.{names[0][0]}"] for r in runs])
        v = np.concatenate([r[f"place.{entry.place.name}.{names[1][0]}"] for r in runs])
        return float(x.min()), float(x.max()), float(np.quantile(np.abs(v), 0.95))

    # ---------------------------------------------------------------- residual and sensitivities

    def weighted(self, index: int, block: np.ndarray) -> np.ndarray:
        """Return a block of an experiment, weighted for the noise of its recorded inputs and for a disturbance."""
        block = self._weighted_for_input_noise(index, block)
        return self.weighting[index](block) if self.weighting else block

    def _weighted_for_input_noise(self, index: int, block: np.ndarray) -> np.ndarray:
        experiment = self.experiments[index]
        if not experiment.input_noise:
            return block

        def shaping() -> LowRankWeighting:
            noise = np.array([self.noise.get(n, 0.0) for n in experiment.outputs])
            return input_noise_weighting(experiment, self.slim, self.p, self.initial_state(index), noise, self.sensors)

        return _once(self._unweighted, ("shaping", index), shaping)(block)

    def residual(self) -> Residual:
        """Return measured minus modelled outputs at the calibrated values, prepared for the scan."""

        def weighted_residual() -> Residual:
            errors = _once(self._unweighted, "errors", self._errors)
            blocks = [self.weighted(i, block) for i, block in enumerate(errors)]
            step = float(np.median(np.diff(self.experiments[0].time)))
            return Residual(blocks, step, self.experiments[0].outputs, self.weighting)

        return _once(self._weighted, "residual", weighted_residual)

    def simulated(self, index: int) -> np.ndarray:
        """Return the outputs of an experiment at the calibrated values, prepared for the scan, (n, n_channels)."""

        def outputs() -> np.ndarray:
            own = self.calibration.fits[index].own
            response = self.experiments[index].respond_with_own(
                self.slim, self.p, own, sensors=self.sensors, derivatives=False
            )
            return response.outputs

        return _once(self._unweighted, ("simulated", index), outputs)

    def _errors(self) -> list[np.ndarray]:
        return [
            experiment.measured - self.simulated(i) + self._response_to_forces(i)
            for i, experiment in enumerate(self.experiments)
        ]

    def _response_to_forces(self, index: int) -> np.ndarray | float:
        """Return what the forces along which an experiment is linearised change, to first order, (n, n_channels).

        They are not known: the residual is that without them, as the linearised problem has it.
        """
        experiment = self.experiments[index]
        if not experiment.forces:
            return 0.0
        changed: np.ndarray = np.sum(
            experiment.respond(
                self.slim,
                self.p,
                self.initial_state(index),
                perturbations=[InputPerturbation(name, values) for name, values in experiment.forces.items()],
                sensors=self.sensors,
            ).derivatives,
            axis=2,
        )
        return changed

    def sensitivities(self) -> Sensitivities:
        """Return the derivatives by what calibration may move, and by each record's own unknowns."""
        return _once(self._weighted, "sensitivities", self._sensitivities)

    def _sensitivities(self) -> Sensitivities:
        parameters = [p for p in self.calibration.parameters if p.name not in self.calibration.not_excited]
        k = len(parameters)
        every = _once(self._unweighted, "derivatives", lambda: self._derivatives([p.name for p in parameters]))
        blocks = [self.weighted(i, dy[:, :, :k]) for i, dy in enumerate(every)]
        nuisance = [self.weighted(i, dy[:, :, k:]) if dy.shape[2] > k else None for i, dy in enumerate(every)]
        values = np.array([self.calibration[p.name] for p in parameters])
        prior = np.array([p.std for p in parameters])
        offset = np.where(np.isfinite(prior), np.array([p.value for p in parameters]) - values, 0.0)
        return Sensitivities(
            names=[p.name for p in parameters], blocks=blocks, prior_std=prior, prior_offset=offset, nuisance=nuisance
        )

    def _derivatives(self, parameters: Sequence[str]) -> list[np.ndarray]:
        """Return the derivatives by parameters, free initial states and offsets, of each experiment."""

        def of(i: int) -> np.ndarray:
            own = self.calibration.fits[i].own
            return (
                self.experiments[i]
                .respond_with_own(self.slim, self.p, own, parameters=parameters, sensors=self.sensors)
                .derivatives
            )

        return parallel_map(of, range(len(self.experiments)))

    def direction(self, sensitivity: Sequence[np.ndarray]) -> np.ndarray | None:
        """Return the direction of a sensitivity, (n, n_channels, 1) of each record, once it is free of calibration.

        Each channel is weighted by its root mean square.  A direction is a unit vector; None where nothing is left.
        """
        projection = _once(self._weighted, "projection", lambda: rms_projection(self.residual(), self.sensitivities()))
        left = projection.remove(projection.layout.stack(projection.whitener, sensitivity))[:, 0]
        size = float(np.linalg.norm(left))
        return left / size if size > 0.0 else None

    # ---------------------------------------------------------------- free curves

    def free_curves(self) -> list[FreeCurves]:
        """Return the free curves at all places that move."""

        def curves() -> list[FreeCurves]:
            runs = [self.nominal_outputs(i) for i in range(len(self.experiments))]
            times = [np.array(e.record.time) for e in self.experiments]
            at_places = (FreeCurves.at(place, times, runs) for place in self.system.places)
            return [c for c in at_places if c.ranges]

        return _once(self._unweighted, "free curves", curves)

    def free_curve_sensitivities(self, index: int) -> dict[str, list[int]]:
        """Return how the points of all free curves change the outputs of an experiment.

        For each place the numbers of arrays (n, n_channels, points) in `store`, one for each curve.  State-transition
        matrices that are kept with the experiment are used and stay there: see `Experiment.trim_cache`.
        """
        return _once(self._weighted, ("free curves", index), lambda: self._free_curve_sensitivities(index))

    @property
    def store(self) -> ArrayStore:
        """Where the sensitivities to free curves are kept."""
        return self._store

    def _free_curve_sensitivities(self, index: int) -> dict[str, list[int]]:
        experiment, start = self.experiments[index], self.initial_state(index)
        curves = self.free_curves()
        no_values = np.empty(0)
        every = [InputPerturbation(c.channel, no_values) for c in curves for _ in range(CURVE_POINTS * len(c.ranges))]
        carried = cheaper_by_transition_matrices(self.slim, every, np.size(experiment.record.time))
        if carried:  # for all places at once
            experiment.perturbation_response(self.slim, self.p, start, every)
        at_once = columns_together if carried else responses_together
        rows = np.size(experiment.record.time) * len(experiment.outputs)
        kept = {}
        for c in curves:
            numbers: list[int] = []
            together = at_once(rows, CURVE_POINTS * len(c.ranges)) // CURVE_POINTS or 1  # curves
            for first in range(0, len(c.ranges), together):
                group = c.perturbations(index, slice(first, first + together))
                changed = experiment.respond(self.slim, self.p, start, perturbations=group, sensors=self.sensors)
                blocks = self.weighted(index, changed.derivatives)
                points = range(0, blocks.shape[2], CURVE_POINTS)
                numbers += [self._store.put(blocks[:, :, k : k + CURVE_POINTS]) for k in points]
            kept[c.place.name] = numbers
        return kept


def _once(results: dict[Any, Any], key: Any, compute: Callable[[], Result]) -> Result:
    """Return a result that is kept, computing it first where it is not."""
    if key not in results:
        results[key] = compute()
    result: Result = results[key]
    return result
