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

NAMED = "input_delay@drive"


def models(gain_of_law: float, gain_of_effect: float) -> dict[tuple[str, ...], TriedModel]:
    """Return the model without effects, beside which a law without a name gains so much, and that with an effect."""
    law: Any = SimpleNamespace(gain=gain_of_law, log_odds=0.0, announced=True, predicts=True, name="unknown_force@rail")
    found = []
    for key, total, unknown_law in (((), 0.0, law), ((NAMED,), gain_of_effect, None)):
        likelihood: Any = SimpleNamespace(stage=SimpleNamespace(effects=()))
        evidence = Evidence(log_likelihood=total, log_prior=0.0, log_odds=0.0)
        model = TriedModel(likelihood=likelihood, key=key, evidence=evidence, better=True, unknown_law=unknown_law)
        found.append(model)
    return {m.key: m for m in found}


@pytest.mark.parametrize(("more", "named"), [(POLICY.reach - 1.0, True), (POLICY.reach + 1.0, False), (-50.0, True)])
def test_a_named_effect_stays_where_a_law_without_a_name_is_as_good(monkeypatch, more, named):
    tried = models(100.0 + more, 100.0)
    state: Any = SimpleNamespace(progress=lambda text: None)
    trials: Any = SimpleNamespace(tried=SimpleNamespace(state=state, models=tried, start=tried[()]))
    announcement = Announcement(trials)
    monkeypatch.setattr(Announcement, "_ask_for_unknown_law", lambda self, model: None)
    monkeypatch.setattr("discrepancy.evidence.announcement.moves.drops", lambda model: [])
    best = announcement._beside_unknown_law(tried[(NAMED,)])
    assert best is tried[(NAMED,) if named else ()]
    # the probabilities say the same
    shown = posterior(tried, list(best.key), None)
    assert (shown.models[(NAMED,)] > shown.models[("unknown_force@rail",)]) is named
