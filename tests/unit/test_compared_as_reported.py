"""An effect is compared with the calibrated model that the report shows, and none is announced with a larger error."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from discrepancy.evidence import announcement
from discrepancy.evidence.announcement import Announcement
from discrepancy.evidence.moves import TriedModel
from discrepancy.evidence.predictive import PredictiveGain
from discrepancy.evidence.trials import Trials
from discrepancy.evidence.tried_models import TriedModels
from discrepancy.stages.held_out_errors import SimulationGain, simulated_worse
from multibody import SimulationError


def stage_of(name: str, *, trial: bool = False, **errors: float) -> Any:
    """A stage with these errors on the records held out."""
    stage = SimpleNamespace(name=name, effects=(), noise={}, validate=None if trial else errors)
    stage.machine = None if trial else "machine"
    stage.rmse = lambda part: errors if part == "validate" else {}
    stage.once = lambda key, make: make()
    return stage


CALIBRATED = stage_of("calibrated", speed=1.0, torque=2.0)


def models_of(stage: Any, *, at_likeliest: bool, key: tuple[str, ...] = ()) -> tuple[TriedModels, TriedModel]:
    state: Any = SimpleNamespace(stages=[CALIBRATED], progress=lambda text: None)
    state.problem = SimpleNamespace(validate=("a", "b"))
    state.fitted = lambda name, effects, start, noise: stage_of(f"{start.name}, in full")
    state.moved_to = lambda stage, values: stage_of(f"{stage.name}, evaluated")
    stage.identify = SimpleNamespace(to_dict=dict)
    likelihood: Any = SimpleNamespace(stage=stage)
    model = TriedModel(likelihood=likelihood, key=key, evidence=None, at_likeliest=at_likeliest)
    return TriedModels(state), model


def predicted(score: float) -> PredictiveGain:
    """What the log predictive score of the records held out says."""
    return PredictiveGain(gain=score, standard_error=10.0, blocks=8, parts=8)


def confirming(monkeypatch: pytest.MonkeyPatch, tried: TriedModels, fewer: list[TriedModel]) -> Announcement:
    """The tests of an answer that may lose one effect."""
    tests = Announcement(Trials(tried))
    monkeypatch.setattr(announcement, "with_validation", lambda problem, stage: stage)
    monkeypatch.setattr(announcement.moves, "drops", lambda model: [])
    monkeypatch.setattr(
        tests.trials, "fitted_once", lambda model, proposals: [m for m in fewer if len(m.key) == len(model.key) - 1]
    )
    return tests


@pytest.mark.parametrize(
    ("key", "trial", "at_likeliest", "reported"),
    [
        ((), True, True, "calibrated"),
        ((), True, False, "tried, in full"),
        (("drag@shaft",), True, True, "tried, evaluated"),
        (("drag@shaft",), True, False, "tried, in full"),
        (("drag@shaft",), False, True, "tried"),
    ],
)
def test_what_is_reported_of_a_model(key, trial, at_likeliest, reported):
    tried, model = models_of(stage_of("tried", trial=trial), at_likeliest=at_likeliest, key=key)
    assert tried.as_reported(model).name == reported


@pytest.mark.parametrize(
    ("speed", "torque", "worse"),
    [(0.5, 2.0, ()), (1.019, 2.038, ()), (0.5, 2.1, ("torque",)), (9.0, 9.0, ("speed", "torque"))],
)
def test_an_error_that_is_two_per_cent_larger_is_worse(speed, torque, worse):
    assert simulated_worse(stage_of("drag", speed=speed, torque=torque), CALIBRATED, 0.04) == worse


@pytest.mark.parametrize(
    ("torque", "error", "score", "announced"),
    [
        (2.03, 2.2, 0.0, True),
        (2.15, 2.2, 49.0, False),
        (2.15, 2.2, 51.0, True),
        (2.15, 0.1, 51.0, False),
        (2.25, 2.2, 51.0, False),
    ],
)
def test_an_effect_is_not_announced_where_an_error_grows(monkeypatch, torque, error, score, announced):
    """However much the rise differs between the records, unless it is small, can be chance, and the score is certain.

    A standard error of 220 % was met where it was announced.
    """
    gain = SimulationGain(
        outputs=("speed", "torque"),
        share=np.array([0.9, -0.66]),
        standard_error=np.array([0.1, error]),
        blocks=2,
    )
    monkeypatch.setattr(announcement, "held_out_gain", lambda problem, one, other: predicted(score))
    tried, best = models_of(stage_of("drag", speed=0.3, torque=torque), at_likeliest=True, key=("drag@shaft",))
    without = TriedModel(likelihood=SimpleNamespace(stage=CALIBRATED), key=(), evidence=None)  # type: ignore[arg-type]
    tried.models = {(): without}
    tests = confirming(monkeypatch, tried, [without])
    monkeypatch.setattr(announcement, "held_out_gain_of_errors", lambda one, other: gain)
    assert (tests._confirmed(best) is best) is announced
    assert tests.unconfirmed == ([] if announced else ["drag@shaft"])
    assert announced or "torque of the records held out would be simulated worse" in best.outcome


def three_effects() -> tuple[TriedModels, TriedModel, list[TriedModel]]:
    """Of which the last two undo each other: with either the speed is simulated worst, with drag alone best."""
    speeds = {"drag": 1.0, "drag+hill": 5.0, "drag+play": 5.0, "hill+play": 5.0, "drag+hill+play": 2.0}
    tried, _ = models_of(CALIBRATED, at_likeliest=True)
    models = []
    for name, speed in speeds.items():
        key = tuple(f"{effect}@shaft" for effect in name.split("+"))
        stage = stage_of(name, speed=speed)
        models.append(TriedModel(likelihood=SimpleNamespace(stage=stage), key=key, evidence=None, at_likeliest=True))  # type: ignore[arg-type]
    calibrated = stage_of("calibrated", speed=9.0)
    start = TriedModel(likelihood=SimpleNamespace(stage=calibrated), key=(), evidence=None)  # type: ignore[arg-type]
    tried.state.stages[:] = [calibrated]
    tried.models = {(): start, **{m.key: m for m in models}}
    return tried, models[-1], models


def gain_of(one: Any, other: Any) -> SimulationGain:
    share = np.array([1.0 - (one.rmse("validate")["speed"] / other.rmse("validate")["speed"]) ** 2])
    return SimulationGain(outputs=("speed",), share=share, standard_error=np.array([0.01]), blocks=6)


def test_effects_that_undo_each_other_are_compared_with_the_model_without_both(monkeypatch):
    tried, best, models = three_effects()
    tests = confirming(monkeypatch, tried, [tried.models[()], *models])
    monkeypatch.setattr(announcement, "held_out_gain_of_errors", gain_of)
    monkeypatch.setattr(announcement, "held_out_gain", lambda problem, one, other: predicted(-50.0))
    assert tests._confirmed(best).key == ("drag@shaft",)
    assert tests.unconfirmed == ["hill@shaft", "play@shaft"]
    assert best.outcome == ("hill@shaft + play@shaft is not announced: the records held out are not predicted better")


def test_an_effect_with_which_the_records_held_out_cannot_be_simulated_is_not_announced(monkeypatch):
    """They stay held out: it is the effect that goes."""
    tried, best, models = three_effects()
    tests = confirming(monkeypatch, tried, [tried.models[()], *models])

    def validated(problem: Any, stage: Any) -> Any:
        if "play" in stage.name:
            raise SimulationError("the step became too small")
        return stage

    monkeypatch.setattr(announcement, "with_validation", validated)
    for model in models:
        model.stage.validate = None if "play" in model.name else model.stage.validate  # type: ignore[misc]
    monkeypatch.setattr(announcement, "held_out_gain_of_errors", gain_of)
    monkeypatch.setattr(announcement, "held_out_gain", lambda problem, one, other: predicted(-50.0))
    models[1].evidence = SimpleNamespace(total=1.0)  # type: ignore[assignment]
    assert tests._confirmed(best).key == ("drag@shaft",)
    assert "cannot be simulated with it: the step became too small" in best.outcome
