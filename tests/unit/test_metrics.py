"""Figures of agreement against their definitions, and the noise estimate against known noise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimation.signals.metrics import (
    agreement,
    bias,
    coherence,
    cosine,
    frequency_response,
    max_error,
    noise_floor,
    nrmse,
    pearson,
    quantisation_step,
    rmse,
    share_above_noise,
    spectral_density,
)

T = np.arange(20_000) * 1e-3
SMOOTH = 10.0 * np.sin(T)
NOISE = 0.1 * np.random.default_rng(7).standard_normal(len(T))


def test_values_by_hand():
    a, b = np.array([1.0, 2.0, 3.0, 4.0]), np.array([1.0, 2.0, 3.0, 8.0])
    assert rmse(a, b) == 2.0
    assert bias(a, b) == 1.0
    assert max_error(a, b) == 4.0
    assert nrmse(a, b) == pytest.approx(2.0 / np.sqrt(1.25), rel=1e-14)
    assert pearson(a, b) == pytest.approx(np.corrcoef(a, b)[0, 1], rel=1e-12)
    assert cosine(a, b) == pytest.approx(46.0 / np.sqrt(30.0 * 78.0), rel=1e-14)
    assert share_above_noise(a, b, 1.0) == 0.75
    assert share_above_noise(a, b, 3.0) == 0.0
    every = agreement(a, b, noise=1.0)
    assert (every.rmse, every.bias, every.max_error, every.share_above_noise) == (2.0, 1.0, 4.0, 0.75)


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10_000), gain=st.floats(0.1, 10.0), offset=st.floats(-5.0, 5.0))
def test_what_each_figure_is_blind_to(seed, gain, offset):
    a, b = np.random.default_rng(seed).standard_normal((2, 50))
    assert pearson(a, gain * b + offset) == pytest.approx(pearson(a, b), abs=1e-9)
    assert cosine(a, gain * b) == pytest.approx(cosine(a, b), abs=1e-9)
    assert rmse(a + offset, b + offset) == pytest.approx(rmse(a, b), rel=1e-9)
    assert nrmse(gain * a, gain * b) == pytest.approx(nrmse(a, b), rel=1e-9)
    assert rmse(a, b) ** 2 == pytest.approx(bias(a, b) ** 2 + np.var(b - a), rel=1e-9)


def test_model_at_the_mean_has_nrmse_one_and_constants_have_none():
    a = np.arange(10.0)
    assert nrmse(a, np.full(10, a.mean())) == pytest.approx(1.0, rel=1e-14)
    assert np.isnan(nrmse(np.ones(5), np.arange(5.0)))
    assert np.isnan(pearson(np.ones(5), np.arange(5.0)))
    assert np.isnan(cosine(np.zeros(5), np.arange(5.0)))
    with pytest.raises(ValueError, match="same length"):
        rmse(np.ones(3), np.ones(4))


def test_frequency_response_of_a_known_filter():
    """y[k] = x[k] + 0.5 x[k-1], whose response is 1 + 0.5 exp(-iωT)."""
    x = np.random.default_rng(3).standard_normal(200_000)
    y = x + 0.5 * np.concatenate([[0.0], x[:-1]])
    frequency, found = frequency_response(x, y, 1000.0, 4.0)
    true = 1.0 + 0.5 * np.exp(-2j * np.pi * frequency / 1000.0)
    assert np.max(np.abs(found - true)[1:-1]) < 0.02  # the window spans 250 samples, of which the filter shifts one
    assert np.all(np.isnan(frequency_response(np.zeros(4000), x[:4000], 1000.0)[1]))
    with pytest.raises(ValueError, match="cannot be compared"):
        frequency_response(x, y[:-1], 1000.0)


def test_spectral_density_integrates_to_the_variance():
    frequency, density = spectral_density(NOISE, 1000.0)
    # The sum is an estimate of the variance from 20 000 samples: 1 % standard error.
    assert np.sum(density) * frequency[1] == pytest.approx(np.var(NOISE), rel=0.03)
    line, density = spectral_density(np.sin(2 * np.pi * 50.0 * T), 1000.0, resolution=1.0)
    assert line[np.argmax(density)] == pytest.approx(50.0)


def test_coherence_is_one_for_a_filtered_copy_and_small_for_strangers():
    rng = np.random.default_rng(3)
    x, other = rng.standard_normal((2, 20_000))
    _, same = coherence(x, np.convolve(x, [0.5, 0.3, 0.2], mode="same"), 1000.0, resolution=10.0)
    _, none = coherence(x, other, 1000.0, resolution=10.0)
    assert same.min() > 0.98
    # About 400 overlapping segments: mean 1/200 or so.
    assert none.mean() < 0.02


def test_noise_of_a_smooth_signal_is_found():
    found = noise_floor(SMOOTH + NOISE)
    # The median of 20 000 differences that overlap scatters by 1 to 2 %.
    assert found.std == pytest.approx(np.std(NOISE), rel=0.05)
    assert (found.source, found.quantisation) == ("differences", 0.0)
    assert noise_floor(SMOOTH).std < 1e-7


def test_jumps_do_not_count_as_noise():
    assert noise_floor(SMOOTH + NOISE + 50.0 * (T % 2.0 > 1.0)).std == pytest.approx(np.std(NOISE), rel=0.05)


def test_noise_that_was_averaged_before_sampling_is_found():
    averaged = np.convolve(NOISE, np.ones(8) / 8.0, mode="same")
    # At the sampling rate itself it looks many times smaller than it is.
    assert np.median(np.abs(np.diff(averaged, 3))) / 0.6745 / np.sqrt(20.0) < 0.5 * np.std(averaged)
    assert noise_floor(SMOOTH + averaged).std == pytest.approx(np.std(averaged), rel=0.25)


@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.0, 5.0, 20.0])
def test_quantised_channels(ratio):
    step = ratio * 0.1
    measured = step * np.round((SMOOTH + NOISE) / step)
    found = noise_floor(measured)
    assert found.quantisation == pytest.approx(step, rel=1e-9)
    # Noise and rounding add in square; a median over few levels is coarse, hence 20 %.
    assert found.std == pytest.approx(np.hypot(0.1, step / np.sqrt(12.0)), rel=0.2)


def test_encoder_without_noise_has_its_rounding_error():
    step = 2.0 * np.pi / 4096.0
    measured = step * np.round(SMOOTH / 10.0 / step)
    found = noise_floor(measured)
    assert found.source == "quantisation"
    assert found.std == pytest.approx(np.std(measured - SMOOTH / 10.0), rel=0.05)


def test_printed_decimals_are_no_quantisation():
    assert quantisation_step(np.round(SMOOTH + NOISE, 7)) == 0.0
    assert quantisation_step(np.array([0.0, 5.0] * 10)) == 0.0
    with pytest.raises(ValueError, match="too few"):
        noise_floor(np.ones(7))


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("corner", [5.0, 12.0])
def test_a_motion_that_is_random_is_no_noise(order, corner):
    """A car's body on a rough road: its acceleration is flat at spacings beyond its memory, as noise is."""
    from scipy.signal import butter, sosfilt

    rng = np.random.default_rng(5)
    motion = sosfilt(butter(order, corner, fs=250.0, output="sos"), rng.standard_normal(3000))
    noisy = motion / np.std(motion) + rng.normal(0.0, 0.02, 3000)
    # What the motion changes within four samples counts as noise; of the third order that is next to nothing.
    resolved = np.std(np.diff(motion / np.std(motion), 3)) / np.sqrt(20.0)
    assert 0.95 * 0.02 < noise_floor(noisy).std < 1.1 * np.hypot(0.02, resolved)


def test_a_motion_that_rings_is_no_noise():
    """A spacing near the period makes the differences fall, after which they are flat as those of noise are."""
    time = np.arange(2000) * 0.004
    push = np.repeat([0.0, -20.0, 25.0, -30.0, 20.0, -15.0], 333)
    push = np.append(push, [0.0, 0.0]) * (np.mod(time, 1.333) < 0.4)
    ring = 45.0 * np.exp(-2.0 * time) * np.sin(45.0 * time)  # a carriage on a belt, 35 samples a period
    force = np.convolve(push, ring)[: time.size] * 0.004
    noisy = force + np.random.default_rng(1).normal(0.0, 0.5, time.size)
    # The median of 2000 samples scatters by 3 %; the ringing adds to the smallest spacing a little.
    assert noise_floor(noisy).std == pytest.approx(0.5, rel=0.1)
