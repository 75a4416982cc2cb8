"""Preparation of signals: what passes, what is lost at the edges, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimation import Preparation, SignalError
from estimation.signals.preparation import cut_blocks, edge_time, low_pass, smooth_derivative

RATE = 1000.0
TIME = np.arange(5000) / RATE


def test_low_pass_keeps_phase_and_halves_at_the_cutoff():
    inner = slice(1000, -1000)
    # Butterworth of order 4, forwards and backwards: gain 1 / (1 + (f / f_c)^8).
    for frequency in (5.0, 20.0, 40.0):
        wave = np.sin(2.0 * np.pi * frequency * TIME)
        out = low_pass(TIME, wave, 20.0)
        gain = 1.0 / (1.0 + (frequency / 20.0) ** 8)
        # The bilinear transform warps 40 Hz at 1 kHz by 0.5 %, in the eighth power 4 % of a gain of 0.004.
        np.testing.assert_allclose(out[inner], gain * wave[inner], atol=2e-4)


def test_edges_that_are_dropped_hold_the_padding():
    wave = np.cos(2.0 * np.pi * 3.0 * TIME)
    out = low_pass(TIME, wave, 30.0)
    drop = int(np.ceil(edge_time(30.0) * RATE))
    error = np.abs(out - wave)
    # The padding bends the signal at its ends; by the edge time a hundredth of that is left.
    assert error[:drop].max() > 1e-3
    assert error[drop:-drop].max() < 0.05 * error[:drop].max()


@settings(max_examples=25, deadline=None)
@given(a=st.floats(-10, 10), b=st.floats(-10, 10), seed=st.integers(0, 1000), decimate=st.integers(1, 10))
def test_preparing_is_linear_so_residuals_may_be_prepared(a, b, seed, decimate):
    rng = np.random.default_rng(seed)
    x, y = rng.standard_normal((2, 2000))
    prepare = Preparation(start=0.1, stop=1.7, low_pass_hz=30.0, decimate=decimate)
    t, out = prepare.apply(TIME[:2000], a * x + b * y)
    t_x, out_x = prepare.apply(TIME[:2000], x)
    _, out_y = prepare.apply(TIME[:2000], y)
    np.testing.assert_array_equal(t, t_x)
    # Rounding in the recursion of the filter grows with the size of the terms.
    np.testing.assert_allclose(out, a * out_x + b * out_y, atol=1e-9)


def test_columns_are_prepared_like_single_signals():
    x = np.random.default_rng(0).standard_normal((2000, 3))
    prepare = Preparation(low_pass_hz=50.0, decimate=5)
    _, together = prepare.apply(TIME[:2000], x)
    for k in range(3):
        np.testing.assert_array_equal(together[:, k], prepare.apply(TIME[:2000], x[:, k])[1])


def test_window_includes_both_ends_and_changes_nothing_else():
    t, x = Preparation(start=0.3, stop=0.6).apply(np.arange(20) * 0.1, np.arange(20.0))
    np.testing.assert_array_equal(x, [3, 4, 5, 6])
    np.testing.assert_allclose(t, [0.3, 0.4, 0.5, 0.6], rtol=1e-15)
    t, x = Preparation().apply(TIME, TIME**2)
    assert len(t) == len(TIME)


def test_decimation_removes_what_would_fold():
    # 95 Hz sampled at 100 Hz would appear at 5 Hz.
    wave = np.sin(2.0 * np.pi * 5.0 * TIME) + np.sin(2.0 * np.pi * 95.0 * TIME)
    t, out = Preparation(decimate=10).apply(TIME, wave)
    np.testing.assert_allclose(np.diff(t), 0.01, rtol=1e-9)
    # At 95 Hz the low-pass at 40 Hz leaves (40 / 95)^8 = 1e-3.
    np.testing.assert_allclose(out, np.sin(2.0 * np.pi * 5.0 * t), atol=2e-3)
    with pytest.raises(SignalError, match="aliasing"):
        Preparation(decimate=10, low_pass_hz=60.0).apply(TIME, wave)


@pytest.mark.parametrize("decimate", [3, 10, 40])
@pytest.mark.parametrize("count", [900, 2050, 5003])
def test_many_columns_are_filtered_as_one_is(count: int, decimate: int):
    """Many are multiplied by what the filter does to single samples, up to the reach of the filter."""
    rng = np.random.default_rng(count + decimate)
    time, values = np.arange(count) / RATE, np.cumsum(rng.standard_normal((count, 300)), axis=0)
    prepare = Preparation(decimate=decimate)
    t, many = prepare.apply(time, values)
    for c in (0, 150, 299):
        t_one, one = prepare.apply(time, values[:, c])
        np.testing.assert_array_equal(t, t_one)
        np.testing.assert_allclose(many[:, c], one, rtol=0.0, atol=1e-12 * np.abs(values).max())


def test_what_was_done_can_be_said():
    lines = Preparation(start=1.0, decimate=10).describe(RATE)
    assert lines[0] == "window from 1.0 to end s"
    assert "low-pass at 40 Hz" in lines[1]
    assert "left out at each end" in lines[2]
    assert "100 Hz" in lines[3]
    assert Preparation().describe(RATE) == ()
    assert Preparation(low_pass_hz=40.0, edge=0.0).edge_samples(RATE) == 0


@pytest.mark.parametrize(
    ("settings_", "told"),
    [
        ({"start": 2.0, "stop": 1.0}, "must come before"),
        ({"decimate": 0}, "whole number"),
        ({"low_pass_hz": -1.0}, "positive"),
        ({"edge": -1.0}, "not be negative"),
    ],
)
def test_contradictions_are_refused(settings_, told):
    with pytest.raises(SignalError, match=told):
        Preparation(**settings_)


@pytest.mark.parametrize(
    ("prepare", "time", "told"),
    [
        (Preparation(start=9.0), TIME, "fewer than two samples"),
        (Preparation(low_pass_hz=600.0), TIME, "half the sampling rate, 500 Hz"),
        (Preparation(low_pass_hz=1.0), TIME[:100], "too few"),
        (Preparation(low_pass_hz=20.0), TIME**2, "not evenly sampled"),
    ],
)
def test_what_cannot_be_done_is_refused(prepare, time, told):
    with pytest.raises(SignalError, match=told):
        prepare.apply(time, np.zeros(len(time)))


@pytest.mark.parametrize("order", [1, 2])
def test_derivative_of_a_sine_and_of_a_cubic(order):
    omega = 2.0 * np.pi * 2.0
    wave = np.sin(omega * TIME)
    exact = omega * np.cos(omega * TIME) if order == 1 else -(omega**2) * wave
    out, inside = smooth_derivative(TIME, wave, 30.0, order)
    # At 1/15 of the bandwidth a cubic fit loses less than 1 % of a second derivative.
    np.testing.assert_allclose(out[inside], exact[inside], atol=1e-2 * omega**order)
    cubic = TIME**3 - 2.0 * TIME**2
    exact = 3.0 * TIME**2 - 4.0 * TIME if order == 1 else 6.0 * TIME - 4.0
    out, inside = smooth_derivative(TIME, cubic, 30.0, order)
    # Exact for cubics but for cancellation: 1e-16 · 125 over half a window of 14 ms, squared.
    np.testing.assert_allclose(out[inside], exact[inside], atol=1e-8)


def test_derivative_has_the_bandwidth_that_was_asked_for():
    gains = []
    for frequency in (5.0, 25.0):
        wave = np.sin(2.0 * np.pi * frequency * TIME)
        out, inside = smooth_derivative(TIME, wave, 25.0)
        gains.append(np.std(out[inside]) / (2.0 * np.pi * frequency * np.std(wave[inside])))
    assert gains[0] == pytest.approx(1.0, abs=0.01)
    # Schafer's formula is for smoothing; as a first derivative the same window passes somewhat less.
    assert 0.5 < gains[1] < 0.75
    with pytest.raises(SignalError, match="too few"):
        smooth_derivative(TIME[:20], TIME[:20], 5.0)
    with pytest.raises(SignalError, match="at most 250 Hz"):
        smooth_derivative(TIME, TIME, 400.0)


@settings(max_examples=60, deadline=None)
@given(count=st.integers(10, 3000), shortest=st.floats(0.01, 1.0), most=st.none() | st.integers(1, 20))
def test_blocks_cover_the_record_and_are_long_enough(count, shortest, most):
    time = np.arange(count) / RATE
    if count / RATE < shortest * (1.0 - 1e-9):
        with pytest.raises(SignalError, match="shorter than one block"):
            cut_blocks(time, shortest, most)
        return
    blocks = cut_blocks(time, shortest, most)
    lengths = [each.stop - each.start for each in blocks]
    assert sum(lengths) == count
    assert [each.start for each in blocks[1:]] == [each.stop for each in blocks[:-1]]
    # Bounds are rounded to samples, so that a block may lose one.
    assert min(lengths) >= np.floor(shortest * RATE) - 1
    assert max(lengths) - min(lengths) <= 1
    assert most is None or len(blocks) <= most


@pytest.mark.parametrize(("decimate", "low_pass_hz", "count"), [(7, None, 1501), (4, 20.0, 900), (3, None, 61)])
def test_many_columns_are_prepared_as_one(decimate, low_pass_hz, count):
    time = 1.3 + np.arange(count) / 250.0
    values = np.cumsum(np.random.default_rng(decimate).standard_normal((count, 400)), axis=0)
    prepare = Preparation(decimate=decimate, low_pass_hz=low_pass_hz)
    whole = prepare.apply(time, values)[1]
    singly = np.column_stack([prepare.apply(time, v)[1] for v in values.T])
    np.testing.assert_allclose(whole, singly, rtol=0.0, atol=1e-10 * np.max(np.abs(values)))
