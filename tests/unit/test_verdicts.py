"""Verdicts follow from p, the expected strength, the smallest visible one and the one that matters."""

import numpy as np
import pytest

from discrepancy.statistics.blocks import Candidate, Residual, Sensitivities
from discrepancy.statistics.scan import scan, smallest_visible
from discrepancy.statistics.verdicts import Verdict, decide


@pytest.mark.parametrize(
    ("p", "strength", "visible", "matters", "verdict", "words"),
    [
        (0.001, 5.0, 1.0, 2.0, Verdict.MISSING, "5 exceeds 2"),
        (0.001, 1.0, 0.5, 2.0, Verdict.NEGLIGIBLE, "1 is below 2"),
        (0.5, 0.1, 1.0, 2.0, Verdict.ABSENT, "strength of 1 would have been seen"),
        (0.5, 3.0, 4.0, 2.0, Verdict.CANNOT_TELL, "only a strength above 4"),
    ],
)
def test_verdict_and_reason(p, strength, visible, matters, verdict, words):
    given, reason = decide(p=p, level=0.02, strength=strength, visible=visible, matters=matters, dof=50, few=False)
    assert given is verdict
    assert words in reason
    assert "too few" not in reason


def test_few_data_are_named():
    _, reason = decide(p=0.5, level=0.02, strength=1, visible=4, matters=2, dof=3, few=False)
    assert "too few" in reason


def test_smallest_visible_is_the_textbook_power_formula():
    # z(0.975) + z(0.8) = 2.8016, the standard two-sided 5 %, 80 % factor.
    assert smallest_visible(1.959964, 4.0) == pytest.approx(2 * 2.801585, rel=1e-5)


def test_absent_is_only_what_would_have_been_seen_whatever_its_shape():
    """A long push shows at a tenth of the size that matters; one of a single sample does not show at that size."""
    rng = np.random.default_rng(5)
    n = 400
    residual = Residual([rng.standard_normal((n, 1)) for _ in range(8)], 0.01, ("y",))
    nothing = Sensitivities(names=(), blocks=[np.zeros((n, 1, 0))] * 8)
    long = np.sin(2.0 * np.pi * np.arange(n) / 40.0).reshape(n, 1, 1)
    short = np.zeros((n, 1, 1))
    short[200] = 1.0

    def judged(*columns):
        shapes = tuple({"k": k} for k in range(len(columns)))
        candidate = Candidate(kind="push", where="x", sensitivities=tuple((c,) * 8 for c in columns), shapes=shapes)
        return scan(residual, nothing, [candidate], seed=1, noise_floor=[1.0]).rows[0]

    alone, both = judged(long), judged(long, short)
    assert alone.verdict is Verdict.ABSENT
    assert alone.smallest_visible_strength < 0.2 * alone.strength_that_matters
    assert both.verdict is Verdict.CANNOT_TELL
    assert both.smallest_visible_strength > both.strength_that_matters
    assert both.critical_ratio > 1.0
