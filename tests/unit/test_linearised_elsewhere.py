"""Where evidence changes with the linearisation, models stand where it is largest, and effects must gain more."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from discrepancy.evidence import tried_models as module
from discrepancy.evidence.criterion import Evidence
from discrepancy.evidence.moves import TriedModel
from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.tried_models import TriedModels, judge


def evidence(total: float) -> Evidence:
    return Evidence(log_likelihood=total, log_prior=0.0, log_odds=0.0)


def likelihood(at: float) -> Any:
    stage = SimpleNamespace(effects=())
    return SimpleNamespace(
        at=at, stage=stage, linearised=None, noise=SimpleNamespace(model=SimpleNamespace(processes=[1]))
    )


def walked(monkeypatch: pytest.MonkeyPatch, *totals: float, sticks: bool = True) -> tuple[TriedModels, TriedModel]:
    """Let the first model, of log evidence 0, have these ones at its steps to the likeliest parameters."""
    state: Any = SimpleNamespace(progress=lambda text: None)
    models = TriedModels(state)
    monkeypatch.setattr(module, "places_that_stick", lambda linearised: [0] if sticks else [])
    monkeypatch.setattr(
        TriedModels, "_steps_to_likeliest", lambda self, given: ((likelihood(t), evidence(t)) for t in totals)
    )
    first = TriedModel(likelihood=likelihood(0.0), key=(), evidence=evidence(0.0))
    models._measure_wander(first)
    return models, first


def test_the_first_model_stands_where_it_is_most_probable(monkeypatch):
    models, first = walked(monkeypatch, 25.0, 18.0, 35.0)
    assert first.total == 35.0
    assert first.at_likeliest
    assert models.wander == 17.0, "the first step leads away from least squares and is not counted"


@pytest.mark.parametrize(
    ("totals", "sticks"),
    [((0.9 * POLICY.improvement, 30.0), True), ((25.0, 18.0), False), ((), True), ((-7.0, -6.4, -6.6), True)],
)
def test_a_model_that_is_nearly_linear_stays_where_it_was_fitted(monkeypatch, totals, sticks):
    models, first = walked(monkeypatch, *totals, sticks=sticks)
    assert first.total == 0.0
    assert not first.at_likeliest
    assert not models.moved
    assert models.at_likelier_parameters(likelihood(0.0), evidence(-100.0)) is None


def test_others_follow_while_they_become_more_probable(monkeypatch):
    models, _ = walked(monkeypatch, 25.0, 18.0, 35.0)
    found = models.at_likelier_parameters(likelihood(0.0), evidence(10.0))
    assert found is not None
    assert found[1].total == 25.0
    assert models.at_likelier_parameters(likelihood(0.0), evidence(24.0)) is None


@pytest.mark.parametrize(
    ("gain", "promised", "outcome"),
    [
        (17.1, -math.inf, "better"),
        (16.9, -math.inf, "another linearisation"),
        (16.9, POLICY.reach, "another linearisation"),
        (16.9, POLICY.reach + 0.1, "better"),
        (2.0, 100.0, "not better"),
    ],
)
def test_an_effect_must_gain_more_than_another_linearisation(monkeypatch, gain, promised, outcome):
    """Unless its score promises enough, for which both models are linearised alike."""
    monkeypatch.setattr(module.moves, "why_irrelevant", lambda model, parent: "")
    parent = TriedModel(likelihood=likelihood(0.0), key=(), evidence=evidence(0.0))
    model = TriedModel(likelihood=likelihood(0.0), key=("drag@shaft",), evidence=evidence(gain))
    model.likelihood.stage.effects = ("drag@shaft",)  # type: ignore[union-attr]
    model.promised = promised
    judge(model, parent, 17.0)
    assert outcome in model.outcome
    assert model.better is (outcome == "better")
