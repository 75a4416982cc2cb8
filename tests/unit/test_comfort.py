"""Frequency weighting and ride comfort: tabulated weights, made rides with known indicators, bad records."""

from __future__ import annotations

import numpy as np
import pytest

from multibody.library.profiles import jerk_limited
from vtsdt.lift.comfort import ComfortError, peak_to_peak, ride_comfort
from vtsdt.lift.vibration_weighting import WEIGHTINGS, weighted

# Factors times 1000 at third octaves from 0.5 Hz, ISO 2631-1:1997, Table 3, W_k; printed to three digits
W_K = (
    418,
    459,
    477,
    482,
    484,
    494,
    531,
    631,
    804,
    967,
    1039,
    1054,
    1036,
    988,
    902,
    768,
    636,
    513,
    405,
    314,
    246,
    186,
    132,
)
# W_d, the same table, from 0.5 to 4 Hz
W_D = (853, 944, 992, 1011, 1008, 968, 890, 776, 642, 512)


def _ride(rate: float = 500.0, **extra: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a ride of 20 m at 1.6 m/s, 0.8 m/s² and 1 m/s³ between two rests of 2 s."""
    t = np.arange(int(21.0 * rate)) / rate
    a = np.array([jerk_limited(s - 2.0, 20.0, 1.6, 0.8, 1.0)[2] for s in t])
    moving = (t > 2.0) & (t < 2.0 + jerk_limited(0.0, 20.0, 1.6, 0.8, 1.0)[3])
    return t, a + moving * extra.get("size", 0.0) * np.sin(2.0 * np.pi * extra.get("frequency", 8.0) * t)


def test_weights_are_those_of_the_standard() -> None:
    third_octaves = 10.0 ** (np.arange(-3, 20) / 10.0)
    response = np.abs(WEIGHTINGS["Wk"].response(third_octaves))
    np.testing.assert_allclose(1e3 * response, W_K, rtol=0.015)
    response = np.abs(WEIGHTINGS["Wd"].response(third_octaves[:10]))
    np.testing.assert_allclose(1e3 * response, W_D, rtol=0.006)


def test_weighting_passes_a_sine_with_its_factor() -> None:
    t = np.arange(10000) / 500.0
    for frequency, factor in ((2.0, 0.531), (8.0, 1.036), (20.0, 0.636)):
        out = weighted(np.sin(2.0 * np.pi * frequency * t), 500.0)[4000:]
        assert np.sqrt(2.0) * out.std() == pytest.approx(factor, rel=0.01)


def test_peak_to_peak_counts_pairs_around_a_zero() -> None:
    t = np.arange(1000) / 1000.0
    values = peak_to_peak(3.0 * np.sin(2.0 * np.pi * 5.0 * t + 1e-9))
    assert values.size == 9
    np.testing.assert_allclose(values, 6.0, rtol=1e-3)
    assert peak_to_peak(np.full(10, 1e-4)).size == 0


def test_a_smooth_ride_has_the_figures_of_its_reference() -> None:
    t, a = _ride()
    ride = ride_comfort(t, a)
    assert ride.speed == pytest.approx(1.6, abs=0.01)
    assert ride.distance == pytest.approx(20.0, abs=0.05)
    assert ride.acceleration == pytest.approx(0.8, abs=0.02)
    assert ride.deceleration == pytest.approx(0.8, abs=0.02)
    assert ride.jerk == pytest.approx(1.0, abs=0.05)
    assert ride.z.largest > 0.1  # the change of acceleration itself, as the high-pass at 0.4 Hz leaves it
    assert np.nan_to_num(ride.z.steady_largest) < 0.15 * ride.z.largest


def test_a_hum_at_constant_speed_is_measured_with_its_weight() -> None:
    t, a = _ride(size=0.05, frequency=8.0)
    ride = ride_comfort(t, a)
    assert ride.z.steady_a95 == pytest.approx(2.0 * 0.05 * 1.036, rel=0.06)
    assert ride.acceleration == pytest.approx(0.8, abs=0.06)


def test_gravity_and_direction_do_not_matter() -> None:
    t, a = _ride(size=0.02)
    up, down = ride_comfort(t, a + 9.9), ride_comfort(t, 9.9 - a)
    assert up.z.a95 == pytest.approx(down.z.a95, rel=1e-6)
    assert up.acceleration == pytest.approx(down.acceleration, rel=1e-6)


def test_lateral_vibration_is_weighted_otherwise() -> None:
    t, a = _ride()
    shake = 0.1 * np.sin(2.0 * np.pi * 4.0 * t)
    ride = ride_comfort(t, a, a_x=shake)
    assert ride.y is None
    assert ride.x is not None
    assert ride.x.a95 == pytest.approx(0.2 * 0.512, rel=0.03)


def test_uneven_and_slow_sampling_is_noted() -> None:
    t, a = _ride(rate=50.0)
    keep = np.ones(t.size, dtype=bool)
    keep[300:306] = False
    ride = ride_comfort(t[keep], a[keep])
    assert any("uneven sampling" in n for n in ride.notes)
    assert any("ISO 8041 asks for a band up to 80 Hz" in n for n in ride.notes)
    assert ride.speed == pytest.approx(1.6, abs=0.02)


def test_records_that_cannot_be_evaluated() -> None:
    t, a = _ride()
    with pytest.raises(ComfortError, match="does not move"):
        ride_comfort(t, 0.0 * a)
    with pytest.raises(ComfortError, match="50 samples"):
        ride_comfort(t[:20], a[:20])
    with pytest.raises(ComfortError, match="nothing was recorded for"):
        ride_comfort(np.r_[t[:2000], t[4000:]], np.r_[a[:2000], a[4000:]])
    half = t < 8.0
    with pytest.raises(ComfortError, match="come back to rest"):
        ride_comfort(t[half], a[half])


def test_indicators_show_themselves() -> None:
    ride = ride_comfort(*_ride(), name="made")
    assert list(ride.to_frame().columns) == ["indicator", "value", "unit"]
    assert ride.to_json()["indicators"]["largest jerk"]["unit"] == "m/s³"
    assert len(ride.plot().axes) == 3
