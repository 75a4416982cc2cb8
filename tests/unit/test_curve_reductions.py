"""The error that a free curve is expected to remove beside the laws: against fits in full simulation."""

from __future__ import annotations

from dataclasses import replace

import pytest

from discrepancy.effects.effect import Effect
from discrepancy.search.model_comparison import excess_error, expected_curve_reductions
from discrepancy.search.moves.free_curves import propose_curve_for_laws
from discrepancy.search.policy import POLICY
from discrepancy.stages.stage import AcceptedEffect


@pytest.fixture(scope="module")
def fitted(sticking):
    """Return a function that fits the recalibrated stage with an effect of a kind at the guide in it."""
    guide = next(p for p in sticking.stage.system.places if p.name == "guide")

    def with_kind(kind, **strengths):
        effect = Effect.at_place(kind, guide, strengths=strengths)
        return sticking.fitted(kind, (effect,), sticking.stage, sticking.stage.noise)

    return with_kind


@pytest.fixture(scope="module")
def wrong(fitted):
    return fitted("viscous_friction", viscous=1.0)


def removed_more(curve, laws, before):
    with_laws, with_curve = laws.rmse("identify"), curve.rmse("identify")
    return max((with_laws[n] ** 2 - with_curve[n] ** 2) / s for n, s in excess_error(before).items())


@pytest.mark.parametrize("over", ["speed", "friction"])
def test_a_fit_removes_little_more_than_expected(sticking, wrong, over):
    """Beside a law that is far from the truth; viscous friction lies in the span of the curve over speed."""
    before = sticking.stage
    offer = before.free_curve_scan(level=0.02, seed=1, where=["guide"])
    curve = next(e for e in offer.effects if e.over == over)
    fit = sticking.fitted("curve", (curve,), before, before.noise)
    expected = expected_curve_reductions(before, wrong)["guide", over]
    removed = removed_more(fit, wrong, before)
    assert removed > 0.1
    assert removed / POLICY.linear_error < expected < removed / 0.8  # as on 31 machines: docs/method/which-law.md


def test_beside_the_true_law_no_curve_is_expected_to_gain_and_none_is_fitted(sticking, fitted):
    before, right = sticking.stage, fitted("coulomb_friction", coulomb=10.0)
    assert max(expected_curve_reductions(before, right).values()) < POLICY.curve_reduction / POLICY.linear_error

    def never(*fit):
        raise AssertionError(f"fitted: {fit}")

    stages = [
        before,
        replace(right, accepted=AcceptedEffect(effect=right.effects[0], p_value=0.001, delta_bic=-50.0, rivals=())),
    ]
    assert propose_curve_for_laws(stages, never, level=0.02, seed=1, progress=print) is None
