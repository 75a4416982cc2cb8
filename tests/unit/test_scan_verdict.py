"""Verdicts follow from p, the expected amplitude, the smallest visible one and the one that matters."""

import numpy as np
import pytest

from discrepancy.statistics.blocks import Candidate, Residual, Sensitivities
from discrepancy.statistics.scan import scan
from discrepancy.statistics.verdicts import Verdict, decide, smallest_visible


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


def test_absent_is_only_what_would_have_been_seen_whatever_its_shape():
    """A long push shows at a tenth of the size that matters; one of a single sample does not show at that size."""
    rng = np.random.default_rng(5)
    n = 400
    residual = Residual([rng.standard_normal((n, 1)) for _ in range(8)], 0.01, ("y",))
    nothing = Sensitivities((), [np.zeros((n, 1, 0))] * 8)
    long = np.sin(2.0 * np.pi * np.arange(n) / 40.0).reshape(n, 1, 1)
    short = np.zeros((n, 1, 1))
    short[200] = 1.0

    def judged(*columns):
        shapes = tuple({"k": k} for k in range(len(columns)))
        candidate = Candidate("push", "x", tuple((c,) * 8 for c in columns), shapes)
        return scan(residual, nothing, [candidate], seed=1, noise_floor=[1.0]).rows[0]

    alone, both = judged(long), judged(long, short)
    assert alone.verdict is Verdict.ABSENT
    assert alone.mde < 0.2 * alone.delta
    assert both.verdict is Verdict.CANNOT_TELL
    assert both.mde > both.delta
    assert both.needed > 1.0
