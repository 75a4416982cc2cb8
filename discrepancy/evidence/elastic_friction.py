"""Dry friction that a model has and that gives way elastically before it slides.

A law that fades with speed creeps where a real contact sticks, and a contact sticks like a spring, over micrometres,
and often like one that is damped.  That is no effect that the machine lacks beside its friction, but how the friction
is idealised.  Left to the noise, it is a random force while the machine stands still, or an error that rings after it;
left to the catalogue, the nearest law would be named for it.  So where the records show any random force or slow error,
Dahl's law is tried in the place of the model's, and then LuGre's; each is kept if the evidence is for it, and what is
missing is asked of that model.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.evidence.criterion import Evidence
from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.evidence.linearised_records import record_columns
from discrepancy.evidence.moves import TriedModel
from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.standstill import places_that_stick
from discrepancy.evidence.tried_models import TriedModels, misfit
from discrepancy.innovations.noise_fit import restricted_log_likelihoods
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

if TYPE_CHECKING:
    from discrepancy.search.state import SearchState

__all__ = ["with_elastic_friction"]

#: Without and with damping, of each friction that fades with speed.
ELASTIC: dict[type[Component], tuple[type[Component], type[Component]]] = {
    CoulombFriction: (DahlFriction, LuGreFriction),
    RotaryCoulombFriction: (RotaryDahlFriction, RotaryLuGreFriction),
}
#: Displacements before sliding that are tried: up to a hundredth of half the travel, beyond which it is the effect
#: `hysteresis`, two to a decade, because the fit goes on from the best and a linearisation holds for a factor of two or
#: so.  The least is nearly rigid: a ten-thousandth of half the travel, or, on a shaft of many turns, how far it moves
#: within one sampling interval of a reversal.
LARGEST, LEAST, TO_A_DECADE = 1e-2, 1e-4, 2
#: Relaxation times of damped bristles that are tried, in sampling intervals: shorter ones are not seen, and much longer
#: ones make friction follow the speed; what is in between is reached from these.
RELAXATIONS = (0.3, 3.0)
#: Share of what was tried below which what is fitted says that nothing gives way or is damped: twice the lower bound of
#: the fit.
SMALLEST = 0.02


@dataclass(frozen=True, eq=False, kw_only=True)
class _Elastic:
    """A model whose machine has a friction that gives way, with the values of its law as further uncertain parameters.

    Parameters
    ----------
    fit : tuple of (StageLikelihood, Evidence)
    begun : dict of str to float
        Values with which the fit began, by the name of the parameter, SI.
    given, problem : Problem
        Of the search, with that machine.
    wander : float
        Nats by which another linearisation changes the evidence, once that was asked.
    """

    fit: tuple[StageLikelihood, Evidence]
    begun: dict[str, float]
    given: Problem
    problem: Problem
    wander: float = 0.0

    @property
    def total(self) -> float:
        """Log evidence."""
        return self.fit[1].total

    @property
    def values(self) -> dict[str, float]:
        """Those that were fitted."""
        fitted = self.fit[0].stage.identify.to_dict()
        return {name: fitted[name] for name in self.begun}

    @property
    def is_itself(self) -> bool:
        """Whether it gives way, and is damped if it may be; at its smallest it is another law that does neither."""
        return all(value > SMALLEST * self.begun[name] for name, value in self.values.items())


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
    for name, displacements in _dry_frictions(tried, model):
        again = f"{name}.x_s" in tried.elastic
        more = ", once more beside " + " + ".join(model.key) if again else ""
        state.progress(f"whether {name} gives way before it slides{more}")
        before, settings, kept = model.total, (state.given, state.problem), None
        try:
            found = _found(tried, model, name, displacements)
            if found is not None and _is_better(found, model, tried.wander):
                _keep(tried, model, found)
                kept = found
        except (RuntimeError, ModelError, np.linalg.LinAlgError) as error:
            state.progress(f"{name} stays as it is: {error}")
        finally:  # also when interrupted
            if kept is None:
                state.given, state.problem = settings
        if kept is not None:
            replaced = True
            tried.elastic.update(kept.begun)
            state.remarks[:] = [r for r in state.remarks if not r.startswith(_of_part(name))]
            state.remarks.append(_remark(tried, model, name, kept, model.total - before, again=again))
            state.progress(state.remarks[-1])
    return replaced


def _is_better(found: _Elastic, model: TriedModel, wander: float) -> bool:
    """Tell whether the evidence is for another machine by more than it depends on where it is linearised.

    Where that of the machine as it is depends on that, and that of the other settles, the smaller error of a simulation
    suffices beside it: a simulation is not linearised.
    """
    rise = found.total - model.total
    if rise > max(POLICY.reach, wander + found.wander):
        return True
    scale = model.stage.identify.scale
    closer = misfit(found.fit[0].stage, scale) < (1.0 - POLICY.relevance) * misfit(model.stage, scale)
    return rise > POLICY.reach and found.wander <= POLICY.improvement and closer


def _dry_frictions(tried: TriedModels, model: TriedModel) -> list[tuple[str, list[float]]]:
    """Return the parts that may give way, and the displacements to try, if anything random was found.

    Those with a law that fades with speed; and, beside effects, those whose law was replaced where these were missing.
    """
    likelihood = model.likelihood
    assert likelihood is not None
    if not likelihood.noise.model.processes:
        return []
    system, linearised = likelihood.stage.system, likelihood.linearised
    parts = tried.state.given.model.components
    found = []
    for j in places_that_stick(linearised):
        place = system.places[j]
        (position, *_), (acceleration, *_) = place.motion_names()[0], place.motion_names()[-1]
        for name in (place.name, *place.also):
            if type(parts.get(name)) in ELASTIC or (model.key and f"{name}.x_s" in tried.elastic):
                runs = [linearised.nominal_outputs(i) for i in range(len(linearised.experiments))]
                travel = float(np.ptp(np.concatenate([r[f"place.{place.name}.{position}"] for r in runs])))
                square = np.mean(np.concatenate([r[f"place.{place.name}.{acceleration}"] for r in runs]) ** 2)
                reversal = 0.5 * float(np.sqrt(square)) * _interval(likelihood) ** 2
                found.append((name, _displacements(0.5 * travel, reversal)))
    return found


def _displacements(half: float, reversal: float) -> list[float]:
    """Return the displacements to try, smallest first.

    Parameters
    ----------
    half : float
        Of the travel.
    reversal : float
        How far it moves within one sampling interval of a reversal.

    Examples
    --------
    >>> [f"{x:.1e}" for x in _displacements(1.0, 0.01)]
    ['1.0e-04', '3.2e-04', '1.0e-03', '3.2e-03', '1.0e-02']
    >>> [f"{x:.1e}" for x in _displacements(1.0, 2e-5)]
    ['1.0e-05', '3.2e-05', '1.0e-04', '3.2e-04', '1.0e-03', '3.2e-03', '1.0e-02']
    """
    if not half > 0.0:
        return []
    least = min(LEAST, max(reversal / half, np.finfo(float).eps))
    steps = int(np.ceil(TO_A_DECADE * np.log10(LARGEST / least) - 1e-9))
    return [half * LARGEST * 10.0 ** (-k / TO_A_DECADE) for k in range(steps, -1, -1)]


def _interval(likelihood: StageLikelihood) -> float:
    """Return the median interval between the samples of the likelihood, s."""
    return float(np.median(np.concatenate([np.diff(r.time) for r in likelihood.noise.records])))


def _found(tried: TriedModels, model: TriedModel, part: str, displacements: Sequence[float]) -> _Elastic | None:
    """Return a model with the friction of a part elastic, and damped if the evidence is for that as well.

    None where neither is clearly more probable than the model.
    """
    assert model.likelihood is not None
    interval = _interval(model.likelihood)
    first = _best_start(tried, model, part, [(x,) for x in displacements])
    best = _likeliest(tried, first)
    damped = [(x, share * interval) for share in RELAXATIONS for x in displacements]
    other = _best_start(tried, model, part, damped)
    # the damped law contains the other: one that begins no better has nothing to add
    if first is None or best is None or (other is not None and other.total > first.total):
        lugre = _likeliest(tried, other)
        best = lugre if lugre is not None and (best is None or lugre.total > best.total + POLICY.reach) else best
    if best is None or best.total <= model.total + POLICY.reach:
        return None
    with _machine(tried.state, best.given, best.problem):
        way = tried.whole_way(*best.fit)
    return replace(best, fit=way.end, wander=way.wander)


def _best_start(tried: TriedModels, model: TriedModel, part: str, laws: Sequence[tuple[float, ...]]) -> _Elastic | None:
    """Return the model with the likeliest of some laws, each given by its displacement and relaxation time, if any.

    They are compared under the noise and the derivatives of the model as it is, for which a simulation suffices.
    """
    state, likelihood = tried.state, model.likelihood
    assert likelihood is not None
    given, problem = state.given, state.problem
    columns, std, offset = record_columns(likelihood.linearised, likelihood.noise.records, likelihood.held)
    filtered = [c.filtered(likelihood.noise.model) for c in columns]
    best: tuple[float, StageLikelihood, dict[str, float], tuple[Problem, Problem]] | None = None
    for law in laws:
        values = dict(zip((f"{part}.x_s", f"{part}.t_s"), law, strict=False))
        machine = _with_law(given, part, values), _with_law(problem, part, values)
        try:
            with _machine(state, *machine):
                there = _there(tried, model, values)
            residuals = there.linearised_at_first.residual().blocks
        except (RuntimeError, ModelError):
            continue
        records = [f.with_residual(residual) for f, residual in zip(filtered, residuals, strict=True)]
        reached = restricted_log_likelihoods(records, [(std, offset)])[0]
        if best is None or reached > best[0]:
            best = reached, there, values, machine
    if best is None:
        return None
    _, there, values, machine = best
    try:
        with _machine(state, *machine):
            evidence = tried.evidence_of(there)
    except (RuntimeError, ModelError, np.linalg.LinAlgError):
        return None
    return _Elastic(fit=(there, evidence), begun=values, given=machine[0], problem=machine[1])


def _likeliest(tried: TriedModels, start: _Elastic | None) -> _Elastic | None:
    """Return a model moved to its likeliest parameters, if it is still what it is then."""
    if start is None:
        return None
    with _machine(tried.state, start.given, start.problem):
        moved = replace(start, fit=tried.way_to_likeliest(*start.fit).end)
    return moved if moved.is_itself else None


@contextmanager
def _machine(state: SearchState, given: Problem, problem: Problem) -> Iterator[None]:
    """Let a search have another machine for a while."""
    before = state.given, state.problem
    state.given, state.problem = given, problem
    try:
        yield
    finally:
        state.given, state.problem = before


def _with_law(problem: Problem, part: str, values: dict[str, float]) -> Problem:
    """Return a problem whose machine has an elastic friction, with its values as uncertain parameters."""
    model = problem.model.copy()
    given = model.components[part]
    law = next(laws for fades, laws in ELASTIC.items() if type(given) in (fades, *laws))[len(values) - 1]
    own = {name.removeprefix(f"{part}."): value for name, value in values.items()}
    model.replace(part, law(coulomb=given.values["coulomb"], **own))
    more = [UncertainParameter(name=n, value=v, std=v, min=0.5 * SMALLEST * v) for n, v in values.items()]
    others = [q for q in problem.uncertain if q.name not in (f"{part}.x_s", f"{part}.t_s")]
    return replace(problem, model=model, uncertain=(*others, *more))


def _there(tried: TriedModels, model: TriedModel, more: dict[str, float]) -> StageLikelihood:
    """Return a model with the friction of the state's machine, at its parameters and some more."""
    assert model.likelihood is not None
    stage = model.stage
    fit = stage.identify
    values = FittedValues(fit.to_dict() | more, fit.own_values, fit.scale, fit.not_excited)
    other = tried.state.fitted(stage.name, stage.effects, None, dict(stage.noise), values=values, trial=True)
    return model.likelihood.neighbour(other)


def _keep(tried: TriedModels, model: TriedModel, found: _Elastic) -> None:
    """Let the search go on with a fit of another machine."""
    state, start = tried.state, tried.start
    assert start is not None
    state.given, state.problem = found.given, found.problem
    first = found.fit
    if model is not start:
        there = _there(tried, start, found.values)
        first = tried.way_to_likeliest(there, tried.evidence_of(there)).end
    likelihood = found.fit[0].with_richer_noise()
    model.likelihood, model.evidence = tried.way_to_likeliest(likelihood, tried.evidence_of(likelihood)).end
    model.at_likeliest = True
    if model is not start:
        start.likelihood, start.evidence, start.at_likeliest = first[0], first[1], True
        start.proposals, model.parent = None, start.key
        tried.keep_only(start, model)
    # it stands at its likeliest parameters, so the others are moved to theirs as well
    tried.wander, tried.moved = found.wander, True
    stage = start.stage
    state.stages[-1] = state.moved_to(stage, stage.identify.to_dict())


def _of_part(part: str) -> str:
    return f"The dry friction '{part}' of the model fades with speed."


def _remark(tried: TriedModels, model: TriedModel, part: str, found: _Elastic, rise: float, *, again: bool) -> str:
    """Return what a reader must know of the friction that was replaced, for the second time perhaps."""
    declared = tried.state.given.model.components[part].declarations
    fitted = model.stage.identify.to_dict()
    size, *relaxation = (fitted[name] for name in found.begun)
    how, law = "", "Dahl's law"
    if relaxation:
        how, law = f", damped with a relaxation time of {quantity_text(relaxation[0], 's', 2)},", "LuGre's law"
    over = f" over another such law, which was found without {' and '.join(model.key)}" if again else ""
    return (
        f"{_of_part(part)} That of the machine gives way elastically, by about "
        f"{quantity_text(size, declared['x_s'].unit, 2)}{how} before it slides "  # type: ignore[attr-defined]
        f"(log evidence {rise:+.0f}{over}). It is replaced by {law}, and what is missing was asked of that machine."
    )
