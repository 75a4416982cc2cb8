"""A calibrated machine beside its records, and what a search asks of the two again and again."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.effects.kinds import MotionRange
from discrepancy.statistics.blocks import Residual, Sensitivities
from discrepancy.statistics.whitened import plain_projection
from multibody.base.parallel import side_by_side

if TYPE_CHECKING:
    from discrepancy.effects.catalogue import Entry
    from discrepancy.stages.stage import Stage
    from discrepancy.statistics.low_rank_noise import Shaping
    from estimation.fit.calibrate import Calibration
    from estimation.response.experiment import Experiment, SensorError
    from estimation.signals.preparation import Preparation
    from multibody.system.system import System

__all__ = ["LinearisedProblem"]

KEPT = ("experiments", "motion", "shaping", "left", "derivatives", "range")  # what no weighing changes


@dataclass(frozen=True, eq=False)
class LinearisedProblem:
    """A calibrated machine beside the records that may be used to choose.

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
    disturbance : tuple of Shaping
        How each experiment's blocks are weighed down where an unknown force disturbs; empty: not at all.
    """

    system: System
    slim: System
    calibration: Calibration
    sensors: tuple[SensorError, ...]
    preparation: Preparation
    p: np.ndarray
    noise: Mapping[str, float] = field(default_factory=dict)
    disturbance: tuple[Shaping, ...] = ()
    _cache: dict[str, Any] = field(default_factory=dict, repr=False)

    @classmethod
    def of_stage(cls, stage: Stage, preparation: Preparation) -> LinearisedProblem:
        """Return a stage's machine beside its identification records; what was worked out for it before is kept."""
        key = ("facts", preparation)
        if key not in stage.worked_out:
            stage.worked_out[key] = cls(
                stage.system, stage.slim, stage.identify, stage.sensors, preparation, stage.p, stage.noise
            )
        return stage.worked_out[key]

    def weighed_down(self, disturbance: Sequence[Shaping]) -> LinearisedProblem:
        """Return the same with its blocks weighed down; what was worked out of them before stays."""
        kept = {k: v for k, v in self._cache.items() if k.startswith(KEPT)}
        return replace(self, disturbance=tuple(disturbance), _cache=kept)

    @property
    def experiments(self) -> list[Experiment]:
        """The experiments, prepared for the scan."""
        if "experiments" not in self._cache:
            self._cache["experiments"] = [
                f.experiment.with_preparation(self.preparation) for f in self.calibration.fits
            ]
        return self._cache["experiments"]

    def start(self, index: int) -> np.ndarray:
        """Return the fitted start state of an experiment."""
        fit = self.calibration.fits[index]
        x = fit.experiment.start_vector(self.system)
        for name in fit.experiment.free:
            x[self.system.index("state", name)] = fit.own[name]
        return x

    def shaped(self, index: int, block: np.ndarray) -> np.ndarray:
        """Return a block of an experiment weighed down where noise of its recorded inputs, or a disturbance, acts."""
        block = self._without_input_noise(index, block)
        return self.disturbance[index](block) if self.disturbance else block

    def _without_input_noise(self, index: int, block: np.ndarray) -> np.ndarray:
        from discrepancy.residual.input_noise import shaping_of

        experiment = self.experiments[index]
        if not experiment.input_noise:
            return block
        key = f"shaping {index}"
        if key not in self._cache:
            noise = np.array([self.noise.get(n, 0.0) for n in experiment.outputs])
            self._cache[key] = shaping_of(experiment, self.slim, self.p, self.start(index), noise, self.sensors)
        return self._cache[key](block)

    def motions(self, index: int) -> dict[str, np.ndarray]:
        """Return all outputs of the nominal run of an experiment on its full time grid, by name."""
        key = f"motion {index}"
        if key not in self._cache:
            from multibody.system.simulate import simulate

            experiment = self.experiments[index]
            run = simulate(
                self.system,
                (float(experiment.record.time[0]), float(experiment.record.time[-1])),
                inputs=experiment.table(self.system),
                parameters=self.p,
                initial=self.start(index),
                times=experiment.record.time,
                rtol=experiment.rtol,
                atol=experiment.rtol * 1e-3,
            )
            self._cache[key] = {n: run.outputs[:, k] for k, n in enumerate(self.system.output_names)}
        return self._cache[key]

    def simulate(self) -> None:
        """Run all experiments, side by side, for what the motions and the residual are asked about."""
        runs: list[Callable[[], object]] = [partial(self.motions, i) for i in range(len(self.experiments))]
        side_by_side(lambda run: run(), [self.residual, *runs])

    def residual(self) -> Residual:
        """Return measured minus modelled outputs at the calibrated values, prepared for the scan."""
        if "residual" not in self._cache:
            blocks = [self.shaped(i, block) for i, block in enumerate(self._left())]
            step = float(np.median(np.diff(self.experiments[0].time)))
            self._cache["residual"] = Residual(blocks, step, self.experiments[0].outputs, self.disturbance)
        return self._cache["residual"]

    def _left(self) -> list[np.ndarray]:
        if "left" not in self._cache:
            blocks = []
            for i, experiment in enumerate(self.experiments):
                y = experiment.simulate(self.slim, self.p, self.start(i), self.sensors)
                own = self.calibration.fits[i].own
                for c, name in enumerate(experiment.outputs):
                    y[:, c] += own.get(f"offset of {name}", 0.0)
                blocks.append(experiment.measured - y)
            self._cache["left"] = blocks
        return self._cache["left"]

    def sensitivities(self) -> Sensitivities:
        """Return the derivatives by what calibration may move, and by each record's own unknowns."""
        if "sensitivities" in self._cache:
            return self._cache["sensitivities"]
        parameters = [p for p in self.calibration.parameters if p.name not in self.calibration.not_excited]
        k = len(parameters)
        every = self._derivatives([p.name for p in parameters])
        blocks = [self.shaped(i, dy[:, :, :k]) for i, dy in enumerate(every)]
        nuisance = [self.shaped(i, dy[:, :, k:]) if dy.shape[2] > k else None for i, dy in enumerate(every)]
        values = np.array([self.calibration[p.name] for p in parameters])
        prior = np.array([p.std for p in parameters])
        offset = np.where(np.isfinite(prior), np.array([p.value for p in parameters]) - values, 0.0)
        self._cache["sensitivities"] = Sensitivities([p.name for p in parameters], blocks, prior, offset, nuisance)
        return self._cache["sensitivities"]

    def _derivatives(self, parameters: Sequence[str]) -> list[np.ndarray]:
        """Return the derivatives by parameters, free states of the start and offsets, of each experiment."""
        if "derivatives" not in self._cache:

            def of(i: int) -> np.ndarray:
                experiment = self.experiments[i]
                own = [
                    experiment.respond(
                        self.slim,
                        self.p,
                        self.start(i),
                        parameters=parameters,
                        states=experiment.free,
                        sensors=self.sensors,
                    ).derivatives
                ]
                for name in experiment.offsets:
                    one = np.zeros((*own[0].shape[:2], 1))
                    one[:, experiment.outputs.index(name)] = 1.0
                    own.append(one)
                return np.concatenate(own, axis=2)

            self._cache["derivatives"] = side_by_side(of, range(len(self.experiments)))
        return self._cache["derivatives"]

    def direction(self, blocks: Sequence[np.ndarray]) -> np.ndarray | None:
        """Return where a column, (n, n_channels, 1) of each record, points once it is free of calibration.

        Each channel is weighed by its root mean square.  A direction is a unit vector; None where nothing is left.
        """
        if "projection" not in self._cache:
            self._cache["projection"] = plain_projection(self.residual(), self.sensitivities())
        found = self._cache["projection"]
        column = found.remove(found.layout.stack(found.whitener, blocks))[:, 0]
        size = float(np.linalg.norm(column))
        return column / size if size > 0.0 else None

    def range_of(self, entry: Entry) -> MotionRange:
        """Return how far and fast a connection moved."""
        assert entry.place is not None
        key = f"range {entry.where}"
        if key not in self._cache:
            names = entry.place.motion_names()
            runs = [self.motions(i) for i in range(len(self.experiments))]
            x = np.concatenate([r[f"place.{entry.where}.{names[0][0]}"] for r in runs])
            v = np.concatenate([r[f"place.{entry.where}.{names[1][0]}"] for r in runs])
            self._cache[key] = float(x.min()), float(x.max()), float(np.quantile(np.abs(v), 0.95))
        scale = self.p[self.system.index("parameter", entry.stiffness)] if entry.stiffness else 0.0
        low, high, speed = self._cache[key]
        return MotionRange(low, high, speed, entry.place.domain == "rotation", float(scale))
