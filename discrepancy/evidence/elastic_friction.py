"""Dry friction that a model has and that gives way elastically before it slides.

A law that fades with speed creeps where a real contact sticks, and a contact sticks like a spring, over micrometres.
That is no effect that the machine lacks beside its friction, but how the friction is idealised.  Left to the noise, it
is a random force while the machine stands still, or an error that rings after it; left to the catalogue, the nearest
law would be named for it.  So where the records show any random force or slow error, Dahl's law is tried in the place
of the model's, and kept if the evidence is for it; what is missing is asked of that model.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from discrepancy.evidence.criterion import Evidence
from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.evidence.moves import TriedModel
from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.standstill import places_that_stick
from discrepancy.evidence.tried_models import TriedModels
from discrepancy.problem.problem import Problem
from discrepancy.stages.fit_stage import FittedValues
from estimation.fit.calibration import UncertainParameter
from multibody.base.errors import ModelError
from multibody.base.quantity_text import quantity_text
from multibody.declare.component import Component
from multibody.library.friction import CoulombFriction, DahlFriction, RotaryCoulombFriction, RotaryDahlFriction

__all__ = ["with_elastic_friction"]

ELASTIC: dict[type[Component], type[Component]] = {
    CoulombFriction: DahlFriction,
    RotaryCoulombFriction: RotaryDahlFriction,
}
#: Displacements before sliding that are tried, as shares of half the travel: from a hundredth, beyond which it is the
#: effect `hysteresis`, in steps of ten, because the fit goes on from the best; it may end a hundred times below that.
#: The least is nearly rigid, so larger ones are tried while the evidence rises.
SHARES = (1e-4, 1e-3, 1e-2)
#: Share of the displacement that was tried below which the one that is fitted says that nothing gives way: twice the
#: lower bound of the fit.
SMALLEST = 0.02


def with_elastic_friction(tried: TriedModels, start: TriedModel) -> None:
    """Let the dry frictions of the machine be elastic where the evidence of the first model is for it.

    Parameters
    ----------
    tried : TriedModels
        Its state's model, uncertain parameters and latest stage are replaced.
    start : TriedModel
        The model that a search begins with, without effects; it is replaced in place.
    """
    assert start.likelihood is not None
    for name, half in _rigid_frictions(tried, start.likelihood):
        _try(tried, start, name, half)


def _rigid_frictions(tried: TriedModels, likelihood: StageLikelihood) -> list[tuple[str, float]]:
    """Return the parts with a law that fades with speed, if anything random was found, and half of their travels."""
    if not likelihood.noise.model.processes:
        return []
    system, linearised = likelihood.stage.system, likelihood.linearised
    parts = tried.state.given.model.components
    found = []
    for j in places_that_stick(linearised):
        place = system.places[j]
        position = f"place.{place.name}.{place.motion_names()[0][0]}"
        for name in (place.name, *place.also):
            if type(parts.get(name)) in ELASTIC:
                runs = [linearised.nominal_outputs(i)[position] for i in range(len(linearised.experiments))]
                low, high = min(float(r.min()) for r in runs), max(float(r.max()) for r in runs)
                found.append((name, 0.5 * (high - low)))
    return found


def _try(tried: TriedModels, start: TriedModel, name: str, half: float) -> None:
    """Replace one friction, if the evidence is for it; else, also when interrupted, the machine stays as it was."""
    state = tried.state
    before = state.given, state.problem
    kept = False
    state.progress(f"whether {name} gives way before it slides")
    try:
        kept = _replaced(tried, start, name, half)
    finally:
        if not kept:
            state.given, state.problem = before


def _replaced(tried: TriedModels, start: TriedModel, name: str, half: float) -> bool:
    """Let the state's machine have Dahl's law in the place of a friction; tell whether it is kept."""
    state = tried.state
    given, problem = state.given, state.problem
    best: tuple[StageLikelihood, Evidence] | None = None
    settings = given, problem
    for share in SHARES:
        parameter = UncertainParameter(
            name=f"{name}.x_s", value=share * half, std=share * half, min=0.5 * SMALLEST * share * half
        )
        state.given, state.problem = _elastic(given, name, parameter), _elastic(problem, name, parameter)
        try:
            there = _there(tried, start, {parameter.name: parameter.value})
        except (RuntimeError, ModelError, np.linalg.LinAlgError):
            continue
        if best is not None and there[1].total <= best[1].total:
            break
        best, settings = there, (state.given, state.problem)
    if best is None:
        return False
    state.given, state.problem = settings
    way = tried.way_to_likeliest(*best)
    rise = way.end[1].total - start.total
    size = way.end[0].stage.identify.to_dict()[f"{name}.x_s"]
    # at its smallest it is another law that does not give way either, and the rise is that of another linearisation
    if rise <= max(POLICY.reach, tried.wander) or size <= SMALLEST * state.problem.uncertain[-1].value:
        return False
    _keep(tried, start, way.end)
    unit = state.given.model.components[name].declarations["x_s"].unit  # type: ignore[attr-defined]
    state.remarks.append(
        f"The dry friction '{name}' of the model fades with speed. That of the machine gives way elastically, "
        f"by about {quantity_text(size, unit, 2)}, before it slides (log evidence {rise:+.0f}). It is "
        "replaced by Dahl's law, and what is missing was asked of that model."
    )
    state.progress(state.remarks[-1])
    return True


def _elastic(problem: Problem, name: str, parameter: UncertainParameter) -> Problem:
    """Return a problem whose machine has Dahl's law in the place of a friction that fades with speed."""
    model = problem.model.copy()
    given = model.components[name]
    model.replace(name, ELASTIC[type(given)](coulomb=given.values["coulomb"], x_s=parameter.value))
    return replace(problem, model=model, uncertain=(*problem.uncertain, parameter))


def _there(tried: TriedModels, start: TriedModel, more: dict[str, float]) -> tuple[StageLikelihood, Evidence]:
    """Return the first model with the friction of the state's machine, at its parameters and some more."""
    assert start.likelihood is not None
    stage = start.stage
    values = FittedValues(stage.identify.to_dict() | more, stage.identify.own_values, stage.identify.scale)
    other = tried.state.fitted(stage.name, (), None, dict(stage.noise), values=values, trial=True)
    likelihood = start.likelihood.neighbour(other)
    return likelihood, tried.evidence_of(likelihood)


def _keep(tried: TriedModels, start: TriedModel, fit: tuple[StageLikelihood, Evidence]) -> None:
    """Let the search begin with a fit of another machine."""
    start.likelihood, start.evidence = fit[0].with_richer_noise(), fit[1]
    start.at_likeliest = True
    tried.refresh(start)
    stage = start.stage
    tried.state.stages[-1] = tried.state.restored(
        stage.name, (), stage.identify.to_dict(), stage.identify.own_values, stage.identify.scale, stage.noise
    )
