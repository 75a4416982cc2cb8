"""A law that takes back what a spring does begins with that spring as stated where the other parameters do."""

from __future__ import annotations

from discrepancy.effects.effect import Effect
from discrepancy.stages.fit_stage import _with_stated_spring

STATED = {"nut.stiffness": 4e7, "table.m": 40.0}


def law(kind: str, where: str = "nut", **shape: float) -> Effect:
    return Effect(kind=kind, where=where, strengths={}, shape=shape)


def test_a_play_begins_with_the_stated_spring() -> None:
    """Calibration without the play has found a spring of a third."""
    assert _with_stated_spring(law("backlash", stiffness=1.3e7, centre=1e-6), STATED).shape == {
        "stiffness": 4e7,
        "centre": 1e-6,
    }


def test_a_spring_that_is_not_uncertain_and_other_laws_stay() -> None:
    for effect in (law("backlash", where="belt", stiffness=9e4, centre=0.0), law("cubic_stiffness", centre=0.0)):
        assert _with_stated_spring(effect, STATED) is effect
