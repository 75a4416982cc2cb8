"""Sensitivities of the outputs to every candidate effect: its force along the motion, propagated through the machine.

A connection's effect is a force between two sides.  Its law is evaluated along the simulated motion at unit strength,
and the force is propagated by the exact linearisation of the machine along that motion.  Nothing has to be compiled for
it, and hundreds of candidates and shapes cost one integration.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from discrepancy.effects.catalogue import Entry
from discrepancy.effects.effect import Effect
from discrepancy.effects.from_scan_row import DIFFERENCE, differs_from
from discrepancy.effects.law_along_motion import MOTION, law_forces
from discrepancy.effects.shape_grids import MotionRange
from discrepancy.effects.signal_errors import signal_error
from discrepancy.sensitivities.built_in import Plan, integrated_sensitivities, parameter_perturbations
from discrepancy.sensitivities.finite_amplitude import (
    far_from_machine,
    finite_amplitude_sensitivities,
    takes_finite_amplitudes,
)
from discrepancy.sensitivities.linearised_problem import LinearisedProblem
from discrepancy.statistics.blocks import Candidate
from estimation.response.experiment import Experiment
from estimation.response.perturbations import InputPerturbation, Perturbation, cheaper_by_transition_matrices
from multibody.base.errors import ModelError
from multibody.base.parallel import available_cores, parallel_map
from multibody.base.progress import Step

__all__ = ["candidate_sensitivities", "cannot_be_built"]


def _small_strength(motion: MotionRange) -> float:
    """Return the strength at which a law that is not linear in it is evaluated: small, but visible."""
    return 0.01 / max(motion.scale, 1e-300)


def candidate_sensitivities(
    linearised: LinearisedProblem,
    entries: Sequence[Entry],
    progress: Any = None,
    effects: Sequence[Effect] = (),
    *,
    curves: bool = False,
) -> tuple[list[Candidate], list[tuple[Entry, str]]]:
    """Return the candidates with their sensitivities, and the entries that these records cannot test, with the reason.

    Parameters
    ----------
    linearised : LinearisedProblem
    entries : sequence of Entry
    progress : callable, optional
        Gets a line of text now and then.
    effects : sequence of Effect
        Effects that the model already has: of a richer law of one of them only the difference is a candidate.
    curves : bool
        Whether the free curves will be scanned as well: their sensitivities then come from the same state-transition
        matrices.
    """
    refused: list[tuple[Entry, str]] = []
    plans: list[Plan] = []
    closed: dict[tuple[str, str], str] = {}  # all laws that take one load at one place close the same loop, or none
    linearised.simulate()
    for entry in entries:
        if entry.kind.at == "connection":
            motion = linearised.motion_range(entry)
            if motion.speed <= 0.0 or motion.half < 1e-12:
                refused.append((entry, "this connection does not move in these records"))
                continue
            if entry.load:
                if (loop := (entry.where, entry.load)) not in closed:
                    closed[loop] = _no_model(linearised, entry)
                if closed[loop]:
                    refused.append((entry, closed[loop]))
                    continue
            plans.append((entry, entry.kind.shape_grid(motion), list(entry.kind.strengths)))
        elif why := _calibrated(linearised, entry):
            refused.append((entry, why))
        elif entry.kind.component_shapes is not None:
            owner, ending = entry.kind.owner_of(entry.where)
            part = linearised.system.model.components[owner]
            plans.append((entry, entry.kind.component_shapes(part, ending), list(entry.kind.strengths)))
        else:
            grid = entry.kind.shape_grid(MotionRange(0.0, 0.0, 0.0, step=linearised.step))
            plans.append((entry, grid, list(entry.kind.strengths)))
    sensitivities = _all_sensitivities(linearised, plans, progress, curves)
    candidates: list[Candidate] = []
    far = far_from_machine(linearised)
    for entry, shapes, strengths in plans:
        by_shape = [sensitivities[entry.name, k] for k in range(len(shapes))]
        if far and takes_finite_amplitudes(entry):
            if progress is not None:
                progress(f"simulate {entry.name} at strengths that matter: the model is far from the machine")
            finite = finite_amplitude_sensitivities(linearised, entry, shapes, by_shape)
            shapes, by_shape = [*shapes, *(s for s, _ in finite)], [*by_shape, *(c for _, c in finite)]
        zero = [not any(np.any(b) for b in blocks) for blocks in by_shape]
        if all(zero):
            refused.append((entry, "it would not change any measured output of these records"))
            continue
        kept = [k for k, without_effect in enumerate(zero) if not without_effect]
        one_sided = entry.kind.one_sided
        if differs_from(effects, entry.kind, entry.where):
            by_shape = [[b[:, :, :1] - b[:, :, 1:] for b in blocks] for blocks in by_shape]
            strengths, one_sided = [DIFFERENCE], False
        candidates.append(
            Candidate(
                kind=entry.kind.name,
                where=entry.where,
                sensitivities=tuple(tuple(by_shape[k]) for k in kept),
                shapes=tuple(shapes[k] for k in kept),
                one_sided=one_sided,
                strengths=tuple(strengths),
                info={"entry": entry},
            )
        )
    return candidates, refused


def _all_sensitivities(
    linearised: LinearisedProblem, plans: Sequence[Plan], progress: Any, curves: bool
) -> dict[tuple[str, int], list[np.ndarray]]:
    """Return the sensitivities to every candidate and shape, record by record, computed in parallel."""
    channels = [c.channel for c in linearised.free_curves()] if curves else []

    count = len(linearised.experiments)
    finished: list[int] = []

    def of(i: int) -> dict[tuple[str, int], np.ndarray]:
        if progress is not None:
            text = f"sensitivities of {len(plans)} candidates on {linearised.experiments[i].name}"
            progress(Step(text, len(finished), count))
        sensitivities = _record_sensitivities(linearised, i, plans, channels)
        finished.append(i)
        return sensitivities

    first = of(0)  # the others use what it compiles and builds
    records = [first, *parallel_map(of, range(1, count))]
    return {key: [record[key] for record in records] for key in first}


def cannot_be_built(error: ModelError) -> str:
    """Return in a sentence why an effect cannot be added to a model."""
    return f"the model with it cannot be built: {'; '.join(error.faults)}"


def _no_model(linearised: LinearisedProblem, entry: Entry) -> str:
    """Return why an effect that needs a load cannot be added to the model, or an empty text.

    Where the load itself depends on the effect's force (with a prescribed motion), the two would depend on each other
    at the same instant.
    """
    assert entry.place is not None
    effect = Effect.at_place(entry.kind.name, entry.place, load=entry.load, number=99)
    try:
        effect.added_to(linearised.system.model).build(probes=True)
    except ModelError as error:
        return cannot_be_built(error)
    return ""


def _calibrated(linearised: LinearisedProblem, entry: Entry) -> str:
    """Return why a parameter of the model that calibration moves is no candidate, or an empty text."""
    if entry.kind.at != "parameter":
        return ""
    owner, ending = entry.kind.owner_of(entry.where)
    names = [f"{owner}.{n}{ending}" for n in entry.kind.strengths]
    calibration = linearised.calibration
    moved = {q.name for q in calibration.parameters} - set(calibration.not_excited)
    return f"not identifiable: {' and '.join(names)} can imitate it entirely" if set(names) <= moved else ""


def _record_sensitivities(
    linearised: LinearisedProblem,
    index: int,
    plans: Sequence[Plan],
    curve_channels: Sequence[str] = (),
) -> dict[tuple[str, int], np.ndarray]:
    """Return one record's sensitivities to every candidate and shape.

    Those to free curves, if any, are kept by the linearised problem.
    """
    experiment = linearised.experiments[index]
    time = np.array(experiment.record.time)
    run = linearised.nominal_outputs(index)
    perturbations: list[Perturbation] = []
    positions: list[tuple[tuple[str, int], int]] = []
    sensors: dict[tuple[str, int], np.ndarray] = {}
    built_in: list[Plan] = []
    for entry, shapes, strengths in plans:
        if entry.kind.at == "connection":
            forces = _forces(linearised, entry, run, time, shapes, strengths)
            for k, group in enumerate(forces):
                for force in group:
                    positions.append(((entry.name, k), len(perturbations)))
                    perturbations.append(InputPerturbation(f"probe.{entry.where}", force))
        elif entry.kind.at in ("input", "signal"):
            recorded = entry.kind.at == "input"
            u = experiment.record.signals[entry.where].values if recorded else run[entry.where]
            for k, shape in enumerate(shapes):
                change = signal_error(entry.kind.law, time, u, shape.get("filter", 0.0))
                positions.append(((entry.name, k), len(perturbations)))
                perturbations.append(InputPerturbation(entry.where if recorded else f"probe.{entry.where}", change))
        elif entry.kind.at == "parameter":
            built_in.append((entry, shapes, strengths))
        else:
            sensors[entry.name, 0] = _sensor_sensitivity(experiment, run, time, entry)
    start = linearised.initial_state(index)
    carried, integrated = parameter_perturbations(built_in, linearised.slim)
    together = cheaper_by_transition_matrices(linearised.slim, [*perturbations, *(change for _, change in carried)])
    if together:
        positions += [(key, len(perturbations) + k) for k, (key, _) in enumerate(carried)]
        perturbations += [change for _, change in carried]
        experiment.perturbation_response(  # for all batches at once
            linearised.slim, linearised.p, start, perturbations, curve_channels
        )
    else:
        integrated = [*carried, *integrated]
    parts: dict[tuple[str, int], list[np.ndarray]] = {}
    batch = 192  # limits memory
    for first in range(0, len(perturbations), batch):
        part = perturbations[first : first + batch]
        dy = experiment.respond(
            linearised.slim,
            linearised.p,
            start,
            perturbations=part,
            sensors=linearised.sensors,
            batch=batch,
            workers=available_cores(),
        ).derivatives
        for key, k in positions:
            if first <= k < first + batch:
                parts.setdefault(key, []).append(dy[:, :, k - first])
    if together and curve_channels:
        linearised.free_curve_sensitivities(index)
    experiment.trim_cache()
    for key, sensitivity in integrated_sensitivities(linearised, index, integrated):
        parts.setdefault(key, []).append(sensitivity)
    unweighted = {key: np.stack(group, axis=2) for key, group in parts.items()} | sensors
    return {key: linearised.weighted(index, block) for key, block in unweighted.items()}


def _forces(
    linearised: LinearisedProblem,
    entry: Entry,
    run: dict[str, np.ndarray],
    time: np.ndarray,
    shapes: list[dict[str, float]],
    strengths: list[str],
) -> list[list[np.ndarray]]:
    """Return the forces per strength of a connection's effect along the motion, by shape and strength."""
    assert entry.place is not None
    names = [n for n, _ in entry.place.motion_names()]
    motion = {
        general: run[f"place.{entry.where}.{own}"]
        for general, own in zip(MOTION, names, strict=True)
        if f"place.{entry.where}.{own}" in run
    }
    if entry.load:
        motion["load"] = run[entry.load]
    sizes = [1.0 if entry.kind.linear else shape.get("amplitude", 0.0) for shape in shapes]
    sizes = [size or _small_strength(linearised.motion_range(entry)) for size in sizes]
    pairs = [
        ({k: v for k, v in shape.items() if k != "amplitude"}, {n: (size if n == name else 0.0) for n in strengths})
        for shape, size in zip(shapes, sizes, strict=True)
        for name in strengths
    ]
    forces = law_forces(entry.kind, time, motion, [s for s, _ in pairs], [s for _, s in pairs])
    grouped = forces.reshape(len(shapes), len(strengths), time.size)
    return [list(group / size) for group, size in zip(grouped, sizes, strict=True)]


def _sensor_sensitivity(
    experiment: Experiment, run: dict[str, np.ndarray], time: np.ndarray, entry: Entry
) -> np.ndarray:
    """Return the sensitivity to an error of a sensor."""
    y = run[entry.where]
    late = -np.gradient(y, time)
    shape = {"offset": np.ones_like(time), "gain": y, "drift": time - time[0], "delay": late, "lag": late}[
        entry.kind.law
    ]
    prepared = experiment.preparation.apply(time, shape)[1]
    full = np.zeros((prepared.size, len(experiment.outputs), 1))
    full[:, experiment.outputs.index(entry.where), 0] = prepared
    return full
