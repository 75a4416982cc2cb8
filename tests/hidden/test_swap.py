"""The second of three effects is first put at the wrong place, and put right when the third is known."""

from __future__ import annotations

from discrepancy.validation.cases import hidden_trial

HIDDEN = ("coulomb_friction@guide", "position_dependent_force@guide", "hysteresis@motor")


def test_a_force_along_the_way_ends_where_it_acts(monkeypatch):
    from discrepancy.search import exchange as swap

    exchanged = []

    def seen(stages, fit, progress):
        found = better(stages, fit, progress)
        if found is not None:
            exchanged.append((str(found.old), str(found.new)))
        return found

    better = swap.better_in_its_place
    monkeypatch.setattr(swap, "better_in_its_place", seen)
    trial = hidden_trial(9503, HIDDEN, "triples")
    assert exchanged == [("position_dependent_force@motor", "position_dependent_force@guide")]
    assert set(trial.found) == set(HIDDEN)
    assert trial.held_out == 1.0
