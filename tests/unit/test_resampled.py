"""Residuals in another order: what stays and what goes."""

from __future__ import annotations

import numpy as np
import pytest

from discrepancy.validation.resampled import SCHEMES, Resampled, resample
from discrepancy.validation.resampled_page import resampled_page


@pytest.fixture(scope="module")
def blocks():
    rng = np.random.default_rng(0)
    noise = rng.standard_normal((2, 4000, 2))
    slow = np.cumsum(noise, axis=1) * 0.0
    for i in range(1, 4000):
        slow[:, i] = 0.9 * slow[:, i - 1] + noise[:, i]
    return list(slow)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_length_size_and_colour_stay(blocks, scheme):
    made = resample(blocks, scheme, 19.0, np.random.default_rng(1))
    assert [m.shape for m in made] == [b.shape for b in blocks]
    a, b = np.concatenate(blocks), np.concatenate(made)
    assert np.std(b) == pytest.approx(np.std(a), rel=0.1)
    for x in (a, b):
        lag = np.mean(x[1:] * x[:-1]) / np.mean(x * x)
        # 0.9 for the process; every 95 samples a seam, which costs about 1 %
        assert lag == pytest.approx(0.9, abs=0.03)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_relation_to_the_motion_is_broken(blocks, scheme):
    motion = np.sin(np.arange(4000) * 0.01)
    tied = [b + 5.0 * motion[:, None] for b in blocks]
    rng = np.random.default_rng(2)
    kept = [np.mean(resample(tied, scheme, 19.0, rng)[0] * motion[:, None]) for _ in range(40)]
    assert abs(np.mean(kept)) < 0.25 * np.mean(tied[0] * motion[:, None])


def test_page_lists_rates_by_scheme():
    trials = [
        Resampled(number=k, scheme=SCHEMES[k % 3], plain="bump@guide" if k == 4 else "", whitened="", curves="", p=0.5)
        for k in range(6)
    ]
    text = resampled_page(trials, "study.toml", ["a@b"], 0.02, "today")
    assert "| any alarm | 1 | 6 | 16.7%" in text
    assert "bump@guide" in text
