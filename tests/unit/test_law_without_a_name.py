"""What has no name takes the place of a named effect only where it explains the records clearly better."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from discrepancy.evidence.announcement import Announcement
from discrepancy.evidence.criterion import Evidence
from discrepancy.evidence.moves import TriedModel
from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.posterior import posterior
from discrepancy.evidence.predictive import PredictiveGain
from discrepancy.evidence.unknown_law import Source, StateFunction, UnknownLaw

NAMED = "input_delay@drive"


def law(where: str, gain: float, share: float = 0.5) -> UnknownLaw:
    """Return a force without a name that gains so much; it passes all tests if it has a large share of an error."""
    source = Source(where=where, acts_on="connection", index=0, unit=1.0)
    return UnknownLaw(
        functions=(StateFunction(source=source, signals=("cart.v",), size=1.0),),
        gain=gain,
        log_odds=0.0,
        share={"cart.v": share},
        samples=100_000,
        predictive=PredictiveGain(gain=gain, standard_error=1.0, blocks=8, parts=8),
    )


def models(
    gain_of_law: float, gain_of_effect: float, beside: UnknownLaw | None = None
) -> dict[tuple[str, ...], TriedModel]:
    """Return the model without effects, beside which a law without a name gains so much, and that with an effect.

    The latter has another law beside it, or none.
    """
    found = []
    for key, total, unknown_law in (((), 0.0, law("rail", gain_of_law)), ((NAMED,), gain_of_effect, beside)):
        likelihood: Any = SimpleNamespace(stage=SimpleNamespace(effects=()))
        evidence = Evidence(log_likelihood=total, log_prior=0.0, log_odds=0.0)
        model = TriedModel(likelihood=likelihood, key=key, evidence=evidence, better=True, unknown_law=unknown_law)
        found.append(model)
    return {m.key: m for m in found}


def answer_of(monkeypatch: pytest.MonkeyPatch, tried: dict[tuple[str, ...], TriedModel]) -> TriedModel:
    """Return what of the model with the effect is announced."""
    state: Any = SimpleNamespace(progress=lambda text: None)
    of_all = SimpleNamespace(state=state, models=tried, start=tried[()], doubt=lambda: None)
    trials: Any = SimpleNamespace(tried=of_all)
    announcement = Announcement(trials)
    monkeypatch.setattr(Announcement, "_ask_for_unknown_law", lambda self, model: None)
    monkeypatch.setattr(Announcement, "_ask_for_a_second_place", lambda self, model: None)
    monkeypatch.setattr("discrepancy.evidence.announcement.moves.drops", lambda model: [])
    return announcement._beside_unknown_law(tried[(NAMED,)])


@pytest.mark.parametrize(("more", "named"), [(POLICY.reach - 1.0, True), (POLICY.reach + 1.0, False), (-50.0, True)])
def test_a_named_effect_stays_where_a_law_without_a_name_is_as_good(monkeypatch, more, named):
    tried = models(100.0 + more, 100.0)
    best = answer_of(monkeypatch, tried)
    assert best is tried[(NAMED,) if named else ()]
    # the probabilities say the same
    shown = posterior(tried, list(best.key), None)
    assert (shown.models[(NAMED,)] > shown.models[("unknown_force@rail",)]) is named


@pytest.mark.parametrize(
    ("where", "adds", "named"),
    [("rail", -3.0, False), ("rail", 3.0, True), ("drive", -3.0, True), ("drive", -13.0, False)],
)
def test_a_named_effect_must_add_something_to_a_law_that_stands_beside_it(monkeypatch, where, adds, named):
    """A law at another place stands for something else: the effect is the only one of the two that was fitted there."""
    tried = models(200.0, 60.0, beside=law(where, 140.0 + adds))
    best = answer_of(monkeypatch, tried)
    assert best is tried[(NAMED,) if named else ()]
    shown = posterior(tried, list(best.key), None)
    with_name = shown.models[(NAMED,)] + shown.models[(NAMED, f"unknown_force@{where}")]
    assert (with_name > shown.models[("unknown_force@rail",)]) is named


@pytest.mark.parametrize(
    ("where", "left", "named"), [("rail", 150.0, True), ("rail", 100.0, False), ("drive", 150.0, False)]
)
def test_what_a_law_gains_beside_the_effect_as_well_does_not_speak_against_it(monkeypatch, where, left, named):
    """Too little of it is left there to be announced, and yet all records show it: 200 - 150 nats are less than 60."""
    beside = law(where, left, share=1e-4)
    assert not beside.announced
    tried = models(200.0, 60.0, beside=beside)
    best = answer_of(monkeypatch, tried)
    assert best is tried[(NAMED,) if named else ()]
    shown = posterior(tried, list(best.key), None)
    assert (shown.models[(NAMED,)] > shown.models[("unknown_force@rail",)]) is named


@pytest.mark.parametrize(("more", "named"), [(POLICY.reach - 1.0, True), (2.0 * POLICY.reach + 1.0, False)])
def test_of_a_law_in_place_of_an_effect_no_more_holds_than_of_the_effect(monkeypatch, more, named):
    """Half of what an effect of 100 nats gains is doubted, and half of what stands in its place."""
    tried = models(100.0 + more, 100.0)
    tried[(NAMED,)].overstated = 50.0
    assert tried[()].gain_of_law(tried[(NAMED,)]) == pytest.approx(50.0 + 0.5 * more - POLICY.reach)
    best = answer_of(monkeypatch, tried)
    assert best is tried[(NAMED,) if named else ()]
    shown = posterior(tried, list(best.key), None)
    if named:
        assert shown.models[(NAMED,)] > shown.models[("unknown_force@rail",)]
