"""A search by significance takes back what makes the records held out worse, and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from discrepancy.conclusion.conclude import _unconfirmed
from discrepancy.search import loop
from discrepancy.stages.held_out_errors import SimulationGain


@dataclass(frozen=True)
class MadeStage:
    """As much of a stage as the rule reads; ``error`` is the mean square error of its one output."""

    name: str
    error: float
    free_form: bool = False
    half_of_masking_pair: bool = False
    notes: tuple[str, ...] = ()
    validate: object = field(default_factory=object)

    @property
    def accepted(self) -> object:
        effect = SimpleNamespace(
            definition=SimpleNamespace(free_form=self.free_form), kind="coulomb_friction", where=self.name
        )
        return SimpleNamespace(effect=effect) if self.name != "recalibrated" else None

    def rmse(self, part: str) -> dict[str, float]:
        return {"y": self.error**0.5}


def search_after(monkeypatch: pytest.MonkeyPatch, gain_of: Callable, *stages: MadeStage) -> SimpleNamespace:
    """Return the state of a search that has taken back what does harm."""
    monkeypatch.setattr(loop, "held_out_gain_of_errors", gain_of)
    state = SimpleNamespace(stages=list(stages), progress=lambda _: None, save=lambda: None, taken_back=[])
    loop.Search(state)._drop_harmful()
    return state


def kept(monkeypatch: pytest.MonkeyPatch, *stages: MadeStage, scatter: float = 0.01) -> list[str]:
    def gain(one: MadeStage, other: MadeStage) -> SimulationGain:
        share, error = np.array([1.0 - one.error / other.error]), np.array([scatter])
        return SimulationGain(outputs=("y",), share=share, standard_error=error, blocks=4)

    return [s.name for s in search_after(monkeypatch, gain, *stages).stages]


GIVEN, CALIBRATED = MadeStage("recalibrated", 9.0), MadeStage("recalibrated", 5.0)


def test_the_latest_effects_go_while_they_make_a_prediction_worse(monkeypatch: pytest.MonkeyPatch) -> None:
    good, bad, worse = MadeStage("good", 3.0), MadeStage("bad", 3.1), MadeStage("worse", 3.4)
    assert kept(monkeypatch, GIVEN, CALIBRATED, good, bad, worse) == ["recalibrated", "recalibrated", "good"]


def test_a_change_within_its_scatter_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    assert kept(monkeypatch, GIVEN, CALIBRATED, MadeStage("even", 5.08))[-1] == "even"


def test_an_error_that_is_seen_to_grow_is_no_chance(monkeypatch: pytest.MonkeyPatch) -> None:
    """However much the rise differs between the records."""
    assert kept(monkeypatch, GIVEN, CALIBRATED, MadeStage("larger", 5.3), scatter=0.5)[-1] == "recalibrated"
    assert kept(monkeypatch, GIVEN, CALIBRATED, MadeStage("even", 5.19), scatter=0.5)[-1] == "even"


def test_a_force_without_a_law_is_no_name_and_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    assert kept(monkeypatch, GIVEN, CALIBRATED, MadeStage("force", 8.0, free_form=True))[-1] == "force"


def test_a_masking_pair_goes_as_a_whole_or_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    first = MadeStage("first", 7.0, half_of_masking_pair=True)
    assert kept(monkeypatch, GIVEN, CALIBRATED, first, MadeStage("second", 6.0))[-1] == "recalibrated"
    assert kept(monkeypatch, GIVEN, CALIBRATED, first, MadeStage("second", 4.0))[-1] == "second"


@pytest.mark.parametrize(("share_of_speed", "told"), [(0.4, True), (0.01, False), (-0.1, False)])
def test_what_predicts_one_output_better_and_another_worse_shows_that_something_is_missing(
    monkeypatch: pytest.MonkeyPatch, share_of_speed: float, told: bool
) -> None:
    def gain(one: MadeStage, other: MadeStage) -> SimulationGain:
        share, error = np.array([share_of_speed, -0.5]), np.array([0.02, 0.06])
        return SimulationGain(outputs=("speed", "force"), share=share, standard_error=error, blocks=4)

    state = search_after(monkeypatch, gain, GIVEN, CALIBRATED, MadeStage("guide", 4.0))
    assert state.stages[-1].name == "recalibrated"
    said = _unconfirmed(state, None)
    assert (said is not None) is told
    if said is not None:
        assert said.names == "dry (Coulomb) friction at guide"
        assert said.why == "force is predicted worse with it on the records held out"
