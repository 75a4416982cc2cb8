"""Laws of tooth contact as functions that equations call: impact force, friction, integration along a contact line.

A line of contact is described by few numbers (see docs, "Tooth contact"): along it the penetration of the two rigid
flanks is δ = a + b·s + c·z + q·s², less the gaps that the tips leave, with z across the face and s along the line of
action.  The two are tied by the base helix: s = p1 + slope·z for what moves with gear 1, and r = p2 − slope·z, which is
−s up to the deflection, for what moves with gear 2.
"""

from __future__ import annotations

import math

from gearbox.parts.contact_laws import friction_coefficient, friction_coefficients, impact, near_powers, signed_force

# fmt: off
__all__ = ["bell", "closeness", "extent", "four", "held", "let_go", "line", "patch", "summed", "tip"]

#: Abscissas of the Gauss-Legendre rule with four points on [-1, 1], the difference of their squares, half weights.
INNER, OUTER, BETWEEN = 0.3399810435848563, 0.8611363115940526, 0.6259686373402064
WEIGHT_INNER, WEIGHT_OUTER = 0.32607257743127307, 0.17392742256872693
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


def relieved(place, a, b, c, q, sense, steep, p1, p2, way, relief, start, edge):
    """Return where along its path a contact ends at a tip whose relief is deeper than the penetration, else its edge.

    ``place`` is a guess; ``way`` is 1 for the tip of gear 1, which counts along s, and −1 for that of gear 2, along r.
    """
    end = edge
    for _ in range(3):
        z = sense * (place - p1 if way > 0.0 else p2 - place) / steep
        s = p1 + sense * steep * z
        depth = max(a + s * (b + q * s) + z * c, 0.0)
        if depth < relief:
            end = start + math.sqrt(depth / relief) * (edge - start)
        place = end
    return end


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


def let_go(f0, f1, f2, f3, d0, d1, d2, d3):
    """Return between which places, on [-1, 1], a piece carries whose signed forces at the Gauss points are f0 to f3.

    Parting so fast that the damper would pull, flanks carry nothing.  Where that begins the force bends, and an
    integral over it with few points would be noisy.  The place is a root of the cubic through the forces over the
    squares of the penetrations d0 to d3, which are smooth even where a contact ends.
    """
    first = -1.0
    last = 1.0
    most = max(f0, f1, f2, f3)
    if min(d0, d1, d2, d3) > 0.0 and min(f0, f1, f2, f3) < 0.5 * most:
        g0 = f0 / (d0 * d0)
        g1 = f1 / (d1 * d1)
        g2 = f2 / (d2 * d2)
        g3 = f3 / (d3 * d3)
        # a force of less than half the most may end within the piece: c0 + c1·x + c2·x² + c3·x³, even and odd parts
        steep = 0.5 * (g2 - g1) / INNER
        c2 = 0.5 * (g0 + g3 - g1 - g2) / BETWEEN
        c3 = (0.5 * (g3 - g0) / OUTER - steep) / BETWEEN
        c0 = 0.5 * (g1 + g2) - c2 * INNER * INNER
        c1 = steep - c3 * INNER * INNER
        odd = c1 + c3
        if abs(c0 + c2) < abs(odd):
            root = -(c0 + c2) / odd
            for _ in range(3):
                grow = c1 + root * (2.0 * c2 + 3.0 * root * c3)
                if grow * odd > 0.0:
                    root = min(max(root - (c0 + root * (c1 + root * (c2 + root * c3))) / grow, -1.0), 1.0)
            first = root if odd > 0.0 else -1.0
            last = 1.0 if odd > 0.0 else root
    return first, last


def four(z0, z1, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1, edge2, c22, c32,
         relief2, start2, pit, pit_s, pit_half, pit_z, pit_width, K, e, C_D, D_P, u0, u1, u2, mu_s, v_s, mu_d, v_d):
    """Return the integral of `patch` from z0 to z1 by four Gauss points, and what of the piece carries (`let_go`).

    The moments with s are left out: they follow from those with z.  After the friction's power come those of the force
    and, with the elastic energy, of its elastic part: what they differ by is lost to damping.
    """
    middle = 0.5 * (z0 + z1)
    half = 0.5 * (z1 - z0)
    near = INNER * half
    far = OUTER * half
    s0, d0, r0, g10, g20 = closeness(
        middle - far, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1, edge2, c22, c32,
        relief2, start2, pit, pit_s, pit_half, pit_z, pit_width)
    s1, d1, r1, g11, g21 = closeness(
        middle - near, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1, edge2, c22, c32,
        relief2, start2, pit, pit_s, pit_half, pit_z, pit_width)
    s2, d2, r2, g12, g22 = closeness(
        middle + near, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1, edge2, c22, c32,
        relief2, start2, pit, pit_s, pit_half, pit_z, pit_width)
    s3, d3, r3, g13, g23 = closeness(
        middle + far, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1, edge2, c22, c32,
        relief2, start2, pit, pit_s, pit_half, pit_z, pit_width)
    e0, e1, e2, e3 = near_powers(d0, d1, d2, d3, K, e)
    f0 = signed_force(d0, r0, e0, C_D, D_P)
    f1 = signed_force(d1, r1, e1, C_D, D_P)
    f2 = signed_force(d2, r2, e2, C_D, D_P)
    f3 = signed_force(d3, r3, e3, C_D, D_P)
    first, last = let_go(f0, f1, f2, f3, d0, d1, d2, d3)
    light = 2.0 * WEIGHT_OUTER * half
    heavy = 2.0 * WEIGHT_INNER * half
    n0 = light * max(f0, 0.0)
    n1 = heavy * max(f1, 0.0)
    n2 = heavy * max(f2, 0.0)
    n3 = light * max(f3, 0.0)
    w0 = u0 + s0 * u1 + (middle - far) * u2
    w1 = u0 + s1 * u1 + (middle - near) * u2
    w2 = u0 + s2 * u1 + (middle + near) * u2
    w3 = u0 + s3 * u1 + (middle + far) * u2
    mu0, mu1, mu2, mu3 = friction_coefficients(w0, w1, w2, w3, mu_s, v_s, mu_d, v_d)
    t0 = n0 * mu0
    t1 = n1 * mu1
    t2 = n2 * mu2
    t3 = n3 * mu3
    n = n0 + n1 + n2 + n3
    t = t0 + t1 + t2 + t3
    energy = (light * (e0 * d0 + e3 * d3) + heavy * (e1 * d1 + e2 * d2)) / (e + 1.0)
    gain = light * (e0 * r0 + e3 * r3) + heavy * (e1 * r1 + e2 * r2)
    return (
        n, middle * n + far * (n3 - n0) + near * (n2 - n1), n0 * g10 + n1 * g11 + n2 * g12 + n3 * g13,
        n0 * g20 + n1 * g21 + n2 * g22 + n3 * g23, t, middle * t + far * (t3 - t0) + near * (t2 - t1),
        t0 * w0 + t1 * w1 + t2 * w2 + t3 * w3, n0 * r0 + n1 * r1 + n2 * r2 + n3 * r3, energy, gain, first, last)


def held(z0, z1, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1, edge2, c22, c32,
         relief2, start2, K, e, C_D, D_P, u0, u1, u2, mu_s, v_s, mu_d, v_d):
    """Return the integral of `patch` from z0 to z1, its points in the part that has not let go, less moments with s."""
    n, n_z, n_1, n_2, t, t_z, rubbing, power, energy, gain, first, last = four(
        z0, z1, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1, edge2, c22, c32,
        relief2, start2, 0.0, 0.0, 0.0, 0.0, 1.0, K, e, C_D, D_P, u0, u1, u2, mu_s, v_s, mu_d, v_d)
    if last - first < 2.0:
        n, n_z, n_1, n_2, t, t_z, rubbing, power, _, _, _, _ = four(
            0.5 * (z0 + z1 + (z1 - z0) * first), 0.5 * (z0 + z1 + (z1 - z0) * last), p1, p2, slope, a, b, c, q, da, db,
            dc, v1, v2, edge1, c21, c31, relief1, start1, edge2, c22, c32, relief2, start2, 0.0, 0.0, 0.0, 0.0, 1.0, K,
            e, C_D, D_P, u0, u1, u2, mu_s, v_s, mu_d, v_d)
    return n, n_z, n_1, n_2, t, t_z, energy, power - gain, rubbing


def summed(share, n, n_z, n_1, n_2, t, t_z, energy, loss, rubbing, d_n, d_nz, d_n1, d_n2, d_t, d_tz, d_e, d_l, d_r):
    """Return the nine integrals of a line after those of one more piece, times ``share``, are added."""
    return (
        n + share * d_n, n_z + share * d_nz, n_1 + share * d_n1, n_2 + share * d_n2, t + share * d_t,
        t_z + share * d_tz, energy + share * d_e, loss + share * d_l, rubbing + share * d_r)


def pitted(begin, finish, sense, steep, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1,
           start1, edge2, c22, c32, relief2, start2, pit, pit_s, pit_half, pit_z, pit_width, K, e, C_D, D_P, u0, u1,
           u2, mu_s, v_s, mu_d, v_d):
    """Return by how much a pit changes what `held` gives for the line: exactly zero for a pit without depth."""
    n = 0.0
    n_z = 0.0
    n_1 = 0.0
    n_2 = 0.0
    t = 0.0
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
            d_n, d_nz, d_n1, d_n2, d_t, d_tz, d_r, d_p, d_e, d_g, _, _ = four(
                sense * first, sense * last, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1,
                start1, edge2, c22, c32, relief2, start2, deep, pit_s, pit_half, pit_z, pit_width, K, e, C_D, D_P, u0,
                u1, u2, mu_s, v_s, mu_d, v_d)
            n, n_z, n_1, n_2, t, t_z, energy, loss, rubbing = summed(
                share, n, n_z, n_1, n_2, t, t_z, energy, loss, rubbing, d_n, d_nz, d_n1, d_n2, d_t, d_tz, d_e,
                d_p - d_g, d_r)
    return n, n_z, n_1, n_2, t, t_z, energy, loss, rubbing


def line(z_low, z_high, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1, start1, edge2, c22,
         c32, relief2, start2, pit, pit_s, pit_half, pit_z, pit_width, K, e, C_D, D_P, u0, u1, u2, mu_s, v_s, mu_d,
         v_d):
    """Return the integral of `patch` over one line of contact between z_low and z_high.

    The line is split where it leaves the path of contact, where a relief begins and where sliding changes its
    direction, and ends where the corners, or reliefs deeper than the penetration, lose contact; between these points
    nothing switches on or off but what has let go (`held`).
    """
    # positions along the line in the sense in which s grows; a spur gear's line has no slope to speak of
    sense = math.copysign(1.0, slope)
    steep = max(abs(slope), 1e-9)
    low = z_low if sense > 0.0 else -z_high
    high = z_high if sense > 0.0 else -z_low
    at_2 = min(max((p2 - edge2) / steep, low), high)
    at_1 = min(max((edge1 - p1) / steep, low), high)
    begins_2 = at_2
    begins_1 = at_1
    if relief2 > 0.0:
        end_2 = relieved(edge2, a, b, c, q, sense, steep, p1, p2, -1.0, relief2, start2, edge2)
        at_2 = min(max((p2 - end_2) / steep, low), high)
        begins_2 = min(max((p2 - start2) / steep, low), high)
    if relief1 > 0.0:
        end_1 = relieved(edge1, a, b, c, q, sense, steep, p1, p2, 1.0, relief1, start1, edge1)
        at_1 = min(max((end_1 - p1) / steep, low), high)
        begins_1 = min(max((start1 - p1) / steep, low), high)
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
    begins_2 = min(max(begins_2, at_2), at_1)
    begins_1 = min(max(begins_1, at_2), at_1)
    inner = min(begins_2, min(still, begins_1))
    outer = max(begins_2, max(still, begins_1))
    between = max(min(begins_2, begins_1), min(max(begins_2, begins_1), still))
    n = 0.0
    n_z = 0.0
    n_1 = 0.0
    n_2 = 0.0
    t = 0.0
    t_z = 0.0
    energy = 0.0
    loss = 0.0
    rubbing = 0.0
    last = begin
    for i in range(6):
        first = last
        if i < 2.5:
            last = at_2 if i < 0.5 else inner if i < 1.5 else between
        else:
            last = outer if i < 3.5 else at_1 if i < 4.5 else finish
        if last - first > NOTHING:
            d_n, d_nz, d_n1, d_n2, d_t, d_tz, d_e, d_l, d_r = held(
                sense * first, sense * last, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1,
                start1, edge2, c22, c32, relief2, start2, K, e, C_D, D_P, u0, u1, u2, mu_s, v_s, mu_d, v_d)
            n, n_z, n_1, n_2, t, t_z, energy, loss, rubbing = summed(
                sense, n, n_z, n_1, n_2, t, t_z, energy, loss, rubbing, d_n, d_nz, d_n1, d_n2, d_t, d_tz, d_e, d_l, d_r)
    if pit_half > 0.0:
        d_n, d_nz, d_n1, d_n2, d_t, d_tz, d_e, d_l, d_r = pitted(
            begin, finish, sense, steep, p1, p2, slope, a, b, c, q, da, db, dc, v1, v2, edge1, c21, c31, relief1,
            start1, edge2, c22, c32, relief2, start2, pit, pit_s, pit_half, pit_z, pit_width, K, e, C_D, D_P, u0, u1,
            u2, mu_s, v_s, mu_d, v_d)
        n, n_z, n_1, n_2, t, t_z, energy, loss, rubbing = summed(
            1.0, n, n_z, n_1, n_2, t, t_z, energy, loss, rubbing, d_n, d_nz, d_n1, d_n2, d_t, d_tz, d_e, d_l, d_r)
    return n, p1 * n + slope * n_z, n_z, n_1, n_2, t, p1 * t + slope * t_z, t_z, energy, loss, rubbing
