"""Forms of coordinates that a mesh is made of: penetration, sliding, turning points, waves over the teeth."""

from __future__ import annotations

import math

# fmt: off
__all__ = ["approach", "hit", "sliding", "turned", "waves"]


def approach(m, s_x, s_y, c_b, s_b, r_1, r_2, x, y, z, roll_x, roll_y, roll_y1, roll_y2, way):
    """Return a, b, c of the penetration a + b·s + c·z of a flank (m = 1 front, −1 back), or of its rate.

    x, y, z and roll_x, roll_y are those of gear 1 relative to gear 2; ``way`` is what the gears have turned towards
    each other along the line of action, of direction (s_x, s_y); c_b, s_b are cosine and sine of the base helix angle.
    """
    n_x = c_b * s_x
    n_y = m * c_b * s_y
    n_z = -m * s_b
    a = x * n_x + y * n_y + z * n_z - n_z * (r_1 * roll_y1 + r_2 * roll_y2) + m * c_b * way
    b = n_z * (m * s_y * roll_x - s_x * roll_y)
    c = n_x * roll_y - n_y * roll_x
    return a, b, c


def sliding(m, s_x, s_y, r_1, r_2, v_x, v_y, w_x, w_y, w_1, w_2):
    """Return u₀, u₁, u₂ of the sliding speed u₀ + u₁·s + u₂·z of gear 1 against gear 2, in the transverse section."""
    t_x = m * s_y
    t_y = -s_x
    u0 = v_x * t_x + v_y * t_y + t_y * (r_1 * w_1 + r_2 * w_2)
    return u0, w_2 - w_1, w_y * t_x - w_x * t_y


def hit(tooth, wanted, teeth):
    """Return 1 where a running tooth number is the wanted tooth of a gear, else 0."""
    apart = tooth - wanted - teeth * math.floor((tooth - wanted) / teeth + 0.5)
    return 1.0 if abs(apart) < 0.5 else 0.0


def turned(x, y, angle):
    """Return a point that turns with a body."""
    c = math.cos(angle)
    s = math.sin(angle)
    return c * x - s * y, s * x + c * y


def waves(angle, cos_2, sin_2, cos_3, sin_3, cos_4, sin_4):
    """Return two, three and four waves a turn at an angle, by their cosine and sine parts."""
    c = math.cos(angle)
    s = math.sin(angle)
    c_2 = c * c - s * s
    s_2 = 2.0 * c * s
    return (
        cos_2 * c_2 + sin_2 * s_2 + cos_3 * (c * c_2 - s * s_2) + sin_3 * (s * c_2 + c * s_2)
        + cos_4 * (c_2 * c_2 - s_2 * s_2) + sin_4 * 2.0 * c_2 * s_2)
