"""A free curve that is the sum of laws of the catalogue is taken for these laws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from discrepancy.conclusion.sentences import laws_of_curve_sentence
from discrepancy.effects.catalogue import catalogue
from discrepancy.evidence.laws_of_a_curve import laws_of_curve
from discrepancy.sensitivities.free_curve_scan import free_curve
from estimation.signals.preparation import Preparation


@pytest.fixture(scope="module")
def linearised(small_study):
    return small_study.stages[1].without_results().linearised_problem(Preparation(decimate=5, low_pass_hz=20.0))


@pytest.fixture(scope="module")
def entries(linearised):
    return catalogue(linearised.system, linearised.experiments[0].outputs, ("reference.speed",))


def curve_of(linearised, law):
    """Return a free curve over the speed of the place that moves fastest, with the heights of a law."""
    motion = max(linearised.free_curves(), key=lambda c: max(np.max(np.abs(v)) for v in c.speeds))
    curve = free_curve(linearised, (), motion.place.name, "speed", level=0.01, seed=0)
    return replace(curve, strengths=dict(zip(curve.strengths, map(law, curve.knots), strict=True)))


def test_a_friction_in_one_direction_is_recognised(linearised, entries):
    curve = curve_of(linearised, lambda v: -5.0 * min(v, 0.0))
    best = laws_of_curve(linearised, curve, entries, ["guide.viscous"], ())[0]
    assert [e.kind for e in best.effects] == ["asymmetric_viscous_friction"]
    strengths = best.effects[0].strengths
    assert strengths["backward"] - strengths["forward"] == pytest.approx(5.0, rel=0.05)
    assert best.share > 0.99


def test_two_laws_at_once_are_recognised(linearised, entries):
    span = max(np.max(np.abs(v)) for c in linearised.free_curves() for v in c.speeds)
    curve = curve_of(linearised, lambda v: 3.0 * span - 5.0 * v - 8.0 * v * abs(v) / span)
    single, *pairs = laws_of_curve(linearised, curve, entries, ["guide.viscous"], ())
    assert {e.kind for e in pairs[0].effects} == {"constant_force", "quadratic_drag"}
    assert pairs[0].share > 0.99 > single.share


def test_a_law_that_only_acts_the_other_way_is_not_named(linearised, entries):
    """Friction that drives: no law with its sign comes near."""
    curve = curve_of(linearised, lambda v: 5.0 * v * abs(v))
    named = {e.kind for each in laws_of_curve(linearised, curve, entries, (), ()) for e in each.effects}
    assert not named & {"quadratic_drag", "viscous_friction"}


def test_what_the_model_has_is_not_proposed_again(linearised, entries):
    curve = curve_of(linearised, lambda v: -5.0 * v * abs(v))
    drag = laws_of_curve(linearised, curve, entries, (), ())[0].effects
    assert drag[0].kind == "quadratic_drag"
    again = laws_of_curve(linearised, curve, entries, (), drag)
    assert "quadratic_drag" not in {e.kind for each in again for e in each.effects}


def test_the_sentence_gives_law_direction_and_share(linearised, entries):
    curve = curve_of(linearised, lambda v: -5.0 * min(v, 0.0))
    sentence = laws_of_curve_sentence(curve, laws_of_curve(linearised, curve, entries, ["guide.viscous"], ()))
    assert "is nearest to viscous friction that differs with direction (5" in sentence
    assert " more backwards), which accounts for over 99 % of its mean square" in sentence
