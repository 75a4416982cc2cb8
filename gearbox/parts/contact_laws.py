"""Laws of one point of contact: impact force with damping that never pulls, and Coulomb friction (Table 2)."""

from __future__ import annotations

import math

# fmt: off
__all__ = [
    "friction_coefficient", "friction_coefficients", "impact", "near_powers", "power", "signed_force",
]

#: A contact of stiffness K carries K newtons when pressed in by 1 mm: Table 2 gives K in N/mm^e.
PER_UNIT = 1e3
#: Penetrations that differ by less, as a share, have powers that follow from each other by nine terms of a series.
SERIES = 0.02


def smooth_step(x, x_0, h_0, x_1, h_1):
    """Return the cubic step from h_0 at x_0 to h_1 at x_1, constant outside."""
    q = min(max((x - x_0) / (x_1 - x_0), 0.0), 1.0)
    return h_0 + (h_1 - h_0) * q * q * (3.0 - 2.0 * q)


def power(depth, K, e):
    """Return the elastic force K·δ^e of a penetration."""
    return K * math.exp(e * math.log(depth * PER_UNIT)) if depth > 0.0 else 0.0


def near_powers(d0, d1, d2, d3, K, e):
    """Return the elastic forces of four penetrations; where they hardly differ, three follow from the second.

    (1 + x)^e = 1 + e·x·(1 + (e − 1)/2·x·(1 + (e − 2)/3·x·(1 + …))), exact to rounding for |x| up to `SERIES`.
    """
    e1 = power(d1, K, e)
    if max(abs(d0 - d1), abs(d2 - d1), abs(d3 - d1)) < SERIES * d1:
        c2 = 0.5 * (e - 1.0)
        c3 = (e - 2.0) * 0.3333333333333333
        c4 = 0.25 * (e - 3.0)
        c5 = 0.2 * (e - 4.0)
        c6 = (e - 5.0) * 0.16666666666666666
        c7 = (e - 6.0) * 0.14285714285714285
        share = 1.0 / d1
        x = (d0 - d1) * share
        y = (d2 - d1) * share
        z = (d3 - d1) * share
        e0 = e1 + e1 * e * x * (1.0 + c2 * x * (1.0 + c3 * x * (1.0 + c4 * x * (1.0 + c5 * x * (
            1.0 + c6 * x * (1.0 + c7 * x))))))
        e2 = e1 + e1 * e * y * (1.0 + c2 * y * (1.0 + c3 * y * (1.0 + c4 * y * (1.0 + c5 * y * (
            1.0 + c6 * y * (1.0 + c7 * y))))))
        e3 = e1 + e1 * e * z * (1.0 + c2 * z * (1.0 + c3 * z * (1.0 + c4 * z * (1.0 + c5 * z * (
            1.0 + c6 * z * (1.0 + c7 * z))))))
    else:
        e0 = power(d0, K, e)
        e2 = power(d2, K, e)
        e3 = power(d3, K, e)
    return e0, e1, e2, e3


def signed_force(depth, rate, elastic, C_D, D_P):
    """Return the elastic force and that of the damper, step(δ; 0, 0, D_P, C_D)·δ̇: negative where it would pull."""
    share = min(max(depth, 0.0) / D_P, 1.0)
    return elastic + C_D * share * share * (3.0 - 2.0 * share) * rate


def impact(depth, rate, K, e, C_D, D_P):
    """Return the force K·δ^e + step(δ; 0, 0, D_P, C_D)·δ̇, as it is and never negative, and its elastic part K·δ^e."""
    elastic = power(depth, K, e)
    signed = signed_force(depth, rate, elastic, C_D, D_P)
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


def friction_coefficients(w0, w1, w2, w3, mu_s, v_s, mu_d, v_d):
    """Return the friction coefficients of four points along a line: the same where all slide fast in one direction."""
    mu0 = friction_coefficient(w0, mu_s, v_s, mu_d, v_d)
    mu1 = mu0
    mu2 = mu0
    mu3 = mu0
    if min(w0, w3) < v_d and max(w0, w3) > -v_d:
        mu1 = friction_coefficient(w1, mu_s, v_s, mu_d, v_d)
        mu2 = friction_coefficient(w2, mu_s, v_s, mu_d, v_d)
        mu3 = friction_coefficient(w3, mu_s, v_s, mu_d, v_d)
    return mu0, mu1, mu2, mu3
