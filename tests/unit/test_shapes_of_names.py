"""A law in the place of a free curve begins with the shape that it had where it was fitted."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from discrepancy.effects.effect import Effect
from discrepancy.evidence.moves import TriedModel, key_of
from discrepancy.evidence.tried_models import TriedModels

PLACE: dict[str, Any] = {"where": "guide", "ports": ("guide.a", "guide.b"), "domain": "translation"}


def friction(v_s: float, coulomb: float = 1.0) -> Effect:
    return Effect(kind="coulomb_friction", strengths={"coulomb": coulomb}, shape={"v_s": v_s}, **PLACE)


def tight_spot(strength: str, **shape: float) -> Effect:
    return Effect(kind="local_bump", strengths={strength: 1.0}, shape={"place": 0.1, "width": 0.2, **shape}, **PLACE)


def tried(*models: tuple[float, Effect]) -> TriedModels:
    search = TriedModels(SimpleNamespace())  # type: ignore[arg-type]
    for number, (total, effect) in enumerate(models):
        likelihood: Any = SimpleNamespace(stage=SimpleNamespace(effects=(effect,)))
        evidence: Any = SimpleNamespace(total=total)
        search.models[(*key_of([effect]), str(number))] = TriedModel(
            likelihood=likelihood, key=key_of([effect]), evidence=evidence
        )
    return search


NOTHING: Any = SimpleNamespace(stage=SimpleNamespace(effects=()))


def test_it_is_the_shape_in_the_best_model_at_its_own_strength():
    search = tried((307.0, friction(0.03)), (12.0, friction(0.001)))
    (named,) = search.with_fitted_shapes([friction(0.004, coulomb=5.0)], NOTHING)
    assert named.shape == {"v_s": 0.03}
    assert named.strengths == {"coulomb": 5.0}


def test_another_law_of_the_same_kind_has_another_shape():
    proposed = tight_spot("level", v_s=0.001)
    assert tried((50.0, tight_spot("push"))).with_fitted_shapes([proposed], NOTHING) == (proposed,)


def test_what_was_not_fitted_stays_as_it_is_proposed():
    assert tried().with_fitted_shapes([friction(0.004)], NOTHING) == (friction(0.004),)


def test_what_the_model_has_already_keeps_its_own():
    model: Any = SimpleNamespace(stage=SimpleNamespace(effects=(friction(0.004),)))
    assert tried((307.0, friction(0.03))).with_fitted_shapes([friction(0.004)], model) == (friction(0.004),)
