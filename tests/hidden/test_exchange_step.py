"""The second of three effects is first put at the wrong place; the exchange step corrects that."""

from __future__ import annotations

import pytest

from discrepancy.search import moves
from discrepancy.validation.cases import hidden_trial

HIDDEN = ("coulomb_friction@guide", "position_dependent_force@guide", "hysteresis@motor")


@pytest.mark.parametrize("exchanging", [True, False])
def test_the_exchange_step_moves_a_force_to_where_it_acts(exchanging, monkeypatch):
    if not exchanging:
        monkeypatch.setattr(moves, "propose_exchange", lambda *_: None)
    trial = hidden_trial(9503, HIDDEN, "triples")
    assert (set(trial.found) == set(HIDDEN)) is exchanging
