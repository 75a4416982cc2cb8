"""The shape of a law stays near that with which it was proposed, however often it is fitted."""

from __future__ import annotations

import pytest

from discrepancy.effects.effect import Effect

FRICTION = Effect(
    kind="coulomb_friction",
    where="guide",
    strengths={"coulomb": 3.0},
    shape={"v_s": 0.01},
    ports=("guide.a", "guide.b"),
    domain="translation",
)
TIGHT_SPOT = Effect(
    kind="local_bump",
    where="guide",
    strengths={"level": 3.0},
    shape={"place": 0.2, "width": 0.05, "v_s": 0.01},
    ports=("guide.a", "guide.b"),
    domain="translation",
)


def bounds(effect: Effect, name: str) -> tuple[float, float]:
    return next((q.min, q.max) for q in effect.uncertain() if q.name.endswith(f".{name}"))


@pytest.mark.parametrize(
    ("effect", "name", "fitted"),
    [(FRICTION, "v_s", 0.001), (TIGHT_SPOT, "width", 0.5), (TIGHT_SPOT, "place", 0.39)],
)
def test_a_later_fit_has_the_bounds_of_the_first(effect, name, fitted):
    later = effect.with_values({effect.parameter_name(name): fitted})
    again = later.with_values({effect.parameter_name(name): fitted * 1.01})
    assert later.shape[name] == fitted
    assert bounds(again, name) == bounds(later, name) == bounds(effect, name)


def test_it_is_the_same_effect_for_that():
    later = FRICTION.with_values({"coulomb_friction.guide.v_s": 0.001})
    assert later == Effect(**{**vars(FRICTION), "shape": {"v_s": 0.001}})
