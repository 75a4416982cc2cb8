"""Geometry of helical gear pairs: Table 1, lines of contact, gaps at tip corners, and gears that cannot run."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gearbox.files.errors import GearError
from gearbox.files.geometry import GearPair

PAIR = GearPair.paper()


def test_radii_and_angles_of_table_1() -> None:
    # r = z m_n / (2 cos β), by hand
    r_1, r_2 = 32 * 3.5e-3 / 2 / math.cos(math.radians(13)), 44 * 3.5e-3 / 2 / math.cos(math.radians(13))
    assert PAIR.pitch_radii == pytest.approx((r_1, r_2), rel=1e-14)
    assert PAIR.pitch_radii == pytest.approx((57.473e-3, 79.025e-3), abs=5e-7)  # PAPER_FACTS of the two papers
    assert PAIR.tip_radii == pytest.approx((r_1 + 3.5e-3, r_2 + 3.5e-3))
    assert PAIR.base_radii == pytest.approx(tuple(r * math.cos(PAIR.transverse_pressure_angle) for r in (r_1, r_2)))
    assert math.tan(PAIR.transverse_pressure_angle) == pytest.approx(
        math.tan(math.radians(20)) / math.cos(math.radians(13))
    )
    assert math.sin(PAIR.base_helix_angle) == pytest.approx(math.sin(math.radians(13)) * math.cos(math.radians(20)))
    assert PAIR.working_distance == pytest.approx(PAIR.reference_distance)


def test_contact_ratios() -> None:
    assert PAIR.transverse_contact_ratio == pytest.approx(1.639, abs=5e-4)
    assert PAIR.overlap_ratio == pytest.approx(0.716, abs=5e-4)


def test_lines_of_contact_have_their_mean_length() -> None:
    # over a mesh cycle the summed length is ε_α b / cos β_b on average, whatever the overlap
    rolls = (np.arange(2000) + 0.5) / 2000
    mean = PAIR.transverse_contact_ratio * PAIR.width / math.cos(PAIR.base_helix_angle)
    assert PAIR.line_length(rolls).mean() == pytest.approx(mean, rel=1e-6)
    assert PAIR.line_length([0.25])[0] == pytest.approx(PAIR.line_length([1.25])[0], rel=1e-12)


def test_lines_of_contact_stay_on_the_path_and_the_face() -> None:
    for roll in np.linspace(0.0, 1.0, 37):
        lines = PAIR.contact_lines(float(roll))
        for (s_0, s_1), (z_0, z_1) in zip(lines.s, lines.z, strict=True):
            assert PAIR.path_start - 1e-15 <= min(s_0, s_1)
            assert max(s_0, s_1) <= PAIR.path_end + 1e-15
            assert -0.5 * PAIR.width - 1e-15 <= z_0 < z_1 <= 0.5 * PAIR.width + 1e-15


def test_spur_gears_have_one_or_two_full_lines() -> None:
    spur = GearPair.paper(helix_angle=0.0)
    lengths = spur.line_length((np.arange(1000) + 0.5) / 1000)
    assert set(np.round(lengths / spur.width, 9)) == {1.0, 2.0}
    assert lengths.mean() / spur.width == pytest.approx(spur.transverse_contact_ratio, abs=2e-3)


def _corner_by_hand(pair: GearPair, x: float) -> float:
    """Gap of the driving gear's tip corner beyond its path, by rolling the other flank point by point."""
    base, other = pair.base_radii
    alpha, d = pair.working_pressure_angle, pair.working_distance
    t = np.array([math.sin(alpha), math.cos(alpha)])
    end = np.array([base * math.cos(alpha), -base * math.sin(alpha)]) + math.sqrt(pair.tip_radii[0] ** 2 - base**2) * t
    turn = x / base
    corner = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]]) @ end
    touch = np.array([d - other * math.cos(alpha), other * math.sin(alpha)])
    # the other flank is where an unwound string from its base circle ends; it has turned by x as well
    length = np.linalg.norm(touch - end)  # of the string when flank and corner touched
    angles = np.linspace(-0.25, 0.25, 200001)
    string = length - x + other * angles
    start = np.array([d, 0.0])[:, None] + other * np.stack([-np.cos(alpha + angles), np.sin(alpha + angles)])
    points = start - string * np.stack([np.sin(alpha + angles), np.cos(alpha + angles)])
    return float(np.min(np.hypot(points[0] - corner[0], points[1] - corner[1])))


@pytest.mark.parametrize("x", [0.5e-3, 1.5e-3, 3e-3])
def test_gap_of_the_corner_is_its_distance_from_the_flank(x: float) -> None:
    # the gap along the normal of the flank is the least distance; points of the flank are 0.2 µm apart at most
    assert PAIR.gap(0, np.array([x]))[0] == pytest.approx(_corner_by_hand(PAIR, x), rel=2e-3)


def test_gap_coefficients_fit_the_gap() -> None:
    x = np.linspace(0.0, 3e-3, 20)
    for gear in (0, 1):
        c2, c3 = PAIR.gap_coefficients(gear)
        assert np.max(np.abs(c2 * x**2 + c3 * x**3 - PAIR.gap(gear, x))) < 1e-7  # 0.1 µm of 120 µm


def test_profile_shift_and_centre_distance_agree() -> None:
    shifted = GearPair.paper(shift_1=0.3, shift_2=0.2)
    assert shifted.working_distance > PAIR.working_distance
    same = GearPair.paper(shift_1=0.3, shift_2=0.2, centre_distance=shifted.working_distance)
    assert same.circumferential_backlash == pytest.approx(0.0, abs=1e-12)
    wider = GearPair.paper(centre_distance=PAIR.working_distance + 1e-4)
    # moving the gears apart by Δa opens 2 Δa tan α_wt between the flanks, to first order
    assert wider.circumferential_backlash == pytest.approx(2e-4 * math.tan(wider.working_pressure_angle), rel=5e-3)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"teeth_1": 8}, "interfere"),
        ({"centre_distance": 0.134}, "cuts"),
        ({"centre_distance": 0.1}, "move the gears apart"),
        ({"addendum": 0.5}, "contact ratio is 0.872"),
        ({"addendum": 0.5, "dedendum": 0.4}, "below one"),
        ({"helix_angle": 13.0}, "744.8°"),
        ({"module": -1.0}, "positive"),
        ({"teeth_1": 32.5}, "whole number"),
        ({"shift_1": 2.0}, "pointed"),
        ({"width": float("nan")}, "positive"),
    ],
)
def test_gears_that_cannot_run_are_refused_with_the_reason(changes: dict[str, float], told: str) -> None:
    with pytest.raises(GearError, match=told):
        GearPair.paper(**changes)


def test_all_faults_are_told_at_once() -> None:
    with pytest.raises(GearError) as caught:
        GearPair.paper(module=-1.0, width=0.0, backlash=-1e-3)
    assert len(caught.value.faults) == 3
