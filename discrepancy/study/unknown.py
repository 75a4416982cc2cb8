"""The force that a study's latest model lacks at a place, and a free curve of it as an effect."""

from __future__ import annotations

from typing import TYPE_CHECKING

from discrepancy.effects.effect import Effect
from discrepancy.questions.unknown_force import UnknownForce, describe_force
from discrepancy.search.state import SearchState
from discrepancy.sensitivities.free_curve_scan import free_curve
from discrepancy.stages.force_estimate import estimate_force
from multibody.base.spelling import nearest

if TYPE_CHECKING:
    from multibody.assembly.places import Place

__all__ = ["curve_at", "force_at"]


def force_at(state: SearchState, where: str) -> UnknownForce:
    """Return the force at a place that would explain all of the residual, what it depends on and which laws are near.

    Raises
    ------
    KeyError
        If there is no such place.
    """
    stage, place = state.stage, _place(state, where)

    def described() -> UnknownForce:
        state.progress(f"the force at {where} over time")
        return describe_force(state, estimate_force(stage, place, explain_all=True))

    return stage.once(("force at", where), described)


def curve_at(state: SearchState, where: str, over: str) -> Effect:
    """Return the free curve at a place over an argument as an effect, at the height that its score lets expect.

    Raises
    ------
    KeyError
        If there is no such place or argument.
    """
    _place(state, where)
    stage, problem = state.stage, state.problem
    seed = problem.seed + len(state.stages)
    return free_curve(stage.weighted_problem(), stage.effects, where, over, level=problem.level, seed=seed)


def _place(state: SearchState, where: str) -> Place:
    places = {p.name: p for p in state.stage.system.places}
    if where not in places:
        raise KeyError(f"the model has no place '{where}'{nearest(where, list(places))}")
    return places[where]
