"""Dry friction that a model has and that gives way elastically before it slides.

A law that fades with speed creeps where a real contact sticks, and a contact sticks like a spring, over micrometres,
and often like one that is damped.  That is no effect that the machine lacks beside its friction, but how the friction
is idealised.  Left to the noise, it is a random force while the machine stands still, or an error that rings after it;
left to the catalogue, the nearest law would be named for it.  So where the records show any random force or slow error,
Dahl's law is tried in the place of the model's, and then LuGre's; each is kept if the evidence is for it, and what is
missing is asked of that model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

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
from multibody.library.friction import (
    CoulombFriction,
    DahlFriction,
    LuGreFriction,
    RotaryCoulombFriction,
    RotaryDahlFriction,
    RotaryLuGreFriction,
)

__all__ = ["with_elastic_friction"]

ELASTIC: dict[type[Component], type[Component]] = {
    CoulombFriction: DahlFriction,
    RotaryCoulombFriction: RotaryDahlFriction,
}
DAMPED: dict[type[Component], type[Component]] = {
    DahlFriction: LuGreFriction,
    RotaryDahlFriction: RotaryLuGreFriction,
}
#: Displacements before sliding that are tried, as shares of half the travel: up to a hundredth, beyond which it is the
#: effect `hysteresis`, two to a decade, because the fit goes on from the best and a linearisation holds for a factor of
#: two or so.  The least is nearly rigid, so larger ones are tried while the evidence rises.
DISPLACEMENTS = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2)
#: Relaxation times of the bristles that are tried, in sampling intervals: from a tenth, below which no sample shows it,
#: to ten, beyond which friction follows the speed for longer than most reversals take; two to a decade as well.
RELAXATIONS = (0.1, 0.3, 1.0, 3.0, 10.0)
#: Share of what was tried below which what is fitted says that nothing gives way or is damped: twice the lower bound of
#: the fit.
SMALLEST = 0.02


@dataclass(frozen=True, eq=False)
class _Law:
    """A law in the place of a friction, with one more uncertain parameter.

    Parameters
    ----------
    part : str
    parameter : str
        Of the part.
    tried : tuple of float
        Values from which the fit may begin, SI, rising.
    of : callable
        Returns the part with the law and a value, for the part as it is.
    """

    part: str
    parameter: str
    tried: tuple[float, ...]
    of: Callable[[Component, float], Component]

    @property
    def name(self) -> str:
        """Of the uncertain parameter."""
        return f"{self.part}.{self.parameter}"

    def in_place(self, problem: Problem, value: float) -> Problem:
        """Return a problem whose machine has the law."""
        model = problem.model.copy()
        model.replace(self.part, self.of(model.components[self.part], value))
        parameter = UncertainParameter(name=self.name, value=value, std=value, min=0.5 * SMALLEST * value)
        return replace(problem, model=model, uncertain=(*problem.uncertain, parameter))


def with_elastic_friction(tried: TriedModels, model: TriedModel) -> bool:
    """Let the dry frictions of the machine be elastic, and damped, where the evidence of a model is for it.

    A large effect hides how friction gives way, so that is asked of every model which is extended.  The others that
    were tried are then forgotten, but the first, because they are of another machine.

    Parameters
    ----------
    tried : TriedModels
        Its state's model, uncertain parameters and latest stage are replaced.
    model : TriedModel
        The first model, or one that is extended; it is replaced in place.

    Returns
    -------
    bool
        Whether a friction was replaced.
    """
    state = tried.state
    assert model.likelihood is not None
    replaced = False
    for name, half in _rigid_frictions(tried, model.likelihood):
        before = model.total
        state.progress(f"whether {name} gives way before it slides")
        if not _is_kept(tried, model, _elastic(name, half)):
            continue
        replaced = True
        state.progress(f"whether {name} is damped while it gives way")
        damped = _is_kept(tried, model, _damped(name, _interval(model.likelihood)))
        state.remarks.append(_remark(tried, model, name, damped=damped, rise=model.total - before))
        state.progress(state.remarks[-1])
    return replaced


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


def _interval(likelihood: StageLikelihood) -> float:
    """Return the median interval between the samples of the likelihood, s."""
    return float(np.median(np.concatenate([np.diff(r.time) for r in likelihood.noise.records])))


def _elastic(part: str, half: float) -> _Law:
    def of(given: Component, value: float) -> Component:
        return ELASTIC[type(given)](coulomb=given.values["coulomb"], x_s=value)

    return _Law(part, "x_s", tuple(share * half for share in DISPLACEMENTS), of)


def _damped(part: str, interval: float) -> _Law:
    def of(given: Component, value: float) -> Component:
        return DAMPED[type(given)](coulomb=given.values["coulomb"], x_s=given.values["x_s"], t_s=value)

    return _Law(part, "t_s", tuple(share * interval for share in RELAXATIONS), of)


def _is_kept(tried: TriedModels, model: TriedModel, law: _Law) -> bool:
    """Replace one friction, if the evidence is for it; else, also when interrupted, the machine stays as it was."""
    state = tried.state
    before = state.given, state.problem
    kept = False
    try:
        kept = _replaced(tried, model, law)
    except (RuntimeError, ModelError, np.linalg.LinAlgError) as error:
        state.progress(f"{law.part} stays as it is: {error}")
    finally:
        if not kept:
            state.given, state.problem = before
    return kept


def _replaced(tried: TriedModels, model: TriedModel, law: _Law) -> bool:
    """Let the state's machine have another law in the place of a friction; tell whether it is kept."""
    state = tried.state
    given, problem = state.given, state.problem
    best: tuple[StageLikelihood, Evidence] | None = None
    begun, settings = 0.0, (given, problem)
    for value in law.tried:
        state.given, state.problem = law.in_place(given, value), law.in_place(problem, value)
        try:
            there = _there(tried, model, {law.name: value})
        except (RuntimeError, ModelError, np.linalg.LinAlgError):
            continue
        if best is not None and there[1].total <= best[1].total:
            break
        best, begun, settings = there, value, (state.given, state.problem)
    if best is None:
        return False
    state.given, state.problem = settings
    way = tried.way_to_likeliest(*best)
    value = way.end[0].stage.identify.to_dict()[law.name]
    # at its smallest it is another law that does not give way either, and the rise is that of another linearisation
    if value <= SMALLEST * begun or way.end[1].total - model.total <= max(POLICY.reach, tried.wander):
        return False
    _keep(tried, model, way.end, {law.name: value})
    return True


def _there(tried: TriedModels, model: TriedModel, more: dict[str, float]) -> tuple[StageLikelihood, Evidence]:
    """Return a model with the friction of the state's machine, at its parameters and some more."""
    assert model.likelihood is not None
    stage = model.stage
    values = FittedValues(stage.identify.to_dict() | more, stage.identify.own_values, stage.identify.scale)
    other = tried.state.fitted(stage.name, stage.effects, None, dict(stage.noise), values=values, trial=True)
    likelihood = model.likelihood.neighbour(other)
    return likelihood, tried.evidence_of(likelihood)


def _keep(
    tried: TriedModels, model: TriedModel, fit: tuple[StageLikelihood, Evidence], more: dict[str, float]
) -> None:
    """Let the search go on with a fit of another machine."""
    start = tried.start
    assert start is not None
    first = tried.way_to_likeliest(*_there(tried, start, more)).end if model is not start else fit
    model.likelihood, model.evidence, model.at_likeliest = fit[0].with_richer_noise(), fit[1], True
    tried.refresh(model)
    tried.settle_again(model)
    if model is not start:
        start.likelihood, start.evidence, start.at_likeliest = first[0], first[1], True
        start.proposals, model.parent = None, start.key
        tried.models = {start.key: start, model.key: model}
    stage = start.stage
    tried.state.stages[-1] = tried.state.restored(
        stage.name, (), stage.identify.to_dict(), stage.identify.own_values, stage.identify.scale, stage.noise
    )


def _remark(tried: TriedModels, model: TriedModel, name: str, *, damped: bool, rise: float) -> str:
    """Return what a reader must know of the friction that was replaced."""
    declared = tried.state.given.model.components[name].declarations
    fitted = model.stage.identify.to_dict()
    size = quantity_text(fitted[f"{name}.x_s"], declared["x_s"].unit, 2)  # type: ignore[attr-defined]
    how = f" and is damped while it does (for {quantity_text(fitted[f'{name}.t_s'], 's', 2)})" if damped else ""
    law = "LuGre's law" if damped else "Dahl's law"
    return (
        f"The dry friction '{name}' of the model fades with speed. That of the machine gives way elastically, by about "
        f"{size}, before it slides{how} (log evidence {rise:+.0f}). It is replaced by {law}, and what is missing was "
        "asked of that machine."
    )
