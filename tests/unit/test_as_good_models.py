"""Where records held out refuse the best model, one that the other records cannot tell from it is asked."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from discrepancy.evidence import moves
from discrepancy.evidence.announcement import Announcement
from discrepancy.evidence.moves import TriedModel
from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.posterior import posterior
from discrepancy.evidence.trials import Trials
from discrepancy.evidence.tried_models import TriedModels


def model(name: str, total: float) -> TriedModel:
    evidence: Any = SimpleNamespace(total=total, log_odds=0.0)
    return TriedModel(
        likelihood=SimpleNamespace(),
        key=(name,) if name else (),
        evidence=evidence,
        better=True,
        parent=() if name else None,
    )


def asked(monkeypatch: pytest.MonkeyPatch, refused: set[str], **totals: float) -> tuple[Announcement, TriedModel]:
    """Return what is announced of models of which the records held out refuse some."""
    state: Any = SimpleNamespace(progress=lambda text: None)
    tried = TriedModels(state)
    start = model("", 0.0)
    tried.models = {m.key: m for m in (start, *(model(name, total) for name, total in totals.items()))}
    announcement = Announcement(Trials(tried))

    def confirmed(best: TriedModel) -> TriedModel:
        if not refused & set(best.key):
            return best
        best.unconfirmed = True
        best.refuse("refused", start)
        announcement.unconfirmed.append(best.name)
        return start

    best = tried.ranked()[0]
    others = [m for m in tried.models.values() if m.key and m is not best]
    monkeypatch.setattr(moves, "twins", lambda model, source: [SimpleNamespace(effects=m.key) for m in others])
    monkeypatch.setattr(announcement, "_simplifications", lambda model: [])
    monkeypatch.setattr(announcement.trials, "fitted_once", lambda model, proposals: others)
    monkeypatch.setattr(announcement, "_kept_by_prediction", lambda best: best)
    monkeypatch.setattr(announcement, "_confirmed", confirmed)
    monkeypatch.setattr(announcement, "_beside_unknown_law", lambda best: best)
    return announcement, announcement.of(best)


@pytest.mark.parametrize(
    ("refused", "other", "answer"),
    [
        ({"rub"}, 99.5, ("drag",)),
        ({"rub"}, 100.0 - POLICY.improvement - 0.1, ()),
        ({"rub", "drag"}, 99.5, ()),
        (set(), 99.5, ("rub",)),
    ],
)
def test_another_as_good_is_asked(monkeypatch, refused, other, answer):
    announcement, best = asked(monkeypatch, refused, rub=100.0, drag=other)
    assert best.key == answer
    assert bool(announcement.unconfirmed) is (answer == ())


def test_a_model_that_the_search_has_tried_is_asked_as_well(monkeypatch):
    """Two sensors drift alike but for the records held out: that the other was tried beside a gain suffices."""
    announcement, _ = asked(monkeypatch, {"gain", "tank"}, gain=1.0)
    both, other, fewer = model("tank", 100.0), model("water", 99.5), model("gain", 99.0)
    both.key, other.key = ("gain", "tank"), ("gain", "water")
    announcement.trials.tried.models |= {m.key: m for m in (both, other, fewer)}
    monkeypatch.setattr(moves, "twins", lambda model, source: [])
    assert announcement._as_good(both) == [other]


def test_what_was_refused_keeps_its_probability_beside_the_answer(monkeypatch):
    announcement, best = asked(monkeypatch, {"rub"}, rub=100.0, drag=100.0)
    shares = posterior(announcement.trials.tried.models, best.key, None).models
    assert shares["rub",] == pytest.approx(0.5, abs=1e-9)
    assert shares["drag",] == pytest.approx(0.5, abs=1e-9)


def test_what_the_answer_is_a_part_of_counts_for_the_answer():
    both, one, start = model("", 100.0), model("drag", 90.0), model("", 0.0)
    both.key, both.unconfirmed = ("drag", "rub"), True
    both.refuse("refused", one)
    models = {m.key: m for m in (start, one, both)}
    assert posterior(models, one.key, None).models["drag",] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(
    ("gain", "promised", "counts"), [(60.0, -math.inf, 10.0), (40.0, -math.inf, 0.0), (60.0, 60.0, 60.0)]
)
def test_what_another_linearisation_changes_is_no_evidence(gain, promised, counts):
    start, drag = model("", 0.0), model("drag", gain)
    drag.promised = promised
    shares = posterior({m.key: m for m in (start, drag)}, (), None, wander=50.0, temperature=1.0).models
    assert shares["drag",] / shares[()] == pytest.approx(math.exp(counts))


def test_the_laws_that_do_best_without_random_forces_are_fitted_once(monkeypatch):
    def candidate(name: str) -> Any:
        return SimpleNamespace(name=name)

    monkeypatch.setattr(moves, "proposed_effects", lambda c, effects: c.name)
    proposals: Any = SimpleNamespace(
        instead=(), ahead=lambda: [candidate("drag")], if_none_random=(candidate("rub"), candidate("drag"))
    )
    assert moves.additions(proposals, ()) == ["drag"]
    assert moves.additions(proposals, (), if_none_random=True) == ["drag", "rub"]


@pytest.mark.parametrize("owned_at", [(), ("rub",)])
def test_a_simpler_law_is_asked_unless_the_machine_has_it_as_a_parameter(monkeypatch, owned_at):
    """Beside a law that contains it, its strength is a parameter of the model: that does not count."""
    tried = TriedModels(SimpleNamespace())  # type: ignore[arg-type]
    start, rich = model("", 0.0), model("rub", 100.0)
    tried.models = {m.key: m for m in (start, rich)}
    for each in (start, rich):
        each.proposals = SimpleNamespace(owned={"drag": "rub.forward"} if each.key == owned_at else {})  # type: ignore[assignment]
    offer = SimpleNamespace(effects=("drag",))
    monkeypatch.setattr(moves, "simplifications", lambda best: [offer])
    assert Announcement(Trials(tried))._simplifications(rich) == ([] if owned_at == () else [offer])


def test_what_comes_apart_from_an_effect_is_offered_in_its_place(monkeypatch):
    """Two delays look alike where neither is in the model; beside one of them a third still does."""
    names = {"input_delay": ["sensor_delay", "sensor_lag"]}
    source: Any = SimpleNamespace(twins=lambda name: [SimpleNamespace(name=n) for n in names.get(name, [])])
    effect = "input_delay"
    best = model("input_delay", 100.0)
    best.likelihood = SimpleNamespace(stage=SimpleNamespace(effects=(effect,)))  # type: ignore[assignment]
    monkeypatch.setattr(moves, "proposed_effects", lambda c, effects: SimpleNamespace(effects=(c.name,)))
    assert [p.effects for p in moves.twins(best, source)] == [("sensor_delay",), ("sensor_lag",)]
    assert [p.effects for p in moves.twins(best, source, {"input_delay": {"sensor_lag"}})] == [("sensor_delay",)]
    assert moves.twins(best, None) == []
