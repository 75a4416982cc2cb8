"""Each candidate is compared with its own null distribution."""

from __future__ import annotations

import numpy as np
import pytest

from discrepancy.statistics import scan as scanning
from discrepancy.statistics.blocks import Candidate, Residual, Sensitivities
from discrepancy.statistics.null_distribution import NullDistribution, Pieces

CANDIDATES, DRAWS, SCALE = 30, 400, 4.0


def chance(rng, draws):
    """Return −ln p of a perfect calibration, except for the first candidate, whose tail is longer."""
    u = rng.exponential(size=(CANDIDATES, draws))
    u[0] *= SCALE
    return u


@pytest.fixture(scope="module")
def null():
    return NullDistribution(
        chance(np.random.default_rng(1), DRAWS), np.ones(CANDIDATES), Pieces(((0, 0, 100),), 0.1, 0.01)
    )


def test_chance_exceeds_the_level_as_often_as_it_says(null):
    fresh = chance(np.random.default_rng(2), 2000)
    p = np.array([np.min(null.p_value(u)) for u in fresh.T])
    for level in (0.02, 0.1):
        # three deviations of the 2000 new cases and of the quantile of the 400 draws
        assert abs(np.mean(p < level) - level) < 3.0 * np.sqrt(level * (1.0 - level) * (1 / 2000 + 1 / DRAWS))


def test_a_long_tail_does_not_hide_the_others(null):
    u = np.zeros(CANDIDATES)
    u[5] = 14.0  # a chance of one in 10⁶ for this candidate
    assert null.p_value(u)[5] < 0.001
    assert np.mean(null.neg_log_p.max(axis=0) >= u[5]) > 0.02  # by the long tail alone
    u = np.zeros(CANDIDATES)
    u[0] = 14.0  # for the one with the long tail a chance of e^-3.5
    assert null.p_value(u)[0] > 0.1


def test_critical_values_have_the_level(null):
    least = null.critical_values(0.05)
    assert least[0] > 2.0 * np.median(least[1:])
    reached = null.by_candidate.neg_log_p(least[:, None])[:, 0]
    np.testing.assert_allclose(reached, np.quantile(null.maxima, 0.95), rtol=1e-12)


def test_a_scan_without_candidates_has_an_empty_null():
    empty = NullDistribution(np.zeros((0, DRAWS)), np.zeros(0), Pieces(((0, 0, 100),), 0.1, 0.01))
    assert empty.maxima.shape == (DRAWS,)
    assert empty.critical_values(0.02).size == 0


def slow(rng, size, memory):
    kernel = np.exp(-0.5 * (np.arange(-3 * memory, 3 * memory + 1) / memory) ** 2)
    return np.convolve(rng.standard_normal(size + 6 * memory), kernel, mode="valid")[:size]


def removed(seed):
    """Return what a scan with curves of 17 points takes out of slow noise that is loud in motion."""
    rng, n, records = np.random.default_rng(seed), 240, 3
    share = np.arange(n) / n
    loud = np.where((share > 0.2) & (share < 0.7), 1.0, 0.15)
    noise = [(loud * slow(rng, n, 8))[:, None] + 0.05 * rng.standard_normal((n, 1)) for _ in range(records)]

    def points():
        return np.stack([loud * slow(rng, n, 6) for _ in range(17)], axis=1)[:, None]

    curves = [
        Candidate(kind="curve", where=f"place {k}", sensitivities=([points() for _ in range(records)],))
        for k in range(12)
    ]
    known = Sensitivities(names=["a"], blocks=[np.ones((n, 1, 1))] * records)
    return scanning.scan(Residual(noise, 0.025, ["y"]), known, curves, draws=200, seed=1, whiten=False).removed_effects


def test_curves_are_taken_out_of_slow_noise_less_often_than_laws_would_be(monkeypatch):
    seeds = (1, 2, 4)  # of 0 to 5 a curve is taken out of 0 and 3 still, and by the rule for laws out of all six
    assert [removed(k) for k in seeds] == [()] * 3
    monkeypatch.setattr(scanning, "FEW_STRENGTHS", 17)  # by the rule for laws
    assert all(removed(k) for k in seeds)


def test_the_interval_of_the_critical_values_holds_in_nine_of_ten_seeds():
    level, candidates, draws = 0.02, 3, 400
    true = -np.log(-np.expm1(np.log1p(-level) / candidates))  # of independent candidates whose u is exponential
    covered = []
    for seed in range(100):
        u = np.random.default_rng(seed).exponential(size=(candidates, draws))
        low, high = NullDistribution(u, np.zeros(0), None).critical_interval(level)
        assert np.all(low <= high)
        covered.append(np.mean((low <= true) & (true <= high)))
    assert 0.8 < np.mean(covered) < 1.0
    assert not np.all(covered)  # an interval that always held would be no interval of nine in ten
