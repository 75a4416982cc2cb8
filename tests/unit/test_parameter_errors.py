"""Evidence holds as far as standard errors are as small as the likelihood promises."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from discrepancy.evidence import tried_models
from discrepancy.evidence.criterion import Evidence
from discrepancy.evidence.moves import TriedModel
from discrepancy.evidence.parameter_errors import ParameterErrors, errors_of_blocks
from discrepancy.evidence.tried_models import TriedModels

BLOCKS, ROWS = 100, 20


def blocks_with(shift: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return white blocks, each shifted by a normal number of some size that no model knows of."""
    rng = np.random.default_rng(5)
    columns = np.ones((ROWS, 1))
    return [(rng.normal(size=ROWS) + shift * rng.normal(), columns) for _ in range(BLOCKS)]


@pytest.mark.parametrize("shift", [0.0, 0.2, 0.4])
def test_variances_are_those_by_which_blocks_differ(shift):
    """The mean of a block varies by 1/n + s²; a variance from a hundred blocks is known to a seventh."""
    errors = errors_of_blocks(("mean",), blocks_with(shift), np.array([np.inf]), np.zeros(1))
    assert errors.promised[0, 0] == pytest.approx(1.0 / (BLOCKS * ROWS))
    expected = (1.0 / ROWS + shift**2) / BLOCKS
    assert errors.found[0, 0] == pytest.approx(expected, rel=3.0 * np.sqrt(2.0 / BLOCKS))
    share = errors.share_that_holds({"mean": 0.3})
    assert share == pytest.approx(min(errors.promised[0, 0] / errors.found[0, 0], 1.0))


def test_what_is_stated_of_a_parameter_is_as_sure_as_stated():
    stated = np.array([1e-3])
    errors = errors_of_blocks(("mean",), blocks_with(0.4), stated, np.zeros(1))
    assert errors.std["mean"] < 1.5 * stated[0]


def test_the_share_does_not_depend_on_units_nor_on_how_strengths_are_mixed():
    rng = np.random.default_rng(6)
    a, b = (m @ m.T for m in rng.normal(size=(2, 3, 3)))
    promised, found = a, a + b
    values = np.array([1.0, -2.0, 0.5])
    mixed = rng.normal(size=(3, 3)) * np.array([[1e-6], [1.0], [1e4]])
    names = ("x", "y", "z")

    def share(mix: np.ndarray) -> float:
        errors = ParameterErrors(names=names, promised=mix @ promised @ mix.T, found=mix @ found @ mix.T, degrees=9)
        return errors.share_that_holds(dict(zip(names, mix @ values, strict=True)))

    assert 0.0 < share(np.eye(3)) < 1.0
    assert share(mixed) == pytest.approx(share(np.eye(3)))
    assert ParameterErrors(names=names, promised=found, found=promised, degrees=9).share_that_holds({"x": 1.0}) == 1.0


class StubEffect:
    """An effect with one strength."""

    over, number = "", 1
    definition = SimpleNamespace(stated=False)

    def __init__(self, name: str) -> None:
        self.name, self.strengths = name, {"level": 2.0}

    def __str__(self) -> str:
        return self.name

    def parameter_name(self, key: str) -> str:
        return f"{self.name}.{key}"


def model(names: tuple[str, ...], total: float) -> TriedModel:
    """Return a model of which only the effects and the evidence are asked."""
    likelihood: Any = StubLikelihood([StubEffect(n) for n in names])
    evidence = Evidence(log_likelihood=total, log_prior=0.0, log_odds=0.0)
    return TriedModel(likelihood=likelihood, key=tuple(sorted(names)), evidence=evidence, better=True)


class StubLikelihood:
    """A likelihood of which only the effects are asked."""

    def __init__(self, effects: list[Any]) -> None:
        self.stage = SimpleNamespace(effects=effects)


@pytest.fixture
def tried(monkeypatch: pytest.MonkeyPatch) -> TriedModels:
    """Models with two effects: the standard error of the first is as promised, that of the second twice as large."""
    shares = {"drag@rail.level": 1.0, "delay@drive.level": 0.25, "lag@drive.level": 1.0}
    errors: Any = SimpleNamespace(share_that_holds=lambda values: min(shares[n] for n in values))
    monkeypatch.setattr(tried_models, "parameter_errors", lambda likelihood: errors)
    state: Any = SimpleNamespace(progress=lambda text: None)
    tried = TriedModels(state)
    tried.models[()] = model((), 0.0)
    return tried


def add(tried: TriedModels, total: float, *names: str) -> TriedModel:
    tried.models[tuple(sorted(names))] = added = model(names, total)
    return added


def test_only_what_an_effect_adds_is_doubted(tried):
    drag, both = add(tried, 90.0, "drag@rail"), add(tried, 110.0, "drag@rail", "delay@drive")
    assert tried.most_probable() is both
    assert (drag.overstated, both.overstated) == (0.0, 15.0)


def test_rivals_are_doubted_alike(tried):
    """What the better of two gains hardly holds; that the other would do better then is no reason to prefer it."""
    delay, lag = add(tried, 40.0, "delay@drive"), add(tried, 36.0, "lag@drive")
    assert tried.most_probable() is delay
    assert (delay.overstated, lag.overstated) == (30.0, 27.0)


def test_rivals_that_extend_different_models_are_doubted_alike(tried):
    """Two pairs that the records cannot tell stay as probable as each other, whatever each was made of."""
    add(tried, 40.0, "delay@drive")
    add(tried, 60.0, "drag@rail")
    one, other = add(tried, 90.0, "delay@drive", "lag@drive"), add(tried, 90.5, "drag@rail", "delay@drive")
    tried.doubt()
    assert one.total - one.overstated == pytest.approx(other.total - other.overstated, abs=0.5)


def test_a_model_that_gains_nothing_more_is_doubted_as_the_one_within_it(tried):
    delay, more = add(tried, 40.0, "delay@drive"), add(tried, 37.0, "delay@drive", "lag@drive")
    tried.doubt()
    assert delay.overstated == more.overstated == 30.0


def test_evidence_counts_whole_where_standard_errors_cannot_be_computed(tried, monkeypatch):
    def failing(likelihood):
        raise np.linalg.LinAlgError("singular matrix")

    monkeypatch.setattr(tried_models, "parameter_errors", failing)
    delay = add(tried, 40.0, "delay@drive")
    assert tried.most_probable() is delay
    assert delay.overstated == 0.0


def test_less_of_a_model_may_remain_than_of_a_simpler_one(tried):
    drag, both = add(tried, 90.0, "drag@rail"), add(tried, 102.0, "drag@rail", "delay@drive")
    both.evidence = Evidence(log_likelihood=108.0, log_prior=0.0, log_odds=-6.0)
    assert tried.ranked()[0] is both
    assert tried.most_probable() is drag
