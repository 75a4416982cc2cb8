"""Whitening filters: they must remove colour, treat all arrays alike, and be linear."""

import numpy as np
import pytest
from scipy.signal import lfilter

from discrepancy.statistics.whitening import fit_whitener, identity


def drifting(rng, n):
    slow = lfilter([np.sqrt(1 - 0.999**2)], [1, -0.999], rng.standard_normal(n + 8000))[8000:]
    return 3 * slow + rng.standard_normal(n)


def test_sensor_noise_on_slow_drift_becomes_white():
    rng = np.random.default_rng(0)
    x = [drifting(rng, 4000)[:, None] for _ in range(3)]
    w = fit_whitener(x, 0.01, ["a"])
    out = np.concatenate([w.apply(b)[:, 0] for b in x])
    rho = np.array([out[k:] @ out[:-k] / (out @ out) for k in range(1, 30)])
    # 12 000 samples: one standard error of a correlation is 0.009; five of them leave room for 29 lags.
    assert np.max(np.abs(rho)) < 0.046
    assert np.std(out) == pytest.approx(1.0, abs=0.04)  # 1/sqrt(2·12000) = 0.0065 per standard error, plus the fit
    # The drift must be seen: a filter shorter than a second could not know the level.
    assert w.filters[0].memory * 0.01 > 0.2


def test_filter_is_linear_and_the_same_for_vectors_and_matrices():
    rng = np.random.default_rng(1)
    x = [drifting(rng, 600)[:, None] for _ in range(2)]
    w = fit_whitener(x, 0.01, ["a"])
    z = rng.standard_normal((600, 1, 3))
    together = w.apply(z)
    for j in range(3):
        np.testing.assert_allclose(together[:, :, j], w.apply(z[:, :, j]), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(w.apply(2 * z - z[:, :, ::-1]), 2 * together - together[:, :, ::-1], atol=1e-9)


def test_first_samples_are_scaled_by_what_is_known_of_them():
    rng = np.random.default_rng(2)
    x = [drifting(rng, 500)[:, None] for _ in range(60)]
    w = fit_whitener(x, 0.01, ["a"])
    first = np.array([w.apply(b)[0, 0] for b in x])
    # 60 values with unit variance: the sample variance stays within 0.5 and 1.7 in 99.9 % of cases.
    assert 0.5 < np.mean(first**2) < 1.7


def test_white_noise_needs_few_coefficients():
    rng = np.random.default_rng(3)
    w = fit_whitener([rng.standard_normal((3000, 1))], 0.01, ["a"])
    x = rng.standard_normal((2000, 1))
    assert np.corrcoef(w.apply(x)[100:, 0], x[100:, 0])[0, 1] > 0.99


def test_constant_zero_channel_is_left_alone():
    w = fit_whitener([np.zeros((100, 1))], 0.01, ["a"])
    assert np.all(w.apply(np.zeros((100, 1))) == 0)


def test_identity_divides_by_the_noise():
    w = identity([2.0], ["a"], 0.1)
    np.testing.assert_allclose(w.apply(np.full((4, 1), 6.0)), 3.0)


def test_short_windows_have_filters_no_longer_than_a_sixth_of_them():
    rng = np.random.default_rng(3)
    x = [lfilter([1.0], [1.0, -0.9], rng.standard_normal(n))[:, None] for n in (15, 14, 13) * 20]
    w = fit_whitener(x, 0.01, ["a"])
    assert 1 <= w.filters[0].memory <= 2
    out = [w.apply(b)[2:, 0] for b in x]
    assert abs(sum(b[1:] @ b[:-1] for b in out)) < 0.15 * sum(b @ b for b in out)  # 0.9 before
