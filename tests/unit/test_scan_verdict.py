"""Verdicts follow from p, the expected amplitude, the smallest visible one and the one that matters."""

import pytest

from discrepancy.verdict import Verdict, decide, smallest_visible


@pytest.mark.parametrize(
    ("p", "size", "mde", "delta", "want"),
    [
        (0.001, 5.0, 1.0, 2.0, Verdict.MISSING),
        (0.001, 1.0, 0.5, 2.0, Verdict.NEGLIGIBLE),
        (0.5, 0.1, 1.0, 2.0, Verdict.ABSENT),
        (0.5, 3.0, 4.0, 2.0, Verdict.CANNOT_TELL),
    ],
)
def test_table(p, size, mde, delta, want):
    verdict, why = decide(p=p, level=0.02, size=size, mde=mde, delta=delta, dof=50, few=False)
    assert verdict is want
    assert why


def test_few_data_are_named():
    _, why = decide(p=0.5, level=0.02, size=1, mde=4, delta=2, dof=3, few=False)
    assert "too few" in why


def test_smallest_visible_is_the_textbook_power_formula():
    # z(0.975) + z(0.8) = 2.8016, the standard two-sided 5 %, 80 % factor.
    assert smallest_visible(1.959964, 4.0) == pytest.approx(2 * 2.801585, rel=1e-5)
