"""The likeliest shapes of a model's laws are reached step by step, or by a part of a step where the whole one fails."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from discrepancy.evidence.criterion import Evidence
from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.trials import Trials
from discrepancy.evidence.tried_models import TriedModels

LIKELIEST = 10.0


class Place:
    """A model whose law has one shape, linearised at one value of it.

    Its log likelihood is −(x − 10)²; the linearised problem foresees a share of the way to where that is largest, and
    the rise to there.
    """

    def __init__(self, x: float, foresees: float) -> None:
        definition = SimpleNamespace(free_shapes=("centre",))
        self.stage: Any = SimpleNamespace(
            name="bent spring",
            effects=[SimpleNamespace(definition=definition)],
            identify=SimpleNamespace(to_dict=lambda: {"centre": x}),
        )
        self.x, self.foresees = x, foresees
        self.noise = SimpleNamespace(model=SimpleNamespace(processes=["wind"]))

    def promise_of_shapes(self) -> float:
        return (self.x - LIKELIEST) ** 2

    def likeliest_values(self, *, shapes: bool) -> dict[str, float]:
        assert shapes
        return {"centre": self.x + self.foresees * (LIKELIEST - self.x)}

    def neighbour(self, stage: Any) -> Place:
        return Place(stage.identify.to_dict()["centre"], self.foresees)


def evidence_at(place: Place) -> Evidence:
    return Evidence(log_likelihood=-((place.x - LIKELIEST) ** 2), log_prior=0.0, log_odds=0.0)


def moved(start: float, foresees: float, farthest: float = math.inf, wander: float = 0.0) -> float:
    """Return the shape at which a model ends that cannot be simulated beyond some shape."""

    def moved_to(stage: Any, values: dict[str, float], *, trial: bool) -> Any:
        if values["centre"] > farthest:
            raise RuntimeError("cannot be simulated")
        return SimpleNamespace(name=stage.name, identify=SimpleNamespace(to_dict=lambda: values))

    tried = TriedModels(SimpleNamespace(progress=lambda text: None, moved_to=moved_to))  # type: ignore[arg-type]
    tried.evidence_of = evidence_at  # type: ignore[assignment,method-assign]
    tried.wander = wander
    place = Place(start, foresees)
    there, evidence = Trials(tried)._with_likeliest_shapes(place, evidence_at(place))  # type: ignore[arg-type]
    assert evidence == evidence_at(there)  # type: ignore[arg-type]
    return there.x  # type: ignore[attr-defined]


def test_steps_follow_each_other_while_one_promises_something() -> None:
    assert moved(0.0, foresees=0.6) == pytest.approx(LIKELIEST * (1.0 - 0.4**2))  # 1.6² is within what counts as near
    assert 1.6**2 < POLICY.improvement < 4.0**2
    assert moved(0.0, foresees=0.1) == pytest.approx(LIKELIEST * (1.0 - 0.9**POLICY.likeliest_steps))


def test_a_part_of_a_step_is_made_where_the_whole_one_fails() -> None:
    assert moved(0.0, foresees=1.0, farthest=6.0) == pytest.approx(5.0)  # a quarter of the next is too far
    assert moved(0.0, foresees=2.5) == pytest.approx(9.375)  # half of a step beyond, and half of one back


def test_nothing_moves_where_the_evidence_does_not_settle_or_nothing_is_promised() -> None:
    assert moved(0.0, foresees=1.0, wander=20.0) == 0.0
    assert moved(LIKELIEST - 1.0, foresees=1.0) == LIKELIEST - 1.0
