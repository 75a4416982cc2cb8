"""Laws of one point of contact, and where a piece of a line lets go."""

from __future__ import annotations

import math

import pytest

from gearbox.parts.contact_laws import SERIES, friction_coefficient, friction_coefficients, impact, near_powers
from gearbox.parts.mesh import waves
from gearbox.parts.tooth_contact import INNER, OUTER, let_go

TABLE_2 = (0.1, 1e-3, 0.08, 1e-2)
PLACES = (-OUTER, -INNER, INNER, OUTER)


@pytest.mark.parametrize("e", [1.0, 1.5, 2.0, 2.27, 2.5, 3.0])
@pytest.mark.parametrize("spread", [0.0, 0.3 * SERIES, 0.999 * SERIES, 0.5])
def test_powers_of_near_penetrations_are_exact(e: float, spread: float) -> None:
    depths = [40e-6 * (1.0 + spread * x) for x in (-1.0, 0.0, 0.4, 1.0)]
    assert near_powers(*depths, 8.6e5, e) == pytest.approx([8.6e5 * (d * 1e3) ** e for d in depths], rel=1e-13)


def test_what_does_not_touch_carries_nothing() -> None:
    assert near_powers(-1e-6, 0.0, 1e-6, -2e-6, 8.6e5, 2.0) == pytest.approx((0.0, 0.0, 8.6e5 * 1e-6, 0.0), rel=1e-12)
    assert impact(-1e-6, 5.0, 8.6e5, 2.0, 86e3, 1e-4) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("speeds", [(0.5, 0.4, 0.3, 0.2), (-1.0, -2.0, -3.0, -4.0), (-0.02, -0.005, 0.005, 0.02)])
def test_friction_of_four_points_is_that_of_each(speeds: tuple[float, float, float, float]) -> None:
    assert friction_coefficients(*speeds, *TABLE_2) == tuple(friction_coefficient(v, *TABLE_2) for v in speeds)


@pytest.mark.parametrize("root", [-0.97, -0.7, 0.05, 0.6, 0.93])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_place_where_a_force_ends_is_found(root: float, side: float) -> None:
    """A force per squared penetration that is a cubic; also where it ends before or behind all four points."""
    depths = [1e-5 * (1.2 + x) for x in PLACES]
    forces = [side * (x - root) * (3.0 + x + 0.5 * x * x) * d * d for x, d in zip(PLACES, depths, strict=True)]
    assert let_go(*forces, *depths) == pytest.approx((root, 1.0) if side > 0.0 else (-1.0, root), abs=1e-6)


def test_a_piece_that_holds_is_whole() -> None:
    depths = [4e-5] * 4
    assert let_go(100.0, 110.0, 90.0, 80.0, *depths) == (-1.0, 1.0)
    assert let_go(100.0, 60.0, 30.0, 10.0, *[1e-5 * (1.0 - 0.9 * x) for x in PLACES]) == (-1.0, 1.0)


def test_waves_over_the_teeth_are_what_their_names_say() -> None:
    parts = (0.7, -0.2, 0.3, 0.5, -0.4, 0.1)
    for angle in (0.0, 0.3, 2.0, 5.5):
        pairs = zip((2, 3, 4), parts[::2], parts[1::2], strict=True)
        wanted = sum(a * math.cos(k * angle) + b * math.sin(k * angle) for k, a, b in pairs)
        assert waves(angle, *parts) == pytest.approx(wanted, abs=1e-14)
