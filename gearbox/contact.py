"""Laws of tooth contact as functions that equations call: impact force, friction, integration along a contact line.

A line of contact is described by few numbers (see docs, "Tooth contact"): along it the penetration of the two rigid
flanks is δ = a + b·s + c·z + q·s², less the gaps that the tips leave, with z across the face and s along the line of
action.  The two are tied by the base helix: s = p1 + slope·z for what moves with gear 1, and r = p2 − slope·z, which is
−s up to the deflection, for what moves with gear 2.
"""

from __future__ import annotations

import math

from gearbox.contact_laws import PER_UNIT, friction_coefficient, impact, smooth_step

# fmt: off
__all__ = [
    "bell", "closeness", "extent", "friction_coefficient", "impact", "inside", "letting_go", "lift", "line", "patch",
    "piece", "pitted", "smooth_step", "three", "tip",
]

#: Abscissas and half weights of the Gauss-Legendre rule with four points on [-1, 1].
GAUSS_1, GAUSS_2 = 0.3399810435848563, 0.8611363115940526
WEIGHT_1, WEIGHT_2 = 0.32607257743127307, 0.17392742256872693
#: The same for the rule with three points.
GAUSS_3, WEIGHT_MIDDLE, WEIGHT_3 = 0.7745966692414834, 0.4444444444444444, 0.2777777777777778
#: Pieces of a line that are shorter (m) count as nothing.
NOTHING = 1e-12


def tip(r, edge, c2, c3, relief, start):
    """Return the gap that a tip leaves at r along the line of action, and its slope: relief, then the tip's corner."""
    if r > edge:
        x = r - edge
        gap = relief + x * x * (c2 + c3 * x)
        slope = x * (2.0 * c2 + 3.0 * c3 * x)
    elif r > start:
        q = (r - start) / (edge - start)
        gap = relief * q * q
        slope = 2.0 * relief * q / (edge - start)
    else:
        gap = 0.0
        slope = 0.0
    return gap, slope


def extent(depth, c2, c3):
    """Return how far beyond its path a contact pressed in by ``depth`` reaches: c2·x² + c3·x³ = depth."""
    if depth > 1e-15:
        x = math.sqrt(depth / c2)
        x = x - (x * x * (c2 + c3 * x) - depth) / (x * (2.0 * c2 + 3.0 * c3 * x))
        x = x - (x * x * (c2 + c3 * x) - depth) / (x * (2.0 * c2 + 3.0 * c3 * x))
    else:
        x = 0.0
    return x


def bell(x, centre, half):
    """Return a bump of height 1, (1 − u²)² within ``half`` of the centre and 0 outside, and its slope."""
    u = (x - centre) / half
    if abs(u) < 1.0:
        w = 1.0 - u * u
        height = w * w
        slope = -4.0 * u * w / half
    else:
        height = 0.0
        slope = 0.0
    return height, slope


def closeness(z, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1, edge2, c22, c32,
              relief2, start2, pit, pit_s, pit_half, pit_z, pit_width):
    """Return s, penetration, its rate, and the slopes of the gaps along s and r, at z on a line of contact."""
    s = p1 + slope * z
    r = p2 - slope * z
    gap1, slope1 = tip(s, edge1, c21, c31, relief1, start1)
    gap2, slope2 = tip(r, edge2, c22, c32, relief2, start2)
    depth = a + s * (b + q * s) + z * c - gap1 - gap2
    slope1 = slope1 - b - 2.0 * q * s
    if abs(s - pit_s) < pit_half:
        across, across_slope = bell(s, pit_s, pit_half)
        along, _ = bell(z, pit_z, pit_width)
        depth = depth - pit * across * along
        slope1 = slope1 + pit * across_slope * along
    return s, depth, da + s * db + z * dc - slope1 * v1 - slope2 * v2, slope1, slope2


def patch(z, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1, edge2, c22, c32, relief2,
          start2, pit, pit_s, pit_half, pit_z, pit_width, K, e, C_D, D_P, u0, u1, u2, mu_s, v_s, mu_d, v_d):
    """Return what a line carries at z, per length of face.

    Normal force and its moments with s and z; the parts that the slopes of the gaps turn into torque on gear 1 and 2;
    friction and its moments; elastic energy, power lost to contact damping and to friction.
    """
    s, depth, rate, slope1, slope2 = closeness(
        z, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1, edge2, c22, c32, relief2,
        start2, pit, pit_s, pit_half, pit_z, pit_width)
    _, force, elastic = impact(depth, rate, K, e, C_D, D_P)
    sliding = u0 + s * u1 + z * u2
    rub = force * friction_coefficient(sliding, mu_s, v_s, mu_d, v_d)
    return (
        force, force * s, force * z, force * slope1, force * slope2, rub, rub * s, rub * z,
        elastic * depth / (e + 1.0), (force - elastic) * rate, rub * sliding)


def lift(z, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1, edge2, c22, c32, relief2,
         start2, K, e, C_D, D_P):
    """Return the force at z per length and per square of the penetration, negative where the damper would pull."""
    _, depth, rate, _, _ = closeness(
        z, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1, edge2, c22, c32, relief2,
        start2, 0.0, 0.0, 0.0, 0.0, 1.0)
    depth = max(depth, 1e-3 * D_P)
    share = min(depth / D_P, 1.0)
    return (K * (depth * PER_UNIT) ** e + C_D * share * share * (3.0 - 2.0 * share) * rate) / (depth * depth)


def letting_go(near, far, sense, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1,
               edge2, c22, c32, relief2, start2, K, e, C_D, D_P):
    """Return where between the end of the path (near) and of the contact (far) parting flanks let go.

    Parting so fast that the damper would pull, flanks carry nothing: the force bends there, and an integral over it
    with few points would be noisy.  Without such a place the result is ``far``.
    """
    found = far
    parting = 0.0
    if abs(far - near) > NOTHING:
        _, _, parting, _, _ = closeness(
            sense * (near + 0.98 * (far - near)), p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31,
            relief1, start1, edge2, c22, c32, relief2, start2, 0.0, 0.0, 0.0, 0.0, 1.0)
    if parting < 0.0:
        x0 = near
        x1 = near + 0.98 * (far - near)
        f1 = lift(
            sense * x1, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1, edge2, c22,
            c32, relief2, start2, K, e, C_D, D_P)
        f0 = 0.0
        if f1 < 0.0:
            f0 = lift(
                sense * x0, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1, edge2,
                c22, c32, relief2, start2, K, e, C_D, D_P)
        if f0 > 0.0:
            for _ in range(2):
                found = x1 - f1 * (x1 - x0) / (f1 - f0)
                f = lift(
                    sense * found, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1,
                    edge2, c22, c32, relief2, start2, K, e, C_D, D_P)
                if f > 0.0:
                    x0 = found
                    f0 = f
                    f1 = 0.5 * f1
                else:
                    x1 = found
                    f1 = f
                    f0 = 0.5 * f0
    return found


def piece(z0, z1, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1, edge2, c22, c32,
          relief2, start2, pit, pit_s, pit_half, pit_z, pit_width, K, e, C_D, D_P, u0, u1, u2, mu_s, v_s, mu_d, v_d):
    """Return the integral of `patch` from z0 to z1 with four Gauss points."""
    middle = 0.5 * (z0 + z1)
    half = 0.5 * (z1 - z0)
    n = 0.0
    n_s = 0.0
    n_z = 0.0
    n_1 = 0.0
    n_2 = 0.0
    t = 0.0
    t_s = 0.0
    t_z = 0.0
    energy = 0.0
    loss = 0.0
    rubbing = 0.0
    for i in range(4):
        side = 1.0 if i > 1.5 else -1.0
        outer = 1.0 if abs(i - 1.5) > 1.0 else 0.0
        z = middle + half * side * (GAUSS_1 + outer * (GAUSS_2 - GAUSS_1))
        w = 2.0 * half * (WEIGHT_1 + outer * (WEIGHT_2 - WEIGHT_1))
        d_n, d_ns, d_nz, d_n1, d_n2, d_t, d_ts, d_tz, d_e, d_l, d_r = patch(
            z, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1, edge2, c22, c32,
            relief2, start2, pit, pit_s, pit_half, pit_z, pit_width, K, e, C_D, D_P, u0, u1, u2, mu_s, v_s, mu_d, v_d)
        n += w * d_n
        n_s += w * d_ns
        n_z += w * d_nz
        n_1 += w * d_n1
        n_2 += w * d_n2
        t += w * d_t
        t_s += w * d_ts
        t_z += w * d_tz
        energy += w * d_e
        loss += w * d_l
        rubbing += w * d_r
    return n, n_s, n_z, n_1, n_2, t, t_s, t_z, energy, loss, rubbing


def three(z0, z1, p1, slope, a, b, c, q, da, db, dc, v1, K, e, C_D, D_P, u0, u1, u2, mu_s, v_s, mu_d, v_d):
    """Return the integral of `patch` from z0 to z1 without gaps by three Gauss points, and the outer signed forces."""
    middle = 0.5 * (z0 + z1)
    half = 0.5 * (z1 - z0)
    n = 0.0
    n_s = 0.0
    n_z = 0.0
    n_1 = 0.0
    t = 0.0
    t_s = 0.0
    t_z = 0.0
    energy = 0.0
    loss = 0.0
    rubbing = 0.0
    at_0 = 0.0
    at_1 = 0.0
    for i in range(3):
        z = middle + half * (i - 1.0) * GAUSS_3
        w = 2.0 * half * (WEIGHT_MIDDLE if abs(i - 1.0) < 0.5 else WEIGHT_3)
        s = p1 + slope * z
        depth = a + s * (b + q * s) + z * c
        steep = b + 2.0 * q * s
        rate = da + s * db + z * dc + steep * v1
        signed, force, elastic = impact(depth, rate, K, e, C_D, D_P)
        at_0 = signed if i < 0.5 else at_0
        at_1 = signed
        sliding = u0 + s * u1 + z * u2
        rub = force * friction_coefficient(sliding, mu_s, v_s, mu_d, v_d)
        n += w * force
        n_s += w * force * s
        n_z += w * force * z
        n_1 -= w * force * steep
        t += w * rub
        t_s += w * rub * s
        t_z += w * rub * z
        energy += w * elastic * depth / (e + 1.0)
        loss += w * (force - elastic) * rate
        rubbing += w * rub * sliding
    return n, n_s, n_z, n_1, t, t_s, t_z, energy, loss, rubbing, at_0, at_1


def inside(z0, z1, p1, slope, a, b, c, q, da, db, dc, v1, K, e, C_D, D_P, u0, u1, u2, mu_s, v_s, mu_d, v_d):
    """Return the integral of `patch` from z0 to z1 on the path of contact, where tips without relief leave no gap.

    There the penetration is a polynomial along the line, so that three Gauss points integrate all that the damper does
    exactly.  Where a part of it has let go, both parts are integrated for themselves.
    """
    n, n_s, n_z, n_1, t, t_s, t_z, energy, loss, rubbing, at_0, at_1 = three(
        z0, z1, p1, slope, a, b, c, q, da, db, dc, v1, K, e, C_D, D_P, u0, u1, u2, mu_s, v_s, mu_d, v_d)
    mean = 0.5 * (at_0 + at_1)
    rise = 0.5 * (at_1 - at_0) / GAUSS_3
    if abs(mean) < abs(rise):
        edge = 0.5 * (z0 + z1) - 0.5 * (z1 - z0) * mean / rise
        n, n_s, n_z, n_1, t, t_s, t_z, energy, loss, rubbing, _, _ = three(
            z0, edge, p1, slope, a, b, c, q, da, db, dc, v1, K, e, C_D, D_P, u0, u1, u2, mu_s, v_s, mu_d, v_d)
        d_n, d_ns, d_nz, d_n1, d_t, d_ts, d_tz, d_e, d_l, d_r, _, _ = three(
            edge, z1, p1, slope, a, b, c, q, da, db, dc, v1, K, e, C_D, D_P, u0, u1, u2, mu_s, v_s, mu_d, v_d)
        n += d_n
        n_s += d_ns
        n_z += d_nz
        n_1 += d_n1
        t += d_t
        t_s += d_ts
        t_z += d_tz
        energy += d_e
        loss += d_l
        rubbing += d_r
    return n, n_s, n_z, n_1, 0.0, t, t_s, t_z, energy, loss, rubbing


def pitted(begin, finish, sense, steep, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1,
           start1, edge2, c22, c32, relief2, start2, pit, pit_s, pit_half, pit_z, pit_width, K, e, C_D, D_P, u0, u1,
           u2, mu_s, v_s, mu_d, v_d):
    """Return by how much a pit changes the integral of `patch` over the line: exactly zero for a pit without depth."""
    n = 0.0
    n_s = 0.0
    n_z = 0.0
    n_1 = 0.0
    n_2 = 0.0
    t = 0.0
    t_s = 0.0
    t_z = 0.0
    energy = 0.0
    loss = 0.0
    rubbing = 0.0
    for i in range(4):
        # the two halves of the pit, each with it and then without it
        side = -1.0 if i < 1.5 else 0.0
        there = i < 0.5 or (i > 1.5 and i < 2.5)
        deep = pit if there else 0.0
        share = sense if there else -sense
        first = min(max((pit_s + side * pit_half - p1) / steep, begin), finish)
        last = min(max((pit_s + (side + 1.0) * pit_half - p1) / steep, begin), finish)
        if last - first > NOTHING:
            d_n, d_ns, d_nz, d_n1, d_n2, d_t, d_ts, d_tz, d_e, d_l, d_r = piece(
                sense * first, sense * last, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1,
                start1, edge2, c22, c32, relief2, start2, deep, pit_s, pit_half, pit_z, pit_width, K, e, C_D, D_P, u0,
                u1, u2, mu_s, v_s, mu_d, v_d)
            n += share * d_n
            n_s += share * d_ns
            n_z += share * d_nz
            n_1 += share * d_n1
            n_2 += share * d_n2
            t += share * d_t
            t_s += share * d_ts
            t_z += share * d_tz
            energy += share * d_e
            loss += share * d_l
            rubbing += share * d_r
    return n, n_s, n_z, n_1, n_2, t, t_s, t_z, energy, loss, rubbing


def line(z_low, z_high, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1, edge2, c22,
         c32, relief2, start2, pit, pit_s, pit_half, pit_z, pit_width, K, e, C_D, D_P, u0, u1, u2, mu_s, v_s, mu_d,
         v_d):
    """Return the integral of `patch` over one line of contact between z_low and z_high.

    The line is split where it leaves the path of contact, where sliding changes its direction and where parting corners
    let go, and ends where the corners lose contact; between these points nothing switches on or off.
    """
    # positions along the line in the sense in which s grows; a spur gear's line has no slope to speak of
    sense = math.copysign(1.0, slope)
    steep = max(abs(slope), 1e-9)
    low = z_low if sense > 0.0 else -z_high
    high = z_high if sense > 0.0 else -z_low
    at_2 = min(max((p2 - edge2) / steep, low), high)
    at_1 = min(max((edge1 - p1) / steep, low), high)
    begin = at_2
    finish = at_1
    if at_2 > low:
        s_2 = p1 + steep * at_2
        deep_2 = a + s_2 * (b + q * s_2) + sense * at_2 * c - relief2
        begin = min(max((p2 - edge2 - extent(deep_2, c22, c32)) / steep, low), high)
    if at_1 < high:
        s_1 = p1 + steep * at_1
        deep_1 = a + s_1 * (b + q * s_1) + sense * at_1 * c - relief1
        finish = min(max((edge1 + extent(deep_1, c21, c31) - p1) / steep, low), high)
    turning = steep * u1 + sense * u2
    still = min(max(-(u0 + p1 * u1) / turning, at_2), at_1) if abs(turning) > 1e-30 else at_2
    n = 0.0
    n_s = 0.0
    n_z = 0.0
    n_1 = 0.0
    n_2 = 0.0
    t = 0.0
    t_s = 0.0
    t_z = 0.0
    energy = 0.0
    loss = 0.0
    rubbing = 0.0
    let_2 = letting_go(
        at_2, begin, sense, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1, edge2, c22,
        c32, relief2, start2, K, e, C_D, D_P)
    let_1 = letting_go(
        at_1, finish, sense, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1, edge2,
        c22, c32, relief2, start2, K, e, C_D, D_P)
    sharp = relief1 + relief2 <= 0.0
    last = begin
    for i in range(6):
        first = last
        last = (
            let_2 if i < 0.5 else at_2 if i < 1.5 else still if i < 2.5 else at_1 if i < 3.5 else let_1 if i < 4.5
            else finish)
        if last - first > NOTHING:
            if sharp and abs(i - 2.5) < 1.0:
                d_n, d_ns, d_nz, d_n1, d_n2, d_t, d_ts, d_tz, d_e, d_l, d_r = inside(
                    sense * first, sense * last, p1, slope, a, b, c, q, da, db, dc, v1, K, e, C_D, D_P, u0, u1, u2,
                    mu_s, v_s, mu_d, v_d)
            else:
                d_n, d_ns, d_nz, d_n1, d_n2, d_t, d_ts, d_tz, d_e, d_l, d_r = piece(
                    sense * first, sense * last, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31,
                    relief1, start1, edge2, c22, c32, relief2, start2, 0.0, 0.0, 0.0, 0.0, 1.0, K, e, C_D, D_P, u0, u1,
                    u2, mu_s, v_s, mu_d, v_d)
            n += sense * d_n
            n_s += sense * d_ns
            n_z += sense * d_nz
            n_1 += sense * d_n1
            n_2 += sense * d_n2
            t += sense * d_t
            t_s += sense * d_ts
            t_z += sense * d_tz
            energy += sense * d_e
            loss += sense * d_l
            rubbing += sense * d_r
    if pit_half > 0.0:
        d_n, d_ns, d_nz, d_n1, d_n2, d_t, d_ts, d_tz, d_e, d_l, d_r = pitted(
            begin, finish, sense, steep, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1,
            start1, edge2, c22, c32, relief2, start2, pit, pit_s, pit_half, pit_z, pit_width, K, e, C_D, D_P, u0, u1,
            u2, mu_s, v_s, mu_d, v_d)
        n += d_n
        n_s += d_ns
        n_z += d_nz
        n_1 += d_n1
        n_2 += d_n2
        t += d_t
        t_s += d_ts
        t_z += d_tz
        energy += d_e
        loss += d_l
        rubbing += d_r
    return n, n_s, n_z, n_1, n_2, t, t_s, t_z, energy, loss, rubbing
