"""Laws of one point of contact: impact force with damping that never pulls, and Coulomb friction (Table 2)."""

from __future__ import annotations

import math

# fmt: off
__all__ = ["PER_UNIT", "friction_coefficient", "impact", "smooth_step"]

#: A contact of stiffness K carries K newtons when pressed in by 1 mm: Table 2 gives K in N/mm^e.
PER_UNIT = 1e3


def smooth_step(x, x_0, h_0, x_1, h_1):
    """Return the cubic step from h_0 at x_0 to h_1 at x_1, constant outside."""
    q = min(max((x - x_0) / (x_1 - x_0), 0.0), 1.0)
    return h_0 + (h_1 - h_0) * q * q * (3.0 - 2.0 * q)


def impact(depth, rate, K, e, C_D, D_P):
    """Return the force K·δ^e + step(δ; 0, 0, D_P, C_D)·δ̇, as it is and never negative, and its elastic part K·δ^e."""
    if depth > 0.0:
        q = min(depth / D_P, 1.0)
        elastic = K * (depth * PER_UNIT) ** e
        signed = elastic + C_D * q * q * (3.0 - 2.0 * q) * rate
    else:
        elastic = 0.0
        signed = 0.0
    return signed, max(signed, 0.0), elastic


def friction_coefficient(v, mu_s, v_s, mu_d, v_d):
    """Return the Coulomb friction coefficient with the sign of the sliding speed v.

    It goes from −mu_s to mu_s between ∓v_s and falls from there to mu_d at v_d, by cubic steps (Table 2).
    """
    speed = abs(v)
    if speed < v_s:
        mu = smooth_step(v, -v_s, -mu_s, v_s, mu_s)
    elif speed < v_d:
        mu = math.copysign(smooth_step(speed, v_s, mu_s, v_d, mu_d), v)
    else:
        mu = math.copysign(mu_d, v)
    return mu
