"""The log evidence by which an effect raises a model, also where a model on the way could not be fitted."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from discrepancy.evidence import tried_models as module
from discrepancy.evidence.criterion import Evidence
from discrepancy.evidence.moves import TriedModel
from discrepancy.evidence.tried_models import TriedModels


def model(*key: str, total: float | None) -> TriedModel:
    evidence = Evidence(log_likelihood=total, log_prior=0.0, log_odds=0.0) if total is not None else None
    likelihood: Any = SimpleNamespace() if total is not None else None
    return TriedModel(likelihood=likelihood, key=key, evidence=evidence)


@pytest.mark.parametrize(
    ("effects", "total"),
    [((), 0.0), (("a",), 5.0), (("b",), 0.0), (("c",), 0.0), (("a", "b"), 30.0), (("a", "b", "c"), 30.0)],
)
def test_a_model_that_failed_counts_as_the_best_with_fewer_effects(monkeypatch, effects, total):
    """Of b alone the fit failed, c was never tried: their strengths could be zero."""
    monkeypatch.setattr(module, "key_of", lambda given: tuple(given))
    tried = TriedModels(SimpleNamespace())  # type: ignore[arg-type]
    every = [model(total=0.0), model("a", total=5.0), model("b", total=None), model("a", "b", total=30.0)]
    tried.models = {m.key: m for m in every}
    assert tried.total_of(effects) == total
    assert math.isfinite(tried.total_of(effects) - tried.total_of(effects[:-1]))
