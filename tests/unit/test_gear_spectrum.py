"""Lines of a gear stage: found where they are and not where they are not, named, and laid against theory."""

from __future__ import annotations

import numpy as np
import pytest

from gearbox.signals.figures import plot_pair, plot_spectra
from gearbox.signals.main_components import main_components
from gearbox.signals.signal import Signal, SignalError
from gearbox.signals.spectrum import name_lines, shaft_frequencies, spectrum

RATE, MESH = 25_600.0, 1600.0 / 3.0
SHAFTS = shaft_frequencies(MESH, (32, 44), ("input shaft", "output shaft"))


def vibration(seed: int = 0, swing: float = 0.0, shaft: str = "output shaft", noise: float = 0.5) -> Signal:
    """Two mesh lines that a shaft modulates, in white noise, 4 s."""
    t = np.arange(round(4.0 * RATE)) / RATE
    y = 2.0 * np.cos(2 * np.pi * MESH * t) + np.cos(2 * np.pi * 2 * MESH * t + 0.4)
    y *= 1.0 + swing * np.cos(2 * np.pi * SHAFTS[shaft] * t + 0.2)
    return Signal(y + noise * np.random.default_rng(seed).standard_normal(t.size), RATE, name="seat", unit="m/s**2")


def test_shaft_frequencies():
    assert SHAFTS["input shaft"] == pytest.approx(1000.0 / 60.0)
    assert SHAFTS["output shaft"] == pytest.approx(1000.0 / 60.0 * 32 / 44)


@pytest.mark.parametrize("shaft", ["input shaft", "output shaft"])
def test_sidebands_are_found_at_the_shaft_that_makes_them(shaft):
    table = name_lines(vibration(swing=0.05, shaft=shaft), MESH, SHAFTS, harmonics=2, sidebands=2)
    other = next(s for s in SHAFTS if s != shaft)
    assert [line.found for line in table.mesh] == [True, True]
    assert table.modulating_shaft() == shaft
    first = [line for line in table.sidebands(shaft) if abs(line.sideband) == 1]
    assert all(line.found for line in first)
    # Amplitude 2·0.05/2 and 1·0.05/2; noise adds 0.5·sqrt(1.5·4/N), N samples: 4e-3.
    assert [line.amplitude for line in first] == pytest.approx([0.05, 0.05, 0.025, 0.025], abs=0.012)
    assert not any(line.found for line in table.sidebands(other))
    assert f"1 × mesh + 1 × {shaft}" in table.to_frame()["line"].tolist()


def test_noise_makes_no_lines():
    """33 lines are looked for in each of 40 signals; one false line in 1000 signals is what the limit promises."""
    found = 0
    for seed in range(40):
        noise = Signal(np.random.default_rng(seed).standard_normal(50_000), RATE, name="noise")
        table = name_lines(noise, MESH, SHAFTS, harmonics=3, sidebands=2)
        found += sum(line.found for line in table.lines)
        assert table.modulating_shaft() == ""
    assert found <= 1


def test_whole_ratio_leaves_the_faster_shaft_without_lines_of_its_own():
    shafts = shaft_frequencies(MESH, (23, 46), ("pinion shaft", "gear shaft"))
    table = name_lines(vibration(), MESH, shafts, harmonics=2, sidebands=3)
    assert table.sidebands("pinion shaft")
    assert not table.sidebands("pinion shaft", own=True)
    assert {abs(line.sideband) for line in table.sidebands("gear shaft", own=True)} == {1, 3}


def test_short_signal_cannot_tell_sidebands():
    with pytest.raises(SignalError, match=r"too little for sidebands 12\.1 Hz apart: take at least 0\.49 s"):
        name_lines(vibration().cut(0.0, 0.3), MESH, SHAFTS)


def test_main_components_against_theory():
    found = main_components(vibration(noise=0.01), MESH * 1.002, count=2)
    assert found.accepted
    assert found.errors == pytest.approx((-0.002, -0.002), abs=2e-4)
    assert sorted(found.orders) == [1, 2]
    assert "relative error" in found.to_frame()


def test_components_off_theory_are_not_accepted():
    t = np.arange(round(RATE)) / RATE
    wrong = Signal(np.cos(2 * np.pi * 1.3 * MESH * t) + 0.5 * np.cos(2 * np.pi * 2 * MESH * t), RATE, name="seat")
    found = main_components(wrong, MESH, count=2)
    assert not found.accepted
    assert found.worst == pytest.approx(0.3, abs=0.01)


def test_figures_carry_names_and_units():
    signal = vibration(swing=0.05)
    figure = spectrum(signal).plot(name_lines(signal, MESH, SHAFTS, harmonics=2), band=(0.0, 1500.0))
    assert [a.get_xlabel() for a in figure.axes] == ["frequency [Hz]"] * 2
    assert all(a.get_ylabel() == "amplitude, peak [m/s²]" for a in figure.axes)
    short = signal.cut(0.0, 0.5)
    assert plot_pair([("base", short, short, None)]).axes[0].get_xlabel() == "time [ms]"
    assert len(plot_spectra([("a", spectrum(short)), ("b", spectrum(short))], (0.0, 2000.0), MESH).axes) == 2
