"""The slope of a table in equations: it is the curve's derivative, and is differentiated in its turn."""

from __future__ import annotations

import numpy as np
import pytest

from multibody.equations import tables

POINTS = np.array([0.0, 0.4, 1.1, 1.5, 2.6])
VALUES = np.array([0.3, -0.2, 0.8, 0.9, 0.1])
KINDS = [
    ("linear", tables.linear, tables.linear_rate, tables.linear_rate_tangent, tables.linear_rate_slope),
    ("cubic", tables.cubic, tables.cubic_rate, tables.cubic_rate_tangent, tables.cubic_rate_slope),
]
STEP = 1e-6
INSIDE = np.linspace(-0.5, 3.0, 71) + 0.0123  # no point and no end of the curve within a step


@pytest.mark.parametrize(("kind", "curve", "rate", "tangent", "bend"), KINDS)
def test_slope_is_the_curves_derivative_and_zero_beyond_its_ends(kind, curve, rate, tangent, bend):
    p, n = tables.packed(POINTS, VALUES, kind), POINTS.size
    for x in INSIDE:
        numeric = (curve(p, 0, n, x + STEP) - curve(p, 0, n, x - STEP)) / (2 * STEP)
        # central differences over 1e-6: rounding 1e-10, third derivative times 1e-12
        assert rate(p, 0, n, x) == pytest.approx(numeric, abs=1e-8)
    assert rate(p, 0, n, -1.0) == rate(p, 0, n, 9.0) == 0.0


@pytest.mark.parametrize(("kind", "curve", "rate", "tangent", "bend"), KINDS)
def test_tangent_of_the_slope_follows_argument_and_points(kind, curve, rate, tangent, bend):
    p, n = tables.packed(POINTS, VALUES, kind), POINTS.size
    p_dot = 0.1 * np.random.default_rng(5).normal(size=p.size)
    for x in INSIDE:
        value, change = tangent(p, p_dot, 0, n, x, 0.7)
        after, before = (rate(p + s * STEP * p_dot, 0, n, x + s * STEP * 0.7) for s in (1, -1))
        assert value == rate(p, 0, n, x)
        assert change == pytest.approx((after - before) / (2 * STEP), abs=1e-7)
        again, alone = bend(p, 0, n, x)
        assert again == value
        assert alone == pytest.approx(tangent(p, 0 * p_dot, 0, n, x, 1.0)[1], abs=1e-12)
