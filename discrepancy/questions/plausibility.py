"""Whether a model and its records can belong together, before anything is fitted: signs, scales, columns, excitation.

One simulation of each record, as the study gives it; seconds, where a diagnosis takes minutes.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.problem.contradicting_positions import contradicting_positions, contradiction_text
from discrepancy.problem.problem import Problem, noise_floors
from discrepancy.problem.start_at_rest import start_at_rest
from discrepancy.questions.scales import compare_scales
from estimation.response.experiment import Experiment, Response
from multibody.base.errors import SimulationError
from multibody.base.quantity_text import count_text
from multibody.fmi.component import sensitivity_sources
from multibody.system.stepped import LongStepsWarning

if TYPE_CHECKING:
    from multibody.machine.model import System

__all__ = ["Check", "check_problem", "shown_deviations"]

#: Evaluations of the equations for each sample from which a simulation is slow because the model is stiff; chosen: an
#: explicit method takes 7 for a step.
MANY = 200.0
#: Share of a prior's deviation to which the records must narrow a parameter for it to be shown by them.
NARROWED = 0.7
#: Share of the largest information below which derivatives of integrations tell nothing: their errors, 1e-6 and
#: more, squared.
LEAST_INFORMATION = 1e-12


@dataclass(frozen=True, kw_only=True)
class Check:
    """What was found out about a study before any fit.

    Attributes
    ----------
    faults : tuple of str
        What makes a comparison meaningless, with the remedy.
    warnings : tuple of str
        What weakens it.
    facts : tuple of str
        What was looked at and is in order.
    experiment : Experiment
        The first record.
    model : ndarray, shape (n, n_channels) or None
        Its simulation as given; None where it fails.
    """

    faults: tuple[str, ...]
    warnings: tuple[str, ...]
    facts: tuple[str, ...]
    experiment: Experiment
    model: np.ndarray | None


@dataclass
class _Notes:
    faults: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    facts: list[str] = field(default_factory=list)


def _constant_surroundings(problem: Problem, system: System) -> list[str]:
    """Return which parts lose heat to surroundings of constant temperature, where a temperature drives the model."""
    from multibody.library.thermal import WarmBody

    driving = [q.name for q in system.inputs if q.unit == "K" and q.name in problem.identify[0].inputs]
    parts = problem.model.components
    constant = {n: c for n, c in parts.items() if isinstance(c, WarmBody) and not c.options["recorded_ambient"]}
    if not driving:
        return []
    recorded = ", ".join(map(repr, driving))
    return [
        f"heat lost at '{name}' goes to {part.values['ambient']} K, though {recorded} is recorded: if these are its "
        "surroundings, give the part recorded_ambient=True and connect its input 'surroundings'"
        for name, part in constant.items()
    ]


def check_problem(problem: Problem, excitation: bool = True) -> Check:
    """Check whether the model and the records of a study fit each other.

    Parameters
    ----------
    problem : Problem
        As read; nothing is fitted.
    excitation : bool
        Whether to ask what the records can show of each parameter, too, which takes derivatives.
    """
    notes = _Notes(warnings=list(problem.warnings))
    system = problem.model.build(outputs=problem.identify[0].outputs)
    values = {q.name: q.value for q in problem.uncertain}
    p = system.parameter_vector(values)
    notes.warnings += [f"dimensions of the model's equations: {fault}" for fault in problem.model.dimension_faults()]
    _records(problem.identify, notes)
    names = [q.name for q in problem.uncertain]
    responses: list[Response] = []
    for e in problem.identify:
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always", LongStepsWarning)
                responses.append(e.respond_with_own(system, p, {}, parameters=names, derivatives=excitation))
            for one in caught:
                if issubclass(one.category, LongStepsWarning):
                    notes.warnings.append(f"record '{e.name}': {one.message}")
                else:
                    warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)
            _start(e, system, p, responses[-1], notes)
        except SimulationError as error:
            notes.faults.append(
                f"record '{e.name}' cannot be simulated with the values as given: {error}: check units, signs and "
                "[initial]"
            )
            break
    if outputs := contradicting_positions(problem):
        notes.warnings.append(contradiction_text(outputs))
    if len(responses) == len(problem.identify):
        scales = compare_scales(problem.identify, responses)
        notes.faults += scales.faults
        notes.warnings += scales.warnings
        notes.facts += scales.facts
        if excitation:
            _excitation(problem, responses, notes)
        samples = sum(len(e.record.time) for e in problem.identify)
        effort = sum(r.evaluations for r in responses) / samples
        if effort > MANY:
            notes.warnings.append(
                f"a simulation takes {effort:.0f} evaluations of the equations for each sample: the model is stiff; a "
                "softer contact or a smoother friction makes everything faster"
            )
        elif effort:
            notes.facts.append(f"{effort:.1f} evaluations of the equations for each sample")
    notes.facts += [
        f"sensitivities of '{name}' come from {source}"
        for name, source in sensitivity_sources(problem.model.components).items()
    ]
    free = dict.fromkeys(name for e in problem.identify for name in e.free)
    if free:
        notes.facts.append(f"estimated for each record: the start of {', '.join(free)}")
    notes.facts += _constant_surroundings(problem, system)
    notes.facts += [
        f"'{e.name}': {clock.added:.4g} s are added to the time of '{clock.files}'; what is left is fitted"
        for e in problem.identify
        for clock in e.clocks
    ]
    return Check(
        faults=tuple(notes.faults),
        warnings=tuple(dict.fromkeys(notes.warnings)),
        facts=tuple(notes.facts),
        experiment=problem.identify[0],
        model=responses[0].outputs if responses else None,
    )


def _records(experiments: Sequence[Experiment], notes: _Notes) -> None:
    total = sum(float(e.record.duration) for e in experiments)
    rates = sorted({round(float(e.record.rate), 3) for e in experiments})
    listed = f"{rates[0]:g}" if len(rates) == 1 else f"{rates[0]:g} to {rates[-1]:g}"
    notes.facts.append(f"{count_text(len(experiments), 'record')} to fit, {total:.4g} s in all, at {listed} Hz")
    for name in experiments[0].inputs:
        if all(np.ptp(e.record.signals[name].values) == 0.0 for e in experiments):
            notes.warnings.append(f"input '{name}' is constant in every record: it excites nothing")


def _start(e: Experiment, system: System, p: np.ndarray, response: Response, notes: _Notes) -> None:
    """Tell where a record follows the model far better from rest than from its start values: a slack rope, say."""
    start = start_at_rest(e, system, p, response.outputs)
    if start is None:
        return
    distance = {n: abs(rest - begun) for n, (begun, rest) in start.moved.items()}
    most = sorted((n for n in distance if distance[n] > 0.01 * max(distance.values())), key=lambda n: -distance[n])[:3]
    given = ", ".join(
        f"'{n}' at {rest:.6g} {system.unit(n)} in place of {begun:.6g}"
        for n in most
        for begun, rest in [start.moved[n]]
    )
    c = int(np.argmax(start.before / np.maximum(e.measured.std(axis=0), 1e-300)))
    name, of = e.outputs[c], system.unit(e.outputs[c])
    say = ", ".join(f'"{n}" = "equilibrium"' for n in most)
    notes.warnings.append(
        f"record '{e.name}' seems to start at rest, and its start values are elsewhere (a slack rope, a spring far "
        f"from its load): with {given}, the error of '{name}' is {start.after[c]:.3g} {of} and not "
        f"{start.before[c]:.3g} {of}: in [initial] say {say}, or give expressions of what was measured, or numbers for "
        "each record"
    )


def shown_deviations(problem: Problem, responses: Sequence[Response]) -> dict[str, tuple[float, bool]]:
    """Return how well the records show each uncertain parameter at best, with white noise of the sensors alone.

    Parameters
    ----------
    problem : Problem
    responses : sequence of Response
        Of each record for identification, with derivatives by the uncertain parameters and by its own unknowns.

    Returns
    -------
    dict of str to (float, bool)
        Standard deviation beside the others and the prior, in the parameter's unit; whether any output feels it at all.
    """
    count = len(problem.uncertain)
    if not count:
        return {}
    floors: Mapping[str, float] = noise_floors(problem.identify, problem.noise)
    scale = np.array([max(floors[n], 1e-12) for n in problem.identify[0].outputs])
    information = np.diag([1.0 / q.std**2 if np.isfinite(q.std) else 0.0 for q in problem.uncertain])
    for response in responses:
        columns = (response.derivatives / scale[:, None]).reshape(-1, response.derivatives.shape[2])
        shared, own = columns[:, :count], columns[:, count:]
        if own.shape[1]:
            basis, size, _ = np.linalg.svd(own, full_matrices=False)
            basis = basis[:, size > 1e-9 * max(float(size[0]), 1e-300)]
            shared = shared - basis @ (basis.T @ shared)
        information = information + shared.T @ shared
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    # Parameters that act only together leave an eigenvalue of rounding errors: it stands for next to no information.
    power, direction = np.linalg.eigh(information / np.outer(size, size))
    deviation = np.sqrt((direction**2) @ (1.0 / np.maximum(power, LEAST_INFORMATION * power[-1]))) / size
    return {
        q.name: (float(std), bool(of > 1e-140)) for q, std, of in zip(problem.uncertain, deviation, size, strict=True)
    }


def _excitation(problem: Problem, responses: Sequence[Response], notes: _Notes) -> None:
    """Tell which uncertain parameters the records cannot show."""
    shown = shown_deviations(problem, responses)
    for q in problem.uncertain:
        std, felt = shown[q.name]
        known = q.std if np.isfinite(q.std) else abs(q.value)
        if not felt or std > NARROWED * known > 0.0:
            notes.warnings.append(
                f"parameter '{q.name}': these records cannot show it (to ±{std:.2g} {q.unit} at best; it was known "
                f"to ±{known:.2g} before): take it out of [uncertain], or record a motion that it changes"
            )
        else:
            notes.facts.append(
                f"parameter '{q.name}': these records can show it to ±{std:.2g} {q.unit}, if the sensors' noise is "
                "the only disturbance"
            )
