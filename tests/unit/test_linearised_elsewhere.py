"""Where evidence changes with the linearisation, models stand where it is largest, and effects must gain more."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest

from discrepancy.evidence import tried_models as module
from discrepancy.evidence.criterion import Evidence
from discrepancy.evidence.moves import TriedModel
from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.trials import Trials
from discrepancy.evidence.tried_models import TriedModels, judge


def evidence(total: float) -> Evidence:
    return Evidence(log_likelihood=total, log_prior=0.0, log_odds=0.0)


@dataclass(eq=False)
class _Place:
    """What stands at a log evidence, and by how much the linearised problem says that it rises."""

    at: float
    rise_to_likeliest: float
    stage: Any = field(default_factory=lambda: SimpleNamespace(effects=(), identify=SimpleNamespace(to_dict=dict)))
    as_it_stands: bool = False
    given_noise: Any = None
    linearised: Any = None
    noise: Any = field(default_factory=lambda: SimpleNamespace(model=SimpleNamespace(processes=[1])))

    def neighbour(self, at: float) -> _Place:
        return _Place(at, 2.0 * POLICY.improvement)

    def free_memory(self) -> None: ...


def likelihood(at: float, *, settled: bool = False) -> Any:
    """Return what stands at a log evidence, and whether a further step would change nothing."""
    return _Place(at, 0.0 if settled else 2.0 * POLICY.improvement)


def walked(
    monkeypatch: pytest.MonkeyPatch,
    *totals: float,
    sticks: bool = True,
    settles: bool = False,
    stated: float = -math.inf,
) -> tuple[TriedModels, TriedModel]:
    """Let the first model, of log evidence 0, have these ones at its steps to the likeliest parameters.

    ``settles`` after the last of them; ``stated`` is the evidence at the parameters as stated.
    """
    problem = SimpleNamespace(uncertain=())
    state: Any = SimpleNamespace(
        progress=lambda text: None, problem=problem, moved_to=lambda stage, values, trial: stated
    )
    models = TriedModels(state)
    monkeypatch.setattr(module, "places_that_stick", lambda linearised: [0] if sticks else [])
    monkeypatch.setattr(TriedModels, "evidence_of", lambda self, given: evidence(given.at))

    def steps(self: TriedModels, given: Any) -> Any:
        last = len(totals) - 1
        return ((likelihood(t, settled=settles and k == last), evidence(t)) for k, t in enumerate(totals))

    monkeypatch.setattr(TriedModels, "_steps_to_likeliest", steps)
    first = TriedModel(likelihood=likelihood(0.0), key=(), evidence=evidence(0.0))
    models._settle(first)
    return models, first


def test_the_first_model_stands_where_it_is_most_probable(monkeypatch):
    models, first = walked(monkeypatch, 25.0, 18.0, 35.0)
    assert first.total == 35.0
    assert first.at_likeliest
    assert models.wander == 17.0, "the first step leads away from least squares and is not counted"


def test_a_rise_that_no_step_has_brought_is_none(monkeypatch):
    """A free curve promised 5469 nats at other values of its points; the step there lost 4481."""
    models, _ = walked(monkeypatch, 25.0, 18.0, 35.0)
    monkeypatch.setattr(
        TriedModels, "evidence_of", lambda self, p: evidence(p.at - p.as_it_stands * p.rise_to_likeliest)
    )
    monkeypatch.setattr(
        TriedModels, "_steps_to_likeliest", lambda self, given: iter([(_Place(28853.0, 508.0), evidence(28853.0))])
    )
    curve = _Place(33334.0, 5469.0)
    curve.stage.effects = ("unknown_force@nut",)
    found = models.at_likelier_parameters(curve, evidence(33334.0))  # type: ignore[arg-type]
    assert found is not None
    assert found[0].as_it_stands
    assert found[1].total == 28853.0 - 508.0
    curve.stage.effects = ()  # the model without effects has the benefit of the doubt
    assert models.at_likelier_parameters(curve, evidence(33334.0)) is None  # type: ignore[arg-type]


def test_where_the_evidence_settles_it_counts_though_least_squares_seemed_better(monkeypatch):
    models, first = walked(monkeypatch, -7.0, -6.5, settles=True)
    assert first.total == -6.5
    assert first.at_likeliest
    assert models.wander == 0.0


def test_the_parameters_as_stated_may_be_the_better_place_to_begin(monkeypatch):
    models, first = walked(monkeypatch, 25.0, 18.0, 35.0, stated=200.0)
    assert first.total == 200.0
    assert models.moved


@pytest.mark.parametrize(("totals", "sticks"), [((0.9 * POLICY.improvement,), True), ((25.0, 18.0), False), ((), True)])
def test_a_model_that_is_nearly_linear_stays_where_it_was_fitted(monkeypatch, totals, sticks):
    models, first = walked(monkeypatch, *totals, sticks=sticks, settles=True)
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
    ("totals", "settles", "ends"),
    [((25.0,), True, 25.0), ((-4.0,), True, -4.0), ((-4.0,), False, 0.0), ((), True, 0.0)],
)
def test_rivals_are_compared_at_their_likeliest_parameters(monkeypatch, totals, settles, ends):
    """Also where that makes one less probable; where it does not settle only if it is more so."""
    models, first = walked(monkeypatch, *totals, sticks=False, settles=settles)
    models.move_to_likeliest(first)
    assert first.total == ends
    assert first.at_likeliest is (ends != 0.0)
    assert (first.by_least_squares is None) is (ends == 0.0)


def test_a_model_without_random_forces_is_where_it_is_likeliest(monkeypatch):
    models, first = walked(monkeypatch, 25.0, sticks=False, settles=True)
    first.likelihood.noise.model.processes = ()
    models.move_to_likeliest(first)
    assert first.total == 0.0


@pytest.mark.parametrize(
    ("totals", "moved"),
    [
        ((300.0, 280.0, 100.0), ["nothing", "a", "b"]),
        ((20.0, 15.0, 7.0), ["nothing", "a", "b"]),
        ((2.0, 1.0, 0.0), []),
    ],
)
def test_those_move_that_the_evidence_from_afar_cannot_tell(monkeypatch, totals, moved):
    """Within 30 % of the best gain, or 12 nats; and with them the model that they extend."""
    models, parent = walked(monkeypatch, sticks=False)
    asked: list[str] = []
    monkeypatch.setattr(TriedModels, "move_to_likeliest", lambda self, model: asked.append(model.name))
    rivals = [
        TriedModel(likelihood=likelihood(0.0), key=(name,), evidence=evidence(total))
        for name, total in zip("abc", totals, strict=True)
    ]
    Trials(models)._move_rivals(rivals, parent)
    assert sorted(asked) == sorted(moved)


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
    monkeypatch.setattr(module.moves, "why_irrelevant", lambda model, parent, wander: "")
    parent = TriedModel(likelihood=likelihood(0.0), key=(), evidence=evidence(0.0))
    model = TriedModel(likelihood=likelihood(0.0), key=("drag@shaft",), evidence=evidence(gain))
    model.likelihood.stage.effects = ("drag@shaft",)  # type: ignore[union-attr]
    model.promised = promised
    judge(model, parent, 17.0)
    assert outcome in model.outcome
    assert model.better is (outcome == "better")
