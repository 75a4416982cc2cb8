"""How every candidate effect would change the outputs: its force along the motion, carried through the machine.

A connection's effect is a force between two sides.  Its law is evaluated along the simulated motion at unit
strength, and the force is then sent through the exact linearisation of the machine along that motion.  Nothing has
to be compiled for it, and hundreds of candidates and shapes cost one integration.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.blocks import Candidate, Residual, Sensitivities
from discrepancy.built_in import Plan, built_in_columns
from discrepancy.catalogue import Entry
from discrepancy.effects import Effect
from discrepancy.from_scan import DIFFERENCE, differs_from
from discrepancy.kinds import MotionRange
from discrepancy.law_force import MOTION, law_force
from discrepancy.secants import far_away, secant_columns, takes_secants
from estimation.experiment import Experiment, Push, SensorError
from estimation.push_response import forget, response_of, worth_it
from multibody.errors import ModelError
from multibody.side_by_side import cores, side_by_side

if TYPE_CHECKING:
    from discrepancy.stage import Stage
    from estimation.calibrate import Calibration
    from estimation.signals import Preparation
    from multibody.system import System

__all__ = ["Confrontation", "candidate_columns", "cannot_be_built"]


@dataclass(frozen=True, eq=False)
class Confrontation:
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
    """

    system: System
    slim: System
    calibration: Calibration
    sensors: tuple[SensorError, ...]
    preparation: Preparation
    p: np.ndarray
    noise: Mapping[str, float] = field(default_factory=dict)
    _cache: dict[str, Any] = field(default_factory=dict, repr=False)

    @classmethod
    def of_stage(cls, stage: Stage, preparation: Preparation) -> Confrontation:
        """Return a stage's machine beside its identification records; what was worked out for it before is kept."""
        key = ("facts", preparation)
        if key not in stage.worked_out:
            stage.worked_out[key] = cls(
                stage.system, stage.slim, stage.identify, stage.sensors, preparation, stage.p, stage.noise
            )
        return stage.worked_out[key]

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
        """Return a block of an experiment weighed down where the noise of its recorded inputs acts."""
        from discrepancy.input_noise import shaping_of

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
            from multibody.simulate import simulate

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

    def residual(self) -> Residual:
        """Return measured minus modelled outputs at the calibrated values, prepared for the scan."""
        if "residual" in self._cache:
            return self._cache["residual"]
        blocks = []
        for i, experiment in enumerate(self.experiments):
            y = experiment.simulate(self.slim, self.p, self.start(i), self.sensors)
            own = self.calibration.fits[i].own
            for c, name in enumerate(experiment.outputs):
                y[:, c] += own.get(f"offset of {name}", 0.0)
            blocks.append(self.shaped(i, experiment.measured - y))
        time = self.experiments[0].time
        self._cache["residual"] = Residual(blocks, float(np.median(np.diff(time))), self.experiments[0].outputs)
        return self._cache["residual"]

    def sensitivities(self) -> Sensitivities:
        """Return the derivatives by what calibration may move, and by each record's own unknowns."""
        if "sensitivities" in self._cache:
            return self._cache["sensitivities"]
        parameters = [p for p in self.calibration.parameters if p.name not in self.calibration.not_excited]
        blocks, nuisance = [], []
        k = len(parameters)
        for i, experiment in enumerate(self.experiments):
            dy = experiment.respond(
                self.slim,
                self.p,
                self.start(i),
                parameters=[p.name for p in parameters],
                states=experiment.free,
                sensors=self.sensors,
            ).derivatives
            blocks.append(self.shaped(i, dy[:, :, :k]))
            own = [dy[:, :, k:]]
            for name in experiment.offsets:
                one = np.zeros((dy.shape[0], dy.shape[1], 1))
                one[:, experiment.outputs.index(name)] = 1.0
                own.append(one)
            stacked = np.concatenate(own, axis=2)
            nuisance.append(self.shaped(i, stacked) if stacked.shape[2] else None)
        values = np.array([self.calibration[p.name] for p in parameters])
        prior = np.array([p.std for p in parameters])
        offset = np.where(np.isfinite(prior), np.array([p.value for p in parameters]) - values, 0.0)
        self._cache["sensitivities"] = Sensitivities([p.name for p in parameters], blocks, prior, offset, nuisance)
        return self._cache["sensitivities"]

    def range_of(self, entry: Entry) -> MotionRange:
        """Return how far and fast a connection moved."""
        assert entry.place is not None
        names = entry.place.motion_names()
        runs = [self.motions(i) for i in range(len(self.experiments))]
        x = np.concatenate([r[f"place.{entry.where}.{names[0][0]}"] for r in runs])
        v = np.concatenate([r[f"place.{entry.where}.{names[1][0]}"] for r in runs])
        scale = self.p[self.system.index("parameter", entry.stiffness)] if entry.stiffness else 0.0
        return MotionRange(
            float(x.min()),
            float(x.max()),
            float(np.quantile(np.abs(v), 0.95)),
            entry.place.domain == "rotation",
            float(scale),
        )


def _small_strength(motion: MotionRange) -> float:
    """A strength at which a creep that is not linear in it is looked at: small, but visible."""
    return 0.01 / max(motion.scale, 1e-300)


def candidate_columns(
    facts: Confrontation, entries: Sequence[Entry], progress: Any = None, effects: Sequence[Effect] = ()
) -> tuple[list[Candidate], list[tuple[Entry, str]]]:
    """Return the candidates with their columns, and the entries that these records cannot speak about.

    Parameters
    ----------
    facts : Confrontation
    entries : sequence of Entry
    progress : callable, optional
        Gets a line of text now and then.
    effects : sequence of Effect
        What has been added to the model: of a richer law of one of them only what is new is a candidate.
    """
    refused: list[tuple[Entry, str]] = []
    plans: list[Plan] = []
    for entry in entries:
        if entry.kind.at == "connection":
            motion = facts.range_of(entry)
            if motion.speed <= 0.0 or motion.half < 1e-12:
                refused.append((entry, "this connection does not move in these records"))
                continue
            if entry.load and (why := _no_model(facts, entry)):
                refused.append((entry, why))
                continue
            plans.append((entry, entry.kind.shape_grid(motion), list(entry.kind.strengths)))
        elif entry.kind.component_shapes is not None:
            owner, ending = entry.kind.owner_of(entry.where)
            part = facts.system.model.components[owner]
            plans.append((entry, entry.kind.component_shapes(part, ending), list(entry.kind.strengths)))
        else:
            plans.append((entry, [{}], list(entry.kind.strengths)))
    columns = _all_columns(facts, plans, progress)
    found: list[Candidate] = []
    far = far_away(facts)
    for entry, shapes, strengths in plans:
        cols = [columns[entry.name, k] for k in range(len(shapes))]
        if far and takes_secants(entry):
            if progress is not None:
                progress(f"simulate {entry.name} at strengths that matter: the model is far from the machine")
            bent = secant_columns(facts, entry, shapes)
            shapes, cols = [*shapes, *(s for s, _ in bent)], [*cols, *(c for _, c in bent)]
        quiet = [not any(np.any(b) for b in shape) for shape in cols]
        if all(quiet):
            refused.append((entry, "it would not change any measured output of these records"))
            continue
        kept = [k for k, q in enumerate(quiet) if not q]
        one_sided = entry.kind.one_sided
        if differs_from(effects, entry.kind, entry.where):
            cols = [[c[:, :, :1] - c[:, :, 1:] for c in shape] for shape in cols]
            strengths, one_sided = [DIFFERENCE], False
        found.append(
            Candidate(
                entry.kind.name,
                entry.where,
                tuple(tuple(cols[k]) for k in kept),
                tuple(shapes[k] for k in kept),
                one_sided=one_sided,
                amplitudes=tuple(strengths),
                info={"entry": entry},
            )
        )
    return found, refused


def _all_columns(facts: Confrontation, plans: Sequence[Plan], progress: Any) -> dict[tuple[str, int], list[np.ndarray]]:
    """Return the columns of every candidate, record by record, side by side."""
    def of(i: int) -> dict[tuple[str, int], np.ndarray]:
        if progress is not None:
            progress(f"sensitivities of {len(plans)} candidates on {facts.experiments[i].name}")
        return _record_columns(facts, i, plans)

    count = len(facts.experiments)
    first = of(0)  # what it compiles and builds serves the others
    found = [first, *side_by_side(of, range(1, count))]
    return {key: [each[key] for each in found] for key in first}


def cannot_be_built(error: ModelError) -> str:
    """Say in a sentence why a model cannot take an effect."""
    return f"the model with it cannot be built: {'; '.join(error.faults)}"


def _no_model(facts: Confrontation, entry: Entry) -> str:
    """Return why the model cannot take an effect that needs a load, or an empty text.

    Where the load is itself worked out from the force that is asked for (a given motion needs it), the two would
    depend on each other at the same instant.
    """
    assert entry.place is not None
    effect = Effect.at_place(entry.kind.name, entry.place, load=entry.load, number=99)
    try:
        effect.added_to(facts.system.model).build(probes=True)
    except ModelError as error:
        return cannot_be_built(error)
    return ""


def _record_columns(
    facts: Confrontation,
    index: int,
    plans: Sequence[Plan],
) -> dict[tuple[str, int], np.ndarray]:
    """Return one record's columns of every candidate and shape."""
    experiment = facts.experiments[index]
    time = np.array(experiment.record.time)
    run = facts.motions(index)
    pushes: list[Push] = []
    wanted: list[tuple[tuple[str, int], int]] = []
    sensors: dict[tuple[str, int], np.ndarray] = {}
    built_in: list[Plan] = []
    for entry, shapes, strengths in plans:
        if entry.kind.at == "connection":
            forces = _forces(facts, entry, run, time, shapes, strengths)
            for k, group in enumerate(forces):
                for force in group:
                    wanted.append(((entry.name, k), len(pushes)))
                    pushes.append(Push(f"probe.{entry.where}", force))
        elif entry.kind.at == "input":
            u = experiment.record.signals[entry.where].values
            shape = {"offset": np.ones_like(time), "gain": u, "delay": -np.gradient(u, time)}[entry.kind.law]
            wanted.append(((entry.name, 0), len(pushes)))
            pushes.append(Push(entry.where, shape))
        elif entry.kind.at == "parameter":
            built_in.append((entry, shapes, strengths))
        else:
            sensors[entry.name, 0] = _sensor_column(experiment, run, time, entry)
    parts: dict[tuple[str, int], list[np.ndarray]] = {}
    batch = 192  # limits memory
    start = facts.start(index)
    if worth_it(facts.slim, pushes):  # for all batches at once
        response_of(experiment, facts.slim, facts.p, start, pushes)
    for first in range(0, len(pushes), batch):
        part = pushes[first : first + batch]
        dy = experiment.respond(
            facts.slim, facts.p, start, pushes=part, sensors=facts.sensors, batch=batch, workers=cores()
        ).derivatives
        for key, k in wanted:
            if first <= k < first + batch:
                parts.setdefault(key, []).append(dy[:, :, k - first])
    forget(experiment)
    columns = {key: np.stack(group, axis=2) for key, group in parts.items()}
    columns |= built_in_columns(facts, index, built_in) | sensors
    return {key: facts.shaped(index, column) for key, column in columns.items()}


def _forces(
    facts: Confrontation,
    entry: Entry,
    run: dict[str, np.ndarray],
    time: np.ndarray,
    shapes: list[dict[str, float]],
    strengths: list[str],
) -> list[list[np.ndarray]]:
    assert entry.place is not None
    names = [n for n, _ in entry.place.motion_names()]
    motion = {
        general: run[f"place.{entry.where}.{own}"]
        for general, own in zip(MOTION, names, strict=True)
        if f"place.{entry.where}.{own}" in run
    }
    if entry.load:
        motion["load"] = run[entry.load]
    found = []
    for full in shapes:
        group = []
        shape = {k: v for k, v in full.items() if k != "secant"}
        for name in strengths:
            size = 1.0 if entry.kind.linear else full.get("secant", 0.0)
            size = size or _small_strength(facts.range_of(entry))
            strength = {n: (size if n == name else 0.0) for n in strengths}
            group.append(law_force(entry.kind, time, motion, shape, strength) / size)
        found.append(group)
    return found


def _sensor_column(experiment: Experiment, run: dict[str, np.ndarray], time: np.ndarray, entry: Entry) -> np.ndarray:
    y = run[entry.where]
    shape = {"offset": np.ones_like(time), "gain": y, "drift": time - time[0], "delay": -np.gradient(y, time)}[
        entry.kind.law
    ]
    full = np.zeros((time.size, len(experiment.outputs)))
    full[:, experiment.outputs.index(entry.where)] = shape
    return experiment.preparation.apply(time, full)[1][:, :, None]
