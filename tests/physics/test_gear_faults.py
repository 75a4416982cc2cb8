"""Faults of a gear stage: where their lines stand in the spectrum, and that severity zero is absence."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from gearbox.stage.faults import FAULTS, combined, fault
from gearbox.stage.stage import GearStage
from multibody.system.trajectory import Trajectory

F_1 = 1000.0 / 60.0
F_2 = F_1 * 32 / 44
F_Z = 32 * F_1
#: 11 turns of the input shaft are 8 of the output shaft: every line of gears and shafts stands on a bin
DURATION = 11 / F_1
RATE = 6400.0


@cache
def stage() -> GearStage:
    return GearStage.paper(imperfect=True, bearing_defects=True)


@cache
def spectrum(label: str = "", where: str = "", severity: float = 1.0) -> dict[str, np.ndarray]:
    """Amplitude spectra over multiples of 1/DURATION, by signal."""
    values = combined([fault(label, where, severity, tooth=3)]) if label else {}
    run: Trajectory = stage().simulate(1000.0, 150.0, DURATION, rate=RATE, settle=0.2, parameters=values)
    names = ("a_input_seat_y", "a_output_seat_y", "a_base_y", "transmission_error", "mesh_force")
    found = {name: 2.0 * np.abs(np.fft.rfft(run[name])) / run.times.size for name in names}
    window = np.hanning(run.times.size)  # lines of bearings fall between the bins
    found["windowed"] = 2.0 * np.abs(np.fft.rfft(run["a_input_seat_x"] * window)) / window.sum()
    return found


def line(found: dict[str, np.ndarray], signal: str, frequency: float) -> float:
    k = frequency * DURATION
    assert abs(k - round(k)) < 1e-6
    return float(found[signal][round(k)])


@pytest.mark.parametrize(("where", "own", "other"), [("input_gear", F_1, F_2), ("output_gear", F_2, F_1)])
def test_eccentricity_makes_sidebands_at_its_own_shaft(where: str, own: float, other: float) -> None:
    found, healthy = spectrum("eccentricity", where, 0.4), spectrum()  # 20 µm
    for signal in ("a_output_seat_y", "a_base_y"):
        carrier = line(found, signal, F_Z)
        for side in (-1, 1):
            band = line(found, signal, F_Z + side * own)
            assert band > 30 * line(found, signal, F_Z + side * other), (signal, side)
            assert band > 30 * line(healthy, signal, F_Z + side * own)
            assert 1e-4 < band / carrier < 0.1
    # the transmission error follows the eccentricity: 20 µm · cos β_b along the line of action, once a turn
    te = line(found, "transmission_error", own)
    assert te == pytest.approx(20e-6, rel=0.15)


def test_a_healthy_stage_has_no_sidebands() -> None:
    found = spectrum()
    for signal in ("a_output_seat_y", "a_base_y"):
        for f in (F_1, F_2):
            assert line(found, signal, F_Z + f) < 2e-4 * line(found, signal, F_Z)


def test_a_damaged_tooth_strikes_once_a_turn() -> None:
    for label, where, own, other in (
        ("tooth_crack", "input_gear", F_1, F_2),
        ("spall", "output_gear", F_2, F_1),
        ("chipped_tooth", "input_gear", F_1, F_2),
    ):
        found = spectrum(label, where)
        mine = [line(found, "a_base_y", F_Z + k * own) for k in (-3, -2, -1, 1, 2, 3)]
        theirs = [line(found, "a_base_y", F_Z + k * other) for k in (-3, -2, -1, 1, 2, 3)]
        assert min(mine) > 5 * max(theirs), label


def test_lobes_of_the_pitch_make_sidebands_two_orders_away() -> None:
    found = spectrum("pitch_error", "input_gear")
    assert line(found, "a_base_y", F_Z + 2 * F_1) > 5 * line(found, "a_base_y", F_Z + F_1)


def test_unbalance_turns_with_its_shaft() -> None:
    found, healthy = spectrum("unbalance", "input_shaft"), spectrum()
    assert line(found, "a_input_seat_y", F_1) > 20 * line(healthy, "a_input_seat_y", F_1)
    assert line(found, "a_input_seat_y", F_1) > 20 * line(found, "a_input_seat_y", F_2)


@pytest.mark.parametrize(
    ("label", "passes", "sidebands"),
    [
        ("bearing_outer", 9 / 2 * (1 - 0.2), 0.0),
        ("bearing_inner", 9 / 2 * (1 + 0.2), 1.0),
        ("bearing_element", (1 - 0.2**2) / 0.2, 0.5 * (1 - 0.2)),
    ],
)
def test_bearing_pits_strike_at_their_frequency(label: str, passes: float, sidebands: float) -> None:
    """The lines of a pit stand at its passing frequency, ± the frequency with which its direction turns."""
    found, healthy = spectrum(label, "input_low")["windowed"], spectrum()["windowed"]
    freq = np.arange(found.size) / DURATION
    for harmonic in (2, 5):  # the first is weak: far below what the housing answers to, next to what the start left
        for side in {-sidebands, sidebands}:
            f = F_1 * (harmonic * passes + side)
            near, around = np.abs(freq - f) < 2.0, (np.abs(freq - f) > 3.5) & (np.abs(freq - f) < 8.0)
            assert found[near].max() > 10 * np.median(found[around]), (harmonic, f)
            assert found[near].max() > 1000 * healthy[near].max(), (harmonic, f)


@pytest.mark.parametrize("label", list(FAULTS))
def test_severity_zero_is_absence(label: str) -> None:
    """The rates do not change at all, to the last bit, wherever the gears stand."""
    system = stage().system
    x = stage().static_state(150.0, angle=0.01)
    for name, speed in (("drive.speed", 104.7), ("input_shaft.spin_speed", 104.7), ("output_shaft.spin_speed", -76.1)):
        x[system.index("state", name)] = speed
    u = system.input_vector({"speed": 104.7, "torque": 150.0})
    sound = system.rhs(0.0, x, u)
    for where in FAULTS[label].where:
        p = system.parameter_vector(fault(label, where, 0.0, tooth=0, phase=1.0).values())
        assert np.array_equal(system.rhs(0.0, x, u, p), sound)


@pytest.mark.parametrize("label", [k for k in FAULTS if k != "mesh_backlash"])
def test_every_fault_changes_something(label: str) -> None:
    """More backlash cannot be seen while the flanks stay in touch; everything else shows in the rates."""
    system = stage().system
    x = stage().static_state(150.0, angle=0.0)
    for name, speed in (("drive.speed", 104.7), ("input_shaft.spin_speed", 104.7), ("output_shaft.spin_speed", -76.1)):
        x[system.index("state", name)] = speed
    u = system.input_vector({"speed": 104.7, "torque": 150.0})
    for where in FAULTS[label].where:
        p = system.parameter_vector(fault(label, where, 0.5, tooth=0, phase=1.0).values())
        change = system.rhs(0.0, x, u, p) - system.rhs(0.0, x, u)
        assert np.max(np.abs(change)) > 1e-3, where
