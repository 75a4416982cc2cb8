"""A model far below the best where its fit would begin is not fitted, unless the linear problem cannot tell."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from discrepancy.effects.effect import Effect
from discrepancy.evidence.criterion import Evidence, ModelPrior
from discrepancy.evidence.moves import TriedModel, key_of
from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.proposals import Proposal
from discrepancy.evidence.trials import Trials
from discrepancy.evidence.tried_models import TriedModels

DRAG, PLAY = (
    Effect(kind=kind, where="shaft", strengths={name: 1.0})
    for kind, name in (("quadratic_drag", "drag"), ("backlash", "gap"))
)
EXCHANGE = Proposal(move="exchange", effects=(DRAG,))


def evidence(total: float) -> Evidence:
    return Evidence(log_likelihood=total, log_prior=0.0, log_odds=0.0)


def left_unfitted(
    monkeypatch: pytest.MonkeyPatch, total: float, proposal: Proposal = EXCHANGE, best: float = 50.0
) -> bool:
    """Ask of a model with so much evidence where its fit would begin; nothing has none, another model the best."""
    there = SimpleNamespace(free_memory=lambda: None)
    likelihood = SimpleNamespace(stage=None, neighbour=lambda stage, noise: there)
    state: Any = SimpleNamespace(unfitted=lambda *given: None, progress=lambda text: None)
    monkeypatch.setattr(TriedModels, "evidence_of", lambda self, likelihood: evidence(total))
    tried = TriedModels(state)
    tried.prior = ModelPrior(candidates=9, shapes={}, stated={})
    nothing = TriedModel(likelihood=likelihood, key=(), evidence=evidence(0.0))  # type: ignore[arg-type]
    other = TriedModel(likelihood=None, key=("other@shaft",), evidence=evidence(best))
    tried.models = {m.key: m for m in (nothing, other)}
    model = TriedModel(likelihood=None, key=key_of(proposal.effects), evidence=None)
    answer = Trials(tried)._is_hopeless(model, proposal, nothing)
    assert answer is not model.in_full
    assert (model.likelihood is there) is answer
    return answer


def test_far_below_the_best_it_is_not_fitted(monkeypatch):
    assert left_unfitted(monkeypatch, 50.0 - 2.0 * POLICY.reach - 5.0)
    assert not left_unfitted(monkeypatch, 50.0 - 2.0 * POLICY.reach + 5.0)


def test_the_more_the_best_has_gained_the_more_a_linear_gain_may_be_off(monkeypatch):
    assert not left_unfitted(monkeypatch, 1000.0 - POLICY.linear_error * 1000.0, best=1000.0)
    assert left_unfitted(monkeypatch, 1000.0 - POLICY.linear_error * 1000.0 - 2.0 * POLICY.reach, best=1000.0)


@pytest.mark.parametrize("total", [-2.0 * POLICY.reach, -math.inf, math.nan])
def test_below_the_model_without_effects_the_linear_problem_is_wrong(monkeypatch, total):
    assert not left_unfitted(monkeypatch, total)


@pytest.mark.parametrize(
    "proposal",
    [
        replace(EXCHANGE, effects=(PLAY,)),
        replace(EXCHANGE, promised=3.0),
        replace(EXCHANGE, new_noise=True),
        replace(EXCHANGE, starts=((DRAG,),)),
    ],
    ids=["not linear in its strength", "scored", "in place of what is random", "several starts"],
)
def test_what_the_linear_problem_does_not_tell_is_fitted(monkeypatch, proposal):
    assert not left_unfitted(monkeypatch, 0.0, proposal)
