"""An effect is compared with the calibrated model that the report shows, and none is announced with a larger error."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from discrepancy.evidence import announcement
from discrepancy.evidence.announcement import Announcement
from discrepancy.evidence.moves import TriedModel
from discrepancy.evidence.trials import Trials
from discrepancy.evidence.tried_models import TriedModels
from discrepancy.stages.held_out_errors import SimulationGain, simulated_worse


def stage_of(name: str, **errors: float) -> Any:
    """A stage with these errors on the records held out."""
    return SimpleNamespace(effects=(), name=name, rmse=lambda part: errors if part == "validate" else {})


CALIBRATED = stage_of("calibrated", speed=1.0, torque=2.0)


def announcement_of(*, validate: tuple[str, ...] = ()) -> Announcement:
    state: Any = SimpleNamespace(stages=[CALIBRATED], progress=lambda text: None)
    state.problem = SimpleNamespace(validate=validate)
    return Announcement(Trials(TriedModels(state)))


@pytest.mark.parametrize(
    ("key", "at_likeliest", "compared"),
    [((), True, "calibrated"), ((), False, "fitted again"), (("drag@shaft",), True, "fitted again")],
)
def test_the_first_model_is_compared_as_it_was_calibrated(key, at_likeliest, compared):
    likelihood: Any = SimpleNamespace(stage=stage_of("fitted again"))
    model = TriedModel(likelihood=likelihood, key=key, evidence=None, at_likeliest=at_likeliest)
    assert announcement_of()._as_reported(model).name == compared


@pytest.mark.parametrize(
    ("speed", "torque", "worse"),
    [(0.5, 2.0, ()), (1.019, 2.038, ()), (0.5, 2.1, ("torque",)), (9.0, 9.0, ("speed", "torque"))],
)
def test_an_error_that_is_two_per_cent_larger_is_worse(speed, torque, worse):
    assert simulated_worse(stage_of("drag", speed=speed, torque=torque), CALIBRATED, 0.04) == worse


@pytest.mark.parametrize(("torque", "announced"), [(2.03, True), (4.0, False)])
def test_an_effect_is_not_announced_where_an_error_grows(monkeypatch, torque, announced):
    """However much the rise differs between the records: a standard error of 220 % was met where it was announced."""
    gain = SimulationGain(
        outputs=("speed", "torque"),
        share=np.array([0.9, -0.66]),
        standard_error=np.array([0.1, 2.2]),
        blocks=2,
    )
    tests = announcement_of(validate=("a", "b"))
    without = TriedModel(likelihood=SimpleNamespace(stage=CALIBRATED), key=(), evidence=None)  # type: ignore[arg-type]
    likelihood: Any = SimpleNamespace(stage=stage_of("drag", speed=0.3, torque=torque))
    best = TriedModel(likelihood=likelihood, key=("drag@shaft",), evidence=None, at_likeliest=True)
    monkeypatch.setattr(announcement, "with_validation", lambda problem, stage: stage)
    monkeypatch.setattr(announcement, "held_out_gain_of_errors", lambda one, other: gain)
    monkeypatch.setattr(announcement.moves, "drops", lambda model: [])
    monkeypatch.setattr(tests.trials, "fitted_once", lambda model, proposals: [without])
    assert (tests._confirmed(best) is best) is announced
    assert tests.unconfirmed == ([] if announced else ["drag@shaft"])
    assert announced or "torque of the records held out would be simulated worse" in best.outcome
