"""The measuring chain on arrays: each error does what it says, is repeatable, and refuses nonsense."""

from __future__ import annotations

import numpy as np
import pytest

from multibody.library import Measurement

T = np.linspace(0.0, 10.0, 10001)
RAMP = 2.0 * T


def test_perfect_measurement_changes_nothing():
    np.testing.assert_array_equal(Measurement().apply(T, RAMP, rng=0), RAMP)


def test_gain_offset_and_delay():
    read = Measurement(gain=1.1, offset=0.5, delay=0.25).apply(T, RAMP, rng=0)
    np.testing.assert_allclose(read[300:], 1.1 * 2.0 * (T[300:] - 0.25) + 0.5, atol=1e-12)
    np.testing.assert_allclose(read[:250], 0.5)  # before the first sample the signal is taken as constant


def test_noise_has_its_size_and_follows_the_seed():
    sensor = Measurement(noise=0.2)
    error = sensor.apply(T, RAMP, rng=4) - RAMP
    # the standard deviation of n values scatters by 1/√(2n) = 0.7 %; four of these
    assert np.std(error) == pytest.approx(0.2, rel=0.03)
    again = sensor.apply(T, RAMP, np.random.default_rng(4))
    np.testing.assert_array_equal(sensor.apply(T, RAMP, rng=4), again)
    assert not np.array_equal(sensor.apply(T, RAMP, rng=4), sensor.apply(T, RAMP, rng=5))


def test_quantisation_rounds_to_its_step():
    read = Measurement(quantisation=0.05).apply(T, np.sin(T), rng=0)
    np.testing.assert_allclose(read / 0.05, np.round(read / 0.05), atol=1e-9)
    assert np.max(abs(read - np.sin(T))) <= 0.025 + 1e-12


def test_jitter_acts_through_the_slope():
    read = Measurement(jitter=1e-3).apply(T, RAMP, rng=1)
    inner = slice(10, -10)
    assert np.std((read - RAMP)[inner]) == pytest.approx(2e-3, rel=0.03)
    np.testing.assert_array_equal(Measurement(jitter=1e-3).apply(T, np.ones_like(T), rng=1), 1.0)


def test_nonsense_is_refused_all_at_once():
    with pytest.raises(ValueError, match=r"noise is -1.*jitter is nan"):
        Measurement(noise=-1.0, jitter=float("nan"))
    with pytest.raises(ValueError, match="one value per time"):
        Measurement().apply(T, RAMP[:-1], rng=0)
    with pytest.raises(ValueError, match="row 2 does not"):
        Measurement().apply([0.0, 1.0, 1.0], [0.0, 0.0, 0.0], rng=0)
