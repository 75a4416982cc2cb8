"""Signals of a gear stage: processing, lines, similarity with its lag, order tracking; and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gearbox.files.operating_condition import OperatingCondition
from gearbox.signals.mesh_lines import energy_share, find_mesh_frequency, fit_lines, harmonics_in
from gearbox.signals.orders import (
    order_track,
    revolutions_at_speed,
    revolutions_from_mesh,
    revolutions_from_pulses,
    synchronous_average,
)
from gearbox.signals.signal import Processing, Signal, SignalError, band_pass, normalise, resample, value_at
from gearbox.signals.similarity import cosine, cosine_over_lags, match_speed, similarity, upper_bound

RATE = 25_600.0
MESH = 1600.0 / 3.0


def tone(*parts: tuple[float, float, float], duration: float = 1.0, rate: float = RATE, shift: float = 0.0) -> Signal:
    """Sum of (frequency, amplitude, phase)."""
    t = np.arange(round(duration * rate)) / rate + shift
    return Signal(sum(a * np.cos(2 * np.pi * f * t + p) for f, a, p in parts), rate, name="a", unit="m/s**2")


def stage(shift: float = 0.0, mesh: float = MESH, duration: float = 1.0) -> Signal:
    """Two mesh lines in the paper's band and one above it."""
    return tone((mesh, 1.0, 0.3), (2 * mesh, 0.7, 1.1), (3 * mesh, 0.5, -0.4), duration=duration, shift=shift)


# -------------------------------------------------------------------- steps


@pytest.mark.parametrize("rate", [10_000.0, 12_800.0, 9_973.1, 51_200.0])
def test_resampling_keeps_what_both_rates_can_hold(rate):
    signal = resample(tone((900.0, 1.0, 0.4)), rate)
    assert signal.rate == rate
    t = np.arange(len(signal)) / rate
    middle = slice(len(t) // 4, -len(t) // 4)
    assert signal.values[middle] == pytest.approx(np.cos(2 * np.pi * 900.0 * t + 0.4)[middle], abs=2e-3)


def test_resampling_folds_nothing_back():
    """8 kHz would appear at 2 kHz in 10 kHz samples."""
    for rate in (10_000.0, 10_000.7):
        low = resample(tone((8000.0, 1.0, 0.0)), rate)
        assert np.abs(low.values[500:-500]).max() < 2e-3


def test_values_between_samples():
    signal = tone((3000.0, 1.0, 0.2))
    at = 0.2 + np.linspace(0.0, 0.1, 777)
    # 0.12 of the sampling rate: the promise of the docstring is 1e-4.
    assert value_at(signal, at) == pytest.approx(np.cos(2 * np.pi * 3000.0 * at + 0.2), abs=1e-4)
    with pytest.raises(SignalError, match="asked for"):
        value_at(signal, [2.0])


def test_processing_is_the_papers():
    done = Processing().apply(stage())
    assert (done.rate, done.duration, done.unit) == (10_000.0, 0.5, "")
    # Butterworth of order 4 twice, after the bilinear transform: gain 1/(1 + Ω⁸), Ω = (w² − w_l w_h)/(w (w_h − w_l)).
    w = np.tan(np.pi * MESH * np.array([1, 2, 3]) / 1e4)
    low, high = np.tan(np.pi * np.array([300.0, 1200.0]) / 1e4)
    gain = 1.0 / (1.0 + ((w**2 - low * high) / (w * (high - low))) ** 8)
    lines = np.abs(fit_lines(done, MESH * np.array([1, 2, 3])).amplitudes) * np.sqrt(0.5 * (1 + 0.49 + 0.25))
    assert lines == pytest.approx(gain * [1.0, 0.7, 0.5], rel=0.01, abs=1e-3)
    assert gain[2] < 0.03


def test_band_pass_shifts_nothing():
    signal = tone((MESH, 1.0, 0.3))
    done = band_pass(signal, 300.0, 1200.0)
    middle = slice(2000, -2000)
    assert done.values[middle] == pytest.approx(signal.values[middle], abs=5e-3)


def test_condition():
    base = OperatingCondition(1006.0, 50.0)
    assert base.mesh_frequency(32) == pytest.approx(536.5, abs=0.05)  # the paper's Table 6
    assert base.at_speed(1000.0).load_Nm == 50.0
    with pytest.raises(SignalError, match="above zero"):
        OperatingCondition(0.0, 50.0)


# -------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: band_pass(tone((500.0, 1.0, 0.0), rate=2e3), 300.0, 1200.0), "from 300 to 1200 Hz.*and 1000 Hz"),
        (lambda: Processing(rate=2000.0), "half of rate = 2000 Hz"),
        (lambda: Processing().apply(tone((500.0, 1.0, 0.0), rate=2000.0)), "holds nothing above 1000 Hz"),
        (lambda: band_pass(stage(), 1200.0, 300.0), "edges must rise"),
        (lambda: Processing().apply(stage(duration=0.4)), "no window"),
        (lambda: normalise(Signal(np.full(100, 3.0), RATE, name="dead")), "'dead' does not vary \\(zero variance\\)"),
        (lambda: cosine(stage(), stage(duration=0.5)), "25600 samples and 'a' has 12800"),
        (lambda: cosine(stage(), resample(stage(), 10_000.0)), "resample both to one rate"),
        (lambda: cosine(stage(), Signal(np.zeros(25_600), RATE, name="dead")), "'dead' does not vary"),
        (lambda: Signal([1.0, np.nan] * 20, RATE, name="x"), "20 values that are no numbers, the first is sample 1"),
        (lambda: Signal([1.0] * 4, -1.0, name="x"), "at least 16 samples; .*sampling rate of -1"),
        (lambda: similarity(stage(), stage(), mesh_frequency=MESH, rule="held"), "needs a lag"),
        (lambda: similarity(stage(), stage()), "max_lag"),
        (lambda: similarity(stage(), stage(), mesh_frequency=MESH, max_lag=0.45), "too little of a window"),
        (lambda: fit_lines(stage(), [MESH, MESH + 0.1]), "cannot tell apart"),
        (lambda: fit_lines(stage(), [13_000.0]), "lines must lie between 0 and 12800 Hz"),
        (lambda: match_speed(stage(), MESH, 1.1 * MESH), "simulate at the measured speed"),
        (lambda: upper_bound(stage(), MESH, (600.0, 900.0)), "widen the band"),
        (lambda: find_mesh_frequency(stage(), 20_000.0), "cannot be looked for"),
        (lambda: resample(stage(), 0.0), "rate above zero"),
        (lambda: revolutions_from_pulses(stage(), [0.1, 0.2, 0.3, 0.4]), "cover 0.1 to 0.4 s"),
        (lambda: order_track(stage(), np.zeros(25_600), 512), "does not rise"),
        (lambda: synchronous_average(order_track(stage(), revolutions_at_speed(stage(), 1.2), 512)), "fewer than two"),
    ],
)
def test_bad_signals_are_refused_by_name(make, told):
    with pytest.raises(SignalError, match=told):
        make()


def test_noise_has_no_phase_to_follow():
    rng = np.random.default_rng(1)
    with pytest.raises(SignalError, match="fades"):
        revolutions_from_mesh(Signal(rng.standard_normal(25_600), RATE, name="noise"), MESH, 32, bandwidth=6.0)


# -------------------------------------------------------------------- lines


def test_lines_are_fitted_with_their_phases():
    fit = fit_lines(stage(), MESH * np.array([1, 2, 3]))
    assert fit.amplitudes == pytest.approx([np.exp(0.3j), 0.7 * np.exp(1.1j), 0.5 * np.exp(-0.4j)], abs=1e-9)
    assert fit.share == pytest.approx(1.0, abs=1e-12)
    assert fit.values_at([0.0]) == pytest.approx([np.cos(0.3) + 0.7 * np.cos(1.1) + 0.5 * np.cos(0.4)])


@settings(max_examples=20)
@given(st.floats(-0.015, 0.015), st.integers(0, 1000))
def test_mesh_frequency_is_found_beside_its_nominal_value(off, seed):
    mesh = MESH * (1.0 + off)
    noise = np.random.default_rng(seed).standard_normal(25_600)
    noisy = stage(mesh=mesh).with_values(stage(mesh=mesh).values + noise)
    # The Cramér-Rao bound of the strongest line alone, amplitude 1 in white noise of 1 over 1 s: a Hann window costs
    # a factor of about 1.5, five standard deviations are allowed.
    bound = np.sqrt(24.0 / (1.0 * 25_600)) / (2 * np.pi * 1.0)
    assert find_mesh_frequency(noisy, MESH) == pytest.approx(mesh, abs=5 * 1.5 * bound)


def test_energy_share_is_the_part_at_the_lines():
    both = tone((MESH, 1.0, 0.0), (2 * MESH, 1.0, 0.0), (700.0, 1.0, 0.0))
    assert energy_share(both, harmonics_in(MESH, 300.0, 1200.0)) == pytest.approx(2 / 3, rel=1e-3)


# -------------------------------------------------------------------- similarity


def processed(signal: Signal) -> Signal:
    return Processing().apply(signal)


@settings(max_examples=20)
@given(st.floats(-0.9e-3, 0.9e-3))
def test_lag_is_found_between_the_samples(shift):
    """At 10 kHz a sample is 0.1 ms; the lag must be good to a hundredth of that, and the cosine to 1e-4."""
    found = similarity(processed(stage()), processed(stage(shift=shift)), mesh_frequency=MESH, band=(300.0, 1200.0))
    turns = (found.lag + shift) * MESH
    assert abs(turns - round(turns)) / MESH < 1e-6
    assert found.value == pytest.approx(1.0, abs=1e-4)
    assert found.bound == pytest.approx(1.0, abs=1e-4)


def test_lag_alone_moves_the_cosine_as_the_closed_form_says():
    lags, cosines = cosine_over_lags(processed(stage()), processed(stage()), 0.5 / MESH)
    assert cosines.min() < -0.5
    assert cosines.max() == pytest.approx(1.0, abs=1e-5)
    # Closed form for two lines: Σ a² cos(2πk f τ) / Σ a², with the amplitudes that the band leaves.
    a = np.abs(fit_lines(processed(stage()), MESH * np.array([1, 2])).amplitudes) ** 2
    wanted = sum(a[k] * np.cos(2 * np.pi * (k + 1) * MESH * lags) for k in (0, 1)) / a.sum()
    assert cosines == pytest.approx(wanted, abs=1e-3)


def test_rules_of_the_lag():
    measured, virtual = processed(stage()), processed(stage(shift=2.3e-4))
    options = {"mesh_frequency": MESH, "band": (300.0, 1200.0)}
    best = similarity(measured, virtual, rule="best", **options)
    mesh = similarity(measured, virtual, rule="mesh", **options)
    none = similarity(measured, virtual, rule="none", **options)
    held = similarity(measured, virtual, rule="held", lag=best.lag, **options)
    assert best.lag == pytest.approx(-2.3e-4, abs=1e-6)
    assert mesh.lag == pytest.approx(-2.3e-4, abs=1e-6)
    assert held.value == pytest.approx(best.value, abs=1e-4)
    assert none.lag == 0.0
    assert none.value == pytest.approx(cosine(measured, virtual))
    assert none.value == best.as_they_stand < 0.7 < best.value
    for found in (best, mesh, none, held):
        assert found.rule in repr(found)
        assert "upper bound" in repr(found)
        assert found.to_dict()["lag"] == found.lag


def test_speed_that_differs_by_a_thousandth_costs_similarity_and_matching_gives_it_back():
    """GEAR_NOTES' order of magnitude, from a closed form: a line that drifts by Δ turns over the window keeps
    |sin(πΔ)/(πΔ)| of its correlation at the best lag."""
    measured, virtual = processed(stage()), processed(stage(mesh=1.001 * MESH))
    plain = similarity(measured, virtual, mesh_frequency=MESH)
    drift = 0.001 * MESH * 0.5
    first = np.sinc(drift)
    assert plain.value < first + 0.02
    matched = similarity(measured, virtual, mesh_frequency=MESH, virtual_mesh_frequency=1.001 * MESH)
    assert matched.value == pytest.approx(1.0, abs=1e-3)
    assert matched.speed_ratio == pytest.approx(1 / 1.001)


@settings(max_examples=20)
@given(st.integers(0, 10_000))
def test_no_signal_with_mesh_lines_only_exceeds_the_upper_bound(seed):
    rng = np.random.default_rng(seed)
    t = np.arange(25_600) / RATE
    sides = 0.8 * np.cos(2 * np.pi * MESH / 44 * t + 1.0)
    measured = stage().with_values(stage().values * (1.0 + sides) + 0.5 * rng.standard_normal(t.size))
    a, p = rng.uniform(0.0, 2.0, 2), rng.uniform(-np.pi, np.pi, 2)
    virtual = tone((MESH, a[0] + 0.01, p[0]), (2 * MESH, a[1], p[1]))
    found = similarity(processed(measured), processed(virtual), mesh_frequency=MESH, band=(300.0, 1200.0))
    # The filter's start and the window's ends leave the lines not quite orthogonal.
    assert found.value <= found.bound + 2e-3
    assert found.bound < 0.95


# -------------------------------------------------------------------- order tracking


def swinging(duration: float = 4.0) -> tuple[Signal, np.ndarray]:
    """A mesh line and a line at order 7 of the shaft, the speed swinging by 1 % at 0.8 Hz."""
    t = np.arange(round(duration * RATE)) / RATE
    turns = 20.0 * (t + 0.01 / (2 * np.pi * 0.8) * (1.0 - np.cos(2 * np.pi * 0.8 * t)))
    values = np.cos(2 * np.pi * 32 * turns) + 0.2 * np.cos(2 * np.pi * 7 * turns + 0.5)
    return Signal(values, RATE, name="seat"), turns


def test_order_tracking_sharpens_lines_that_the_speed_smears():
    signal, turns = swinging()
    smeared = energy_share(signal, [20.0 * 32])
    tracked = order_track(signal, revolutions_from_mesh(signal, 640.0, 32, bandwidth=8.0), 256)
    lines = fit_lines(tracked.cut(2.0, 70.0), [7.0, 32.0])
    assert smeared < 0.5 < 0.99 < lines.share
    assert np.abs(lines.amplitudes) == pytest.approx([0.2, 1.0], rel=0.02)
    with_pulses = order_track(
        signal,
        revolutions_from_pulses(
            signal, np.interp(np.arange(-1, 82), turns, np.arange(turns.size) / RATE, left=-0.05, right=4.05)
        ),
        256,
    )
    assert fit_lines(with_pulses.cut(5.0, 60.0), [7.0, 32.0]).share > 0.95


def test_synchronous_average_keeps_what_repeats():
    rng = np.random.default_rng(3)
    signal = tone((640.0, 1.0, 0.2), (20.0, 0.5, 0.0), duration=4.0)
    noisy = signal.with_values(signal.values + rng.standard_normal(len(signal)))
    average = synchronous_average(order_track(noisy, revolutions_at_speed(noisy, 20.0), 512))
    # Signal 0.5 + 0.125 of 1 + 0.625 in all; the low-pass of the tracking takes a fifth of the noise away.
    wanted = 0.625 / (0.625 + 0.45 * 512 * 20.0 / 12_800.0)
    assert average.share == pytest.approx(wanted, abs=0.03)
    assert average.count in (79, 80)
    assert average.std_error == pytest.approx(np.sqrt((1.0 - wanted) * 0.625 / wanted / average.count), rel=0.1)
    clean = np.cos(2 * np.pi * 32 * average.angle + 0.2) + 0.5 * np.cos(2 * np.pi * average.angle)
    assert np.std(average.values - clean) < 1.3 * average.std_error
