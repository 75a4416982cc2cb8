"""A noise model whose likelihood cannot be computed is left out of the proposals: it does not end a search."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from discrepancy.evidence import proposals


@pytest.mark.parametrize(("reached", "scored"), [(-math.inf, False), (3.0, True)])
def test_candidates_are_scored_under_noise_that_has_a_likelihood(
    monkeypatch: pytest.MonkeyPatch, reached: float, scored: bool
) -> None:
    monkeypatch.setattr(proposals, "record_columns", lambda *_: ((), (), ()))
    monkeypatch.setattr(proposals, "log_price", lambda *_: 0.0)
    monkeypatch.setattr(proposals, "restricted_log_likelihood", lambda *_: reached)
    monkeypatch.setattr(proposals, "replace", lambda *_, **__: SimpleNamespace(weighting=lambda: ()))
    monkeypatch.setattr(proposals._Scoring, "of", classmethod(lambda cls, *arguments: arguments))
    noise = SimpleNamespace(records=(), log_likelihood=1.0, model=None)
    plain = SimpleNamespace(weighted_by=lambda weighting: "weighted")
    likelihood = SimpleNamespace(linearised=plain, noise=noise, held=())
    own = SimpleNamespace(noise="floor", other_laws={})
    under = proposals._Scoring.under(likelihood, "another", own, ())
    assert under == (("weighted", (), "floor", "another", 2.0, {}) if scored else None)
