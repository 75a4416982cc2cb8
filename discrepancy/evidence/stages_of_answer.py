"""The stages of the answer: one for each effect, in the order in which they raise the evidence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from discrepancy.evidence.moves import TriedModel, key_of
from discrepancy.evidence.parameter_errors import with_errors_of_likelihood
from discrepancy.evidence.posterior import rivals_of
from discrepancy.evidence.tried_models import TriedModels
from discrepancy.stages.fit_stage import with_validation
from discrepancy.stages.stage import AcceptedEffect

if TYPE_CHECKING:
    from discrepancy.effects.effect import Effect
    from discrepancy.stages.stage import Stage

__all__ = ["make_stages"]


def make_stages(tried: TriedModels, start: TriedModel, best: TriedModel) -> None:
    """Make the stages of the best model, one for each effect, in the order in which they raise the evidence."""
    state = tried.state
    _make_start_again(tried, start)
    _keep_scans(tried)
    if best.likelihood is None or best.key == start.key:
        return
    had = {str(e) for e in start.stage.effects}
    order = _order(tried, [e for e in best.stage.effects if str(e) not in had])
    effects = tuple(e for e in best.stage.effects if str(e) in had)
    names = {str(e) for e in effects}
    for effect in order:
        names.add(str(effect))
        effects = tuple(e for e in best.stage.effects if str(e) in names)
        state.progress(f"add {effect}")
        stage = _with_some(tried, effects, tried.models.get(key_of(effects)), best)
        fitted = next(e for e in stage.effects if str(e) == str(effect))
        others = (*(e for e in stage.effects if e is not fitted), fitted)
        gain = tried.total_of(effects) - tried.total_of(state.stages[-1].effects)
        accepted = AcceptedEffect(
            effect=fitted,
            p_value=_p_value(tried, str(fitted)),
            delta_bic=-2.0 * gain,
            rivals=rivals_of(best, str(fitted), tried.models, start.proposals, best.proposals),
        )
        state.stages.append(replace(stage, name=f"+ {effect}", effects=others, accepted=accepted))
        _keep_scans(tried)
        state.save()


def _with_some(tried: TriedModels, effects: tuple[Effect, ...], model: TriedModel | None, best: TriedModel) -> Stage:
    """Return the stage of some of the best model's effects, from where the model with just these stands."""
    if model is not None and model.likelihood is not None:
        stage = tried.as_reported(model)
        errors = tried.errors_of(model) if model.at_likeliest else None
        return with_errors_of_likelihood(stage, errors) if errors is not None else stage
    name = " + ".join(map(str, effects))
    try:
        return tried.state.fitted(name, effects, best.stage, best.stage.noise)
    except RuntimeError as error:
        tried.state.progress(f"{name} could not be fitted: {error}")
        return with_validation(tried.state.problem, best.stage)


def _make_start_again(tried: TriedModels, start: TriedModel) -> None:
    """Make the stage that the search began with again, where a better fit of it was found on trial."""
    before = tried.state.stages[-1]
    if start.likelihood is None or (stage := tried.as_reported(start)) is before:
        return
    tried.state.stages[-1] = replace(stage, name=before.name, accepted=before.accepted, notes=before.notes)
    tried.state.save()


def _keep_scans(tried: TriedModels) -> None:
    """Give the latest stage the scores of its candidates, if its model was extended."""
    stages = tried.state.stages
    model = tried.models.get(key_of(stages[-1].effects))
    if model is not None and model.proposals is not None:
        stages[-1] = replace(stages[-1], scan=model.proposals.scan)


def _order(tried: TriedModels, effects: Sequence[Effect]) -> list[Effect]:
    """Return effects in the order in which the search can have added them."""

    def alone(effect: Effect) -> float:
        model = tried.models.get(key_of([effect]))
        return model.total if model is not None else -math.inf

    return sorted(effects, key=lambda e: -alone(e))


def _p_value(tried: TriedModels, name: str) -> float:
    """Return the smallest family-wise p-value with which a candidate was scored at any step."""
    found = [r.p_value for d in tried.state.decisions for s in d.scans for r in s.rows if r.name == name]
    return min(found, default=1.0)
