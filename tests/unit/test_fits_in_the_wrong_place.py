"""A fit that ends far below what its score promised is also asked near the strengths that the score lets expect."""

from __future__ import annotations

import math
from collections.abc import Sequence
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

DRAG, RUB = (
    Effect(kind=kind, where="shaft", strengths={name: 1.0})
    for kind, name in (("quadratic_drag", "drag"), ("coulomb_friction", "coulomb"))
)


def place(evidence: float) -> Any:
    """A stage with so much log evidence."""
    return SimpleNamespace(effects=(DRAG,), evidence=evidence)


def tried_model(effects: tuple[Effect, ...], total: float = 0.0) -> TriedModel:
    likelihood: Any = SimpleNamespace(
        stage=None, neighbour=lambda stage, noise: SimpleNamespace(likeliest_values=dict), free_memory=lambda: None
    )
    evidence = Evidence(log_likelihood=total, log_prior=0.0, log_odds=0.0)
    return TriedModel(likelihood=likelihood, key=key_of(effects), evidence=evidence)


def fitted(
    monkeypatch: pytest.MonkeyPatch,
    *,
    at_the_fit: float | None,
    near_expected: float,
    promised: float = math.inf,
    parent: tuple[Effect, ...] = (),
    others: Sequence[TriedModel] = (),
) -> TriedModel:
    """Fit drag beside a parent of log evidence 0, with such evidence at the fit and near the expected strengths."""
    state: Any = SimpleNamespace(
        progress=lambda text: None, unfitted=lambda *given: None, moved_to=lambda *given, trial: place(near_expected)
    )
    tried = TriedModels(state)
    tried.prior = ModelPrior(candidates=9, shapes={}, stated={})
    tried.models = {m.key: m for m in others}

    def with_noise(self: Trials, stage: Any, *given: Any) -> tuple[Any, Evidence]:
        return tried_model((DRAG,)).likelihood, Evidence(log_likelihood=stage.evidence, log_prior=0.0, log_odds=0.0)

    monkeypatch.setattr(Trials, "_best_fit", lambda *given: None if at_the_fit is None else place(at_the_fit))
    monkeypatch.setattr(Trials, "_with_noise", with_noise)
    monkeypatch.setattr(Trials, "_with_likeliest_shapes", lambda self, likelihood, evidence: (likelihood, evidence))
    proposal = Proposal(move="add", effects=(DRAG,), promised=promised)
    return Trials(tried)._trial(proposal, tried_model(parent), look=False, first=True)


@pytest.mark.parametrize(
    ("at_the_fit", "promised", "total"),
    [
        (-POLICY.reach - 1.0, math.inf, 9.0),  # no effect costs so much
        (-POLICY.reach + 1.0, math.inf, 1.0 - POLICY.reach),
        (7.0, 20.0, 9.0),  # of twenty nats
        (9.0, 20.0, 9.0),
        (60.0, 100.0, 60.0),  # there it is worse still
        (None, 5.0, 9.0),
    ],
)
def test_the_likelier_place_is_taken_where_the_fit_is_far_below(monkeypatch, at_the_fit, promised, total):
    model = fitted(monkeypatch, at_the_fit=at_the_fit, near_expected=9.0, promised=promised)
    assert model.total == total
    assert model.at_likeliest is (total == 9.0 and at_the_fit != 9.0)


def test_what_lacks_an_effect_of_its_parent_is_compared_with_what_it_holds(monkeypatch):
    fit = {"at_the_fit": -50.0, "near_expected": 9.0, "parent": (RUB,)}
    assert fitted(monkeypatch, **fit).total == -50.0, "it may lie anywhere below its parent"
    assert fitted(monkeypatch, **fit, others=[tried_model((), -45.0)]).total == -50.0
    assert fitted(monkeypatch, **fit, others=[tried_model((), -30.0)]).total == 9.0


def test_a_rise_above_what_the_score_promises_is_not_believed(monkeypatch):
    model = fitted(monkeypatch, at_the_fit=None, near_expected=500.0, promised=5.0)
    assert model.likelihood is None
    assert "another linearisation" in model.outcome
    kept = fitted(monkeypatch, at_the_fit=-20.0, near_expected=500.0, promised=5.0)
    assert kept.total == -20.0


@pytest.mark.parametrize(
    ("misfit", "at_likeliest", "again"),
    [
        (1.0 - 2.0 * POLICY.relevance, False, True),
        (1.0 - 0.5 * POLICY.relevance, False, False),
        (0.5, True, False),  # it was moved there on purpose
    ],
)
def test_the_first_model_is_calibrated_again_where_its_likeliest_parameters_fit_better(
    monkeypatch, misfit, at_likeliest, again
):
    def stage_with(square: float) -> Any:
        return SimpleNamespace(
            identify=SimpleNamespace(scale={"speed": 2.0}), effects=(), rmse=lambda part: {"speed": 2.0 * square**0.5}
        )

    there = stage_with(misfit)
    state: Any = SimpleNamespace(moved_to=lambda stage, values, trial: there)
    likelihood: Any = SimpleNamespace(
        stage=stage_with(1.0), likeliest_values=dict, neighbour=lambda stage: SimpleNamespace(stage=stage)
    )
    first = TriedModel(likelihood=likelihood, key=(), evidence=None, at_likeliest=at_likeliest)
    begun: list[Any] = []
    monkeypatch.setattr(
        Trials, "fit_from", lambda self, model, other, effects: begun.append((model.stage, other)) or True
    )
    assert Trials(TriedModels(state)).calibrate_again(first) is again
    assert begun == ([(there, first)] if again else [])
