"""Sensitivities of the outputs to every candidate effect: its force along the motion, propagated through the machine.

A connection's effect is a force between two sides.  Its law is evaluated along the simulated motion at unit strength,
and the force is propagated by the exact linearisation of the machine along that motion.  Nothing has to be compiled for
it, and hundreds of candidates and shapes cost one integration.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, groupby
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
from discrepancy.sensitivities.slip import slip_sensitivities
from discrepancy.statistics.blocks import Candidate, KeptSensitivities
from discrepancy.statistics.columns import columns_together, responses_together
from discrepancy.statistics.score_variance import about_bands
from estimation.response.experiment import Experiment
from estimation.response.perturbations import InputPerturbation, Perturbation, cheaper_by_transition_matrices
from multibody.base.errors import ModelError, SimulationError
from multibody.base.memory import KEPT, ArrayStore, memory_limit, scratch_folder
from multibody.base.parallel import available_cores, parallel_map
from multibody.base.progress import Step
from multibody.base.quantity_text import count_text

__all__ = ["candidate_sensitivities", "cannot_be_built", "forces_along_motion"]

#: Number of an array in the store, and whether the effect changes anything there.
Kept = tuple[int, bool]

BATCH = 192  # responses that are computed together at most
#: Arrays of the size of all sensitivities that are kept: themselves, what is orthogonal to calibration with and without
#: whitening, and the vectors from which the noise of each score follows.
KEPT_COPIES = 5.0
#: Of the energies of all candidates and shapes per band and pair of outputs: with and without whitening.
SPECTRA_COPIES = 2.0
WORTH_SAYING = 1e9  # bytes from which on the memory is announced


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
    slipping: list[Entry] = []
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
        elif entry.kind.at == "transmission":
            slipping.append(entry)
        elif why := _calibrated(linearised, entry):
            refused.append((entry, why))
        elif entry.kind.component_shapes is not None:
            owner, ending = entry.kind.owner_of(entry.where)
            part = linearised.system.model.components[owner]
            plans.append((entry, entry.kind.component_shapes(part, ending), list(entry.kind.strengths)))
        else:
            grid = entry.kind.shape_grid(MotionRange(low=0.0, high=0.0, speed=0.0, step=linearised.step))
            plans.append((entry, grid, list(entry.kind.strengths)))
    store = ArrayStore()
    _announce(linearised, plans, progress)
    sensitivities = _all_sensitivities(linearised, plans, store, progress, curves)
    candidates: list[Candidate] = []
    far = far_from_machine(linearised)
    for entry, shapes, strengths in plans:
        by_shape = [sensitivities[entry.key, k] for k in range(len(shapes))]
        if far and takes_finite_amplitudes(entry):
            if progress is not None:
                progress(f"simulate {entry.name} at strengths that matter: the model is far from the machine")
            derivatives = KeptSensitivities(store, [[k for k, _ in blocks] for blocks in by_shape])
            for shape, blocks in finite_amplitude_sensitivities(linearised, entry, shapes, derivatives):
                shapes = [*shapes, shape]
                by_shape.append([(store.put(b), bool(np.any(b))) for b in blocks])
        kept = [k for k, blocks in enumerate(by_shape) if any(acts for _, acts in blocks)]
        if not kept:
            refused.append((entry, "it would not change any measured output of these records"))
            continue
        numbers = [[number for number, _ in by_shape[k]] for k in kept]
        one_sided = entry.kind.one_sided
        if differs_from(effects, entry.kind, entry.where):
            both = KeptSensitivities(store, numbers)
            numbers = [[store.put(b[:, :, :1] - b[:, :, 1:]) for b in blocks] for blocks in both]
            strengths, one_sided = [DIFFERENCE], False
        candidates.append(
            Candidate(
                kind=entry.kind.name,
                where=entry.where,
                sensitivities=KeptSensitivities(store, numbers),
                shapes=tuple(shapes[k] for k in kept),
                one_sided=one_sided,
                strengths=tuple(strengths),
                info={"entry": entry},
            )
        )
    for entry in slipping:
        candidate = _slip_candidate(linearised, entry, store, progress)
        if isinstance(candidate, str):
            refused.append((entry, candidate))
        else:
            candidates.append(candidate)
    return candidates, refused


def _slip_candidate(linearised: LinearisedProblem, entry: Entry, store: ArrayStore, progress: Any) -> Candidate | str:
    """Return the candidate that a rigid transmission slips, or why these records cannot tell."""
    if progress is not None:
        progress(f"simulate {entry.name}")
    try:
        found = slip_sensitivities(linearised, entry)
    except ModelError as error:
        return cannot_be_built(error)
    except SimulationError:
        found = []
    if not found:
        return "it could not be simulated, or would not change any measured output of these records"
    return Candidate(
        kind=entry.kind.name,
        where=entry.where,
        sensitivities=KeptSensitivities(store, [[store.put(b) for b in blocks] for _, blocks in found]),
        shapes=tuple(shape for shape, _ in found),
        one_sided=True,
        strengths=entry.kind.strengths,
        info={"entry": entry},
    )


def _announce(linearised: LinearisedProblem, plans: Sequence[Plan], progress: Any) -> None:
    """Say how much memory the sensitivities and what the scores make of them will take, where it is much."""
    columns = sum(len(shapes) * len(strengths) for _, shapes, strengths in plans)
    samples, outputs = sum(e.time.size for e in linearised.experiments), len(linearised.experiments[0].outputs)
    rows = samples * outputs
    spectra = SPECTRA_COPIES * 16.0 * sum(len(s) for _, s, _ in plans) * about_bands(samples // 2) * outputs**2
    needed, room = KEPT_COPIES * 8.0 * columns * rows + spectra, KEPT * memory_limit()
    if progress is None or needed < WORTH_SAYING:
        return
    text = (
        f"{len(plans)} candidates have {columns} sensitivities of {rows} values: with their scores about "
        f"{needed / 1e9:.2g} GB"
    )
    beyond = needed - room
    if beyond > 0.0:
        text += (
            f", of which {beyond / 1e9:.2g} GB go into a file in {scratch_folder()}, because "
            f"{memory_limit() / 1e9:.3g} GB of memory may be used (--memory)"
        )
    progress(text)


def _all_sensitivities(
    linearised: LinearisedProblem, plans: Sequence[Plan], store: ArrayStore, progress: Any, curves: bool
) -> dict[tuple[str, int], list[Kept]]:
    """Return the sensitivities to every candidate and shape, record by record, computed in parallel."""
    channels = [c.channel for c in linearised.free_curves()] if curves else []

    count = len(linearised.experiments)
    finished: list[int] = []

    def of(i: int) -> dict[tuple[str, int], Kept]:
        if progress is not None:
            text = f"sensitivities of {count_text(len(plans), 'candidate')} on {linearised.experiments[i].name}"
            progress(Step(text, len(finished), count))
        sensitivities = _record_sensitivities(linearised, i, plans, store, channels)
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
    store: ArrayStore,
    curve_channels: Sequence[str] = (),
) -> dict[tuple[str, int], Kept]:
    """Return one record's sensitivities to every candidate and shape, as numbers of arrays in the store.

    Those to free curves, if any, are kept by the linearised problem.
    """
    experiment = linearised.experiments[index]
    run = linearised.nominal_outputs(index)
    forced = [plan for plan in plans if plan[0].kind.at in ("connection", "input", "signal")]
    built_in = [plan for plan in plans if plan[0].kind.at == "parameter"]
    start = linearised.initial_state(index)
    carried, integrated = parameter_perturbations(built_in, linearised.slim)
    no_values = np.empty(0)  # what is perturbed is known before by how much
    every: list[Perturbation] = [
        InputPerturbation(_channel(entry), no_values)
        for entry, shapes, strengths in forced
        for _ in range(len(shapes) * (len(strengths) if entry.kind.at == "connection" else 1))
    ]
    every += [change for _, change in carried]
    together = cheaper_by_transition_matrices(linearised.slim, every, np.size(experiment.record.time))
    if together:
        experiment.perturbation_response(linearised.slim, linearised.p, start, every, curve_channels)  # for all batches
    else:
        integrated = [*carried, *integrated]
    kept: dict[tuple[str, int], Kept] = {}

    def keep(key: tuple[str, int], block: np.ndarray) -> None:
        block = linearised.weighted(index, block)
        kept[key] = store.put(block), bool(np.any(block))

    def respond(group: Sequence[tuple[tuple[str, int], Perturbation]]) -> None:
        dy = experiment.respond(
            linearised.slim,
            linearised.p,
            start,
            perturbations=[change for _, change in group],
            sensors=linearised.sensors,
            batch=batch,
            workers=available_cores(),
        ).derivatives
        of_key: dict[tuple[str, int], list[int]] = {}
        for k, (key, _) in enumerate(group):
            of_key.setdefault(key, []).append(k)
        for key, own in of_key.items():
            keep(key, np.ascontiguousarray(dy[:, :, own[0] : own[-1] + 1]))

    rows = max(np.size(experiment.record.time), 1) * len(experiment.outputs)
    batch = columns_together(rows, BATCH) if together else responses_together(rows, BATCH)
    waiting: list[tuple[tuple[str, int], Perturbation]] = []
    for group in chain(_input_perturbations(linearised, index, forced), _by_key(carried) if together else ()):
        if waiting and len(waiting) + len(group) > batch:
            respond(waiting)
            waiting = []
        waiting += group
    if waiting:
        respond(waiting)
    if together and curve_channels:
        linearised.free_curve_sensitivities(index)
    experiment.trim_cache()
    parts: dict[tuple[str, int], list[np.ndarray]] = {}
    for key, sensitivity in integrated_sensitivities(linearised, index, integrated):
        parts.setdefault(key, []).append(sensitivity)
    for key, group_of_key in parts.items():
        keep(key, np.stack(group_of_key, axis=2))
    time = np.array(experiment.record.time)
    for entry, *_ in plans:
        if entry.kind.at not in ("connection", "input", "signal", "parameter"):
            keep((entry.key, 0), _sensor_sensitivity(experiment, run, time, entry))
    return kept


def _by_key(
    perturbations: Sequence[tuple[tuple[str, int], Perturbation]],
) -> Iterator[list[tuple[tuple[str, int], Perturbation]]]:
    """Yield the perturbations of one candidate and shape after another."""
    for _, group in groupby(perturbations, key=lambda keyed: keyed[0]):
        yield list(group)


def _channel(entry: Entry) -> str:
    """Return the input of the model through which an effect acts."""
    return entry.where if entry.kind.at == "input" else f"probe.{entry.place.name if entry.place else entry.where}"


def _input_perturbations(
    linearised: LinearisedProblem, index: int, plans: Sequence[Plan]
) -> Iterator[list[tuple[tuple[str, int], Perturbation]]]:
    """Yield what the strengths of every candidate and shape do to an input of the model along a record."""
    experiment = linearised.experiments[index]
    time, run = np.array(experiment.record.time), linearised.nominal_outputs(index)
    for entry, shapes, strengths in plans:
        channel = _channel(entry)
        if entry.kind.at == "connection":
            forces: Iterable[Sequence[np.ndarray]] = forces_along_motion(
                linearised, entry, run, time, shapes, strengths
            )
        else:
            recorded = entry.kind.at == "input"
            u = experiment.record.signals[entry.where].values if recorded else run[entry.where]
            forces = ([signal_error(entry.kind.law, time, u, shape.get("filter", 0.0))] for shape in shapes)
        for k, group in enumerate(forces):
            yield [((entry.key, k), InputPerturbation(channel, force)) for force in group]


def forces_along_motion(
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
        general: run[f"place.{entry.place.name}.{own}"]
        for general, own in zip(MOTION, names, strict=True)
        if f"place.{entry.place.name}.{own}" in run
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
