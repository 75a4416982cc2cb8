"""What a free curve would take away beside the laws: against fits in full simulation."""

from __future__ import annotations

from dataclasses import replace

import pytest

from discrepancy.axis import axis_case
from discrepancy.curve_promise import promised
from discrepancy.disturbance import facts_of
from discrepancy.effects import Effect
from discrepancy.search import scan_preparation
from discrepancy.settle import BENT, replace_by_curve
from discrepancy.stage import Accepted
from discrepancy.study import Study
from discrepancy.unknown import offer_curves
from discrepancy.worth import above_floor


@pytest.fixture(scope="module")
def study():
    """Four trips of the axis, three of them fitted, that lack dry friction at the guide."""
    found = Study(axis_case(3, ["coulomb_friction@guide"], trips=4).setup(seed=3))
    found.compare()
    return found


@pytest.fixture(scope="module")
def fitted(study):
    """Return a function that fits the recalibrated stage with an effect of a kind at the guide in it."""
    guide = next(p for p in study.stage.system.places if p.name == "guide")

    def with_kind(kind, **strengths):
        effect = Effect.at_place(kind, guide, strengths=strengths)
        return study.fitted(kind, (effect,), study.stage, study.stage.noise)

    return with_kind


@pytest.fixture(scope="module")
def wrong(fitted):
    return fitted("viscous_friction", viscous=1.0)


def taken_more(curve, laws, before):
    with_laws, with_curve = laws.rmse("identify"), curve.rmse("identify")
    return max((with_laws[n] ** 2 - with_curve[n] ** 2) / s for n, s in above_floor(before).items())


@pytest.mark.parametrize("over", ["speed", "friction"])
def test_a_fit_takes_little_more_than_is_promised(study, wrong, over):
    """Beside a law that is far from the truth; viscous friction lies in the span of the curve over speed."""
    before = study.stage
    facts = facts_of(before, scan_preparation(before))
    offer = offer_curves(before, facts, level=0.02, seed=1, where=["guide"])
    curve = next(e for e in offer.effects if e.over == over)
    fit = study.fitted("curve", (curve,), before, before.noise)
    promise = promised(before, wrong)["guide", over]
    taken = taken_more(fit, wrong, before)
    assert taken > 0.1
    assert taken / BENT < promise < 1.25 * taken


def test_beside_the_true_law_no_curve_promises_anything_and_none_is_fitted(study, fitted):
    before, right = study.stage, fitted("coulomb_friction", coulomb=10.0)
    assert max(promised(before, right).values()) < 0.01

    def never(*asked):
        raise AssertionError(f"fitted: {asked}")

    stages = [before, replace(right, accepted=Accepted(right.effects[0], 0.001, -50.0, ()))]
    assert replace_by_curve(stages, never, level=0.02, seed=1, progress=print) is None
