"""How every candidate effect would change the outputs: its force along the motion, carried through the machine.

A connection's effect is a force between two sides.  Its law is evaluated along the simulated motion at unit
strength, and the force is then sent through the exact linearisation of the machine along that motion.  Nothing has
to be compiled for it, and hundreds of candidates and shapes cost one integration.
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
from discrepancy.sensitivities.built_in import Plan, changes_of, integrated_sensitivities
from discrepancy.sensitivities.finite_amplitude import far_away, finite_amplitude_sensitivities, takes_finite_amplitudes
from discrepancy.sensitivities.linearised_problem import LinearisedProblem
from discrepancy.statistics.blocks import Candidate
from estimation.response.experiment import Experiment
from estimation.response.perturbations import InputPerturbation, Perturbation, cheaper_by_transition_matrices
from multibody.base.errors import ModelError
from multibody.base.parallel import available_cores, parallel_map

__all__ = ["candidate_sensitivities", "cannot_be_built"]

STILL = 1e-12  # share of its value by which an input that is held may vary


def _small_strength(motion: MotionRange) -> float:
    """A strength at which a creep that is not linear in it is looked at: small, but visible."""
    return 0.01 / max(motion.scale, 1e-300)


def candidate_sensitivities(
    linearised: LinearisedProblem,
    entries: Sequence[Entry],
    progress: Any = None,
    effects: Sequence[Effect] = (),
    *,
    curves: bool = False,
) -> tuple[list[Candidate], list[tuple[Entry, str]]]:
    """Return the candidates with their columns, and the entries that these records cannot speak about.

    Parameters
    ----------
    linearised : LinearisedProblem
    entries : sequence of Entry
    progress : callable, optional
        Gets a line of text now and then.
    effects : sequence of Effect
        What has been added to the model: of a richer law of one of them only what is new is a candidate.
    curves : bool
        Whether the free curves will be asked about as well: their columns then come from the same transitions.
    """
    refused: list[tuple[Entry, str]] = []
    plans: list[Plan] = []
    linearised.simulate()
    for entry in entries:
        if entry.kind.at == "connection":
            motion = linearised.motion_range(entry)
            if motion.speed <= 0.0 or motion.half < 1e-12:
                refused.append((entry, "this connection does not move in these records"))
                continue
            if entry.load and (why := _no_model(linearised, entry)):
                refused.append((entry, why))
                continue
            plans.append((entry, entry.kind.shape_grid(motion), list(entry.kind.strengths)))
        elif why := _calibrated(linearised, entry):
            refused.append((entry, why))
        elif entry.kind.component_shapes is not None:
            owner, ending = entry.kind.owner_of(entry.where)
            part = linearised.system.model.components[owner]
            plans.append((entry, entry.kind.component_shapes(part, ending), list(entry.kind.strengths)))
        else:
            plans.append((entry, [{}], list(entry.kind.strengths)))
    columns = _all_columns(linearised, plans, progress, curves)
    found: list[Candidate] = []
    far = far_away(linearised)
    for entry, shapes, strengths in plans:
        cols = [columns[entry.name, k] for k in range(len(shapes))]
        if far and takes_finite_amplitudes(entry):
            if progress is not None:
                progress(f"simulate {entry.name} at strengths that matter: the model is far from the machine")
            bent = finite_amplitude_sensitivities(linearised, entry, shapes, cols)
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
                kind=entry.kind.name,
                where=entry.where,
                sensitivities=tuple(tuple(cols[k]) for k in kept),
                shapes=tuple(shapes[k] for k in kept),
                one_sided=one_sided,
                strengths=tuple(strengths),
                info={"entry": entry},
            )
        )
    return found, refused


def _all_columns(
    linearised: LinearisedProblem, plans: Sequence[Plan], progress: Any, curves: bool
) -> dict[tuple[str, int], list[np.ndarray]]:
    """Return the columns of every candidate, record by record, side by side."""
    through = [c.channel for c in linearised.free_curves()] if curves else []

    def of(i: int) -> dict[tuple[str, int], np.ndarray]:
        if progress is not None:
            progress(f"sensitivities of {len(plans)} candidates on {linearised.experiments[i].name}")
        return _record_columns(linearised, i, plans, through)

    count = len(linearised.experiments)
    first = of(0)  # what it compiles and builds serves the others
    found = [first, *parallel_map(of, range(1, count))]
    return {key: [each[key] for each in found] for key in first}


def cannot_be_built(error: ModelError) -> str:
    """Say in a sentence why a model cannot take an effect."""
    return f"the model with it cannot be built: {'; '.join(error.faults)}"


def _no_model(linearised: LinearisedProblem, entry: Entry) -> str:
    """Return why the model cannot take an effect that needs a load, or an empty text.

    Where the load is itself worked out from the force that is asked for (a given motion needs it), the two would
    depend on each other at the same instant.
    """
    assert entry.place is not None
    effect = Effect.at_place(entry.kind.name, entry.place, load=entry.load, number=99)
    try:
        effect.added_to(linearised.system.model).build(probes=True)
    except ModelError as error:
        return cannot_be_built(error)
    return ""


def _calibrated(linearised: LinearisedProblem, entry: Entry) -> str:
    """Return why a value of the model is no candidate where calibration moves it, or an empty text."""
    if entry.kind.at != "parameter":
        return ""
    owner, ending = entry.kind.owner_of(entry.where)
    names = [f"{owner}.{n}{ending}" for n in entry.kind.strengths]
    calibration = linearised.calibration
    moved = {q.name for q in calibration.parameters} - set(calibration.not_excited)
    return f"not identifiable: {' and '.join(names)} can imitate it entirely" if set(names) <= moved else ""


def _record_columns(
    linearised: LinearisedProblem,
    index: int,
    plans: Sequence[Plan],
    curves: Sequence[str] = (),
) -> dict[tuple[str, int], np.ndarray]:
    """Return one record's sensitivities to every candidate and shape.

    Those to free curves, if any, are kept by the linearised problem.
    """
    experiment = linearised.experiments[index]
    time = np.array(experiment.record.time)
    run = linearised.nominal_outputs(index)
    perturbations: list[Perturbation] = []
    wanted: list[tuple[tuple[str, int], int]] = []
    sensors: dict[tuple[str, int], np.ndarray] = {}
    built_in: list[Plan] = []
    for entry, shapes, strengths in plans:
        if entry.kind.at == "connection":
            forces = _forces(linearised, entry, run, time, shapes, strengths)
            for k, group in enumerate(forces):
                for force in group:
                    wanted.append(((entry.name, k), len(perturbations)))
                    perturbations.append(InputPerturbation(f"probe.{entry.where}", force))
        elif entry.kind.at == "input":
            u = experiment.record.signals[entry.where].values
            still = np.ptp(u) <= STILL * np.max(np.abs(u))  # its rate is nothing but rounding
            late = np.zeros_like(time) if still else -np.gradient(u, time)
            shape = {"offset": np.ones_like(time), "gain": u, "delay": late}[entry.kind.law]
            wanted.append(((entry.name, 0), len(perturbations)))
            perturbations.append(InputPerturbation(entry.where, shape))
        elif entry.kind.at == "parameter":
            built_in.append((entry, shapes, strengths))
        else:
            sensors[entry.name, 0] = _sensor_column(experiment, run, time, entry)
    start = linearised.initial_state(index)
    carried, integrated = changes_of(built_in, linearised.slim)
    together = cheaper_by_transition_matrices(linearised.slim, [*perturbations, *(change for _, change in carried)])
    if together:
        wanted += [(key, len(perturbations) + k) for k, (key, _) in enumerate(carried)]
        perturbations += [change for _, change in carried]
        experiment.perturbation_response(  # for all batches at once
            linearised.slim, linearised.p, start, perturbations, curves
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
        for key, k in wanted:
            if first <= k < first + batch:
                parts.setdefault(key, []).append(dy[:, :, k - first])
    if together and curves:
        linearised.free_curve_sensitivities(index)
    experiment.trim_cache()
    for key, column in integrated_sensitivities(linearised, index, integrated):
        parts.setdefault(key, []).append(column)
    columns = {key: np.stack(group, axis=2) for key, group in parts.items()} | sensors
    return {key: linearised.weighted(index, column) for key, column in columns.items()}


def _forces(
    linearised: LinearisedProblem,
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
    sizes = [1.0 if entry.kind.linear else full.get("secant", 0.0) for full in shapes]
    sizes = [size or _small_strength(linearised.motion_range(entry)) for size in sizes]
    every = [
        ({k: v for k, v in full.items() if k != "secant"}, {n: (size if n == name else 0.0) for n in strengths})
        for full, size in zip(shapes, sizes, strict=True)
        for name in strengths
    ]
    found = law_forces(entry.kind, time, motion, [s for s, _ in every], [s for _, s in every])
    grouped = found.reshape(len(shapes), len(strengths), time.size)
    return [list(group / size) for group, size in zip(grouped, sizes, strict=True)]


def _sensor_column(experiment: Experiment, run: dict[str, np.ndarray], time: np.ndarray, entry: Entry) -> np.ndarray:
    y = run[entry.where]
    shape = {"offset": np.ones_like(time), "gain": y, "drift": time - time[0], "delay": -np.gradient(y, time)}[
        entry.kind.law
    ]
    prepared = experiment.preparation.apply(time, shape)[1]
    full = np.zeros((prepared.size, len(experiment.outputs), 1))
    full[:, experiment.outputs.index(entry.where), 0] = prepared
    return full
