"""The mesh of two helical gears: penetration from the bodies' coordinates, forces, imperfections of the teeth."""

from __future__ import annotations

import math

from gearbox.parts.tooth_contact import line, patch
from multibody.declare.component import Component
from multibody.declare.declarations import Energy, Option, Output, Parameter, Power, Rotation, Table, Translation

# fmt: off
__all__ = ["HelicalMesh", "waves"]


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


class HelicalMesh(Component):
    """Contact of the teeth of a driving gear 1 and a driven gear 2, tooth pair by tooth pair.

    Gear 1 has its axis in the origin, gear 2 at x = centre distance; z is along both axes, and positive rotation of
    gear 1 presses its front flanks against gear 2.  Angles count from where tooth 0 of gear 1 touches at the pitch
    point in the middle of the face without any load, r_b1·θ₁ + r_b2·θ₂ = 0.

    The penetration of a pair is a linear form of the bodies' small displacements along the line of contact.  On it
    acts K·δ^e + step(δ; 0, 0, D_P, C_D)·δ̇ per share of the face, never pulling, and Coulomb friction across the line
    of action.  ``slices=0`` integrates along the moving line of contact, split where something begins or ends;
    ``slices=n`` takes n fixed slices of the face, as a cross-check.  Both flanks can touch, with backlash between.

    With ``imperfect=True`` the teeth have deviations and damage, all zero by default.

    Sources: digital twin-assisted gearbox updating, section 4.1 and Table 2; docs, "Tooth contact".
    """

    lines = Option(4, "how many lines of contact there can be at a time")
    slices = Option(0, "0: moving line of contact; otherwise the number of fixed slices of the face")
    imperfect = Option(False, "True: deviations and damage of the teeth can be given")

    teeth_1 = Parameter(None, "", "teeth of gear 1", min=1.0)
    teeth_2 = Parameter(None, "", "teeth of gear 2", min=1.0)
    base_1 = Parameter(None, "m", "base radius of gear 1", min=1e-9)
    base_2 = Parameter(None, "m", "base radius of gear 2", min=1e-9)
    alpha = Parameter(None, "rad", "working transverse pressure angle")
    beta_b = Parameter(0.0, "rad", "base helix angle; positive when gear 1 is right-handed")
    width = Parameter(None, "m", "face width", min=1e-9)
    base_pitch = Parameter(None, "m", "transverse base pitch", min=1e-9)
    edge_1 = Parameter(None, "m", "end of the path of contact from the pitch point: tip of gear 1")
    edge_2 = Parameter(None, "m", "beginning of the path of contact before the pitch point: tip of gear 2")
    square_1 = Parameter(None, "1/m", "normal gap of gear 1's corner beyond the path, per distance squared", min=1e-9)
    cube_1 = Parameter(0.0, "1/m**2", "the same, per distance cubed")
    square_2 = Parameter(None, "1/m", "normal gap of gear 2's corner before the path, per distance squared", min=1e-9)
    cube_2 = Parameter(0.0, "1/m**2", "the same, per distance cubed")
    reach = Parameter(5e-3, "m", "how far outside the path contact is looked for", min=0.0)
    relief_1 = Parameter(0.0, "m", "tip relief of gear 1", min=0.0)
    relief_2 = Parameter(0.0, "m", "tip relief of gear 2", min=0.0)
    relief_length_1 = Parameter(3e-3, "m", "length of the relief along the line of action", min=1e-9)
    relief_length_2 = Parameter(3e-3, "m", "length of the relief along the line of action", min=1e-9)
    thickness = Parameter(None, "m", "transverse tooth thickness of gear 1 at the working pitch circle", min=0.0)
    backlash = Parameter(0.0, "m", "normal backlash")

    K = Parameter(8.6e5, "N", "contact stiffness: elastic force of a full-face pair pressed in by 1 mm", min=0.0)
    e = Parameter(2.0, "", "force exponent e_F", min=1.0)
    C_D = Parameter(86e3, "N*s/m", "largest contact damping of a full-face pair", min=0.0)
    D_P = Parameter(1e-4, "m", "penetration at which the damping is full", min=1e-9)
    mu_s = Parameter(0.1, "", "static friction coefficient C_sf", min=0.0)
    v_s = Parameter(1e-3, "m/s", "static transition speed V_st", min=1e-9)
    mu_d = Parameter(0.08, "", "dynamic friction coefficient C_df", min=0.0)
    v_d = Parameter(1e-2, "m/s", "dynamic transition speed V_dt", min=1e-9)

    eccentricity_1 = Parameter(0.0, "m", "distance of gear 1's teeth from its axis", when="imperfect")
    eccentricity_2 = Parameter(0.0, "m", "distance of gear 2's teeth from its axis", when="imperfect")
    high_1 = Parameter(0.0, "rad", "where on gear 1 the eccentricity is, from the x axis at angle 0", when="imperfect")
    high_2 = Parameter(0.0, "rad", "where on gear 2 the eccentricity is, from the x axis at angle 0", when="imperfect")
    runout_x_1 = Parameter(0.0, "m", "the same by its parts: along x at angle 0, added", when="imperfect")
    runout_y_1 = Parameter(0.0, "m", "eccentricity of gear 1 along y at angle 0, added", when="imperfect")
    runout_x_2 = Parameter(0.0, "m", "eccentricity of gear 2 along x at angle 0, added", when="imperfect")
    runout_y_2 = Parameter(0.0, "m", "eccentricity of gear 2 along y at angle 0, added", when="imperfect")
    lobes_cos_1 = Parameter(0.0, "m", "pitch error of gear 1, two waves a turn, highest at tooth 0", when="imperfect")
    lobes_sin_1 = Parameter(0.0, "m", "the same, a quarter wave on", when="imperfect")
    lobes_cos_2 = Parameter(0.0, "m", "pitch error of gear 2, two waves a turn, highest at tooth 0", when="imperfect")
    lobes_sin_2 = Parameter(0.0, "m", "the same, a quarter wave on", when="imperfect")
    lobes3_cos_1 = Parameter(0.0, "m", "pitch error of gear 1, three waves a turn", when="imperfect")
    lobes3_sin_1 = Parameter(0.0, "m", "the same, a quarter wave on", when="imperfect")
    lobes3_cos_2 = Parameter(0.0, "m", "pitch error of gear 2, three waves a turn", when="imperfect")
    lobes3_sin_2 = Parameter(0.0, "m", "the same, a quarter wave on", when="imperfect")
    lobes4_cos_1 = Parameter(0.0, "m", "pitch error of gear 1, four waves a turn", when="imperfect")
    lobes4_sin_1 = Parameter(0.0, "m", "the same, a quarter wave on", when="imperfect")
    lobes4_cos_2 = Parameter(0.0, "m", "pitch error of gear 2, four waves a turn", when="imperfect")
    lobes4_sin_2 = Parameter(0.0, "m", "the same, a quarter wave on", when="imperfect")
    pitch_1 = Parameter(0.0, "m", "pitch error of gear 1 per unit of its pattern", when="imperfect")
    pitch_2 = Parameter(0.0, "m", "pitch error of gear 2 per unit of its pattern", when="imperfect")
    pattern_1 = Table("", "", "pitch error over the tooth", default=((0.0, 1.0), (0.0, 0.0)), when="imperfect")
    pattern_2 = Table("", "", "pitch error over the tooth", default=((0.0, 1.0), (0.0, 0.0)), when="imperfect")
    profile_slope = Parameter(0.0, "m", "material in excess at the end of the path over the middle", when="imperfect")
    profile_form = Parameter(0.0, "m", "material in excess at both ends of the path over the middle", when="imperfect")
    wear = Parameter(0.0, "m", "material worn off at the tip of gear 1; it grows with the sliding", when="imperfect")
    added_backlash = Parameter(0.0, "m", "normal backlash beyond that of the design", when="imperfect")
    misalignment = Parameter(0.0, "rad", "angle between the flanks in the plane of action", when="imperfect")
    variation_1 = Parameter(0.0, "", "share by which K varies over a turn of gear 1, most at tooth 0", when="imperfect")
    variation_2 = Parameter(0.0, "", "share by which K varies over a turn of gear 2, most at tooth 0", when="imperfect")
    variation_sin_1 = Parameter(0.0, "", "the same of gear 1, a quarter turn on", when="imperfect")
    variation_sin_2 = Parameter(0.0, "", "the same of gear 2, a quarter turn on", when="imperfect")
    crack_1 = Parameter(0.0, "", "share of K that a tooth of gear 1 has lost; 1 is a missing tooth", when="imperfect")
    crack_2 = Parameter(0.0, "", "share of K that a tooth of gear 2 has lost; 1 is a missing tooth", when="imperfect")
    chip_1 = Parameter(0.0, "", "share of the face that a tooth of gear 1 has lost", min=0.0, max=1.0, when="imperfect")
    chip_2 = Parameter(0.0, "", "share of the face that a tooth of gear 2 has lost", min=0.0, max=1.0, when="imperfect")
    spall_1 = Parameter(0.0, "m", "depth of a spall on a tooth of gear 1", when="imperfect")
    spall_2 = Parameter(0.0, "m", "depth of a spall on a tooth of gear 2", when="imperfect")
    spall_place = Parameter(0.0, "m", "middle of the spall along the line of action", when="imperfect")
    spall_length = Parameter(2e-3, "m", "length of the spall along the line of action", min=1e-6, when="imperfect")
    spall_width = Parameter(20e-3, "m", "width of the spall across the face", min=1e-6, when="imperfect")
    damaged_1 = Parameter(0.0, "", "number of the damaged tooth of gear 1", when="imperfect")
    damaged_2 = Parameter(0.0, "", "number of the damaged tooth of gear 2", when="imperfect")

    x_1 = Translation("gear 1 across the axes, towards gear 2")
    y_1 = Translation("gear 1 along the tangent of the pitch circles")
    z_1 = Translation("gear 1 along its axis")
    tilt_x_1 = Rotation("gear 1 about x")
    tilt_y_1 = Rotation("gear 1 about y")
    spin_1 = Rotation("gear 1 about its axis")
    x_2 = Translation("gear 2 across the axes")
    y_2 = Translation("gear 2 along the tangent")
    z_2 = Translation("gear 2 along its axis")
    tilt_x_2 = Rotation("gear 2 about x")
    tilt_y_2 = Rotation("gear 2 about y")
    spin_2 = Rotation("gear 2 about its axis")

    force = Output("N", "normal force of the front flanks, sum over all lines")
    back_force = Output("N", "normal force of the back flanks")
    friction = Output("N", "friction on gear 2 across the line of action, sum over all lines")
    deflection = Output("m", "penetration of the rigid front flanks at the pitch point in the middle of the face")
    transmission_error = Output("m", "what gear 1 has turned ahead of gear 2, along the line of action")
    force_x = Output("N", "force of the mesh on gear 2 along x; gear 1 gets the opposite")
    force_y = Output("N", "force of the mesh on gear 2 along y")
    force_z = Output("N", "force of the mesh on gear 2 along z")
    moment_x = Output("N*m", "moment of the mesh on gear 1 about x; gear 2 gets the opposite")
    moment_y_1 = Output("N*m", "moment of the mesh on gear 1 about y")
    moment_y_2 = Output("N*m", "moment of the mesh on gear 2 about y")
    energy = Energy()
    contact_loss = Power(kind="loss", meaning="power lost to contact damping")
    friction_loss = Power(kind="loss", meaning="power lost to friction")

    def equations(self):
        # direction of the line of action in the transverse section, and the base helix
        s_x = math.sin(self.alpha)
        s_y = math.cos(self.alpha)
        c_b = math.cos(self.beta_b)
        s_b = math.sin(self.beta_b)
        r_1 = self.base_1 / s_y
        r_2 = self.base_2 / s_y
        slope = s_b / c_b
        half = 0.5 * self.width
        span = self.edge_1 + self.reach + half * abs(slope)
        ahead = self.base_1 * self.spin_1.angle + self.base_2 * self.spin_2.angle
        faster = self.base_1 * self.spin_1.speed + self.base_2 * self.spin_2.speed
        start_1 = self.edge_1 - self.relief_length_1
        start_2 = self.edge_2 - self.relief_length_2
        k_face = self.K / self.width
        c_face = self.C_D / self.width
        a, b, c = approach(
            1.0, s_x, s_y, c_b, s_b, r_1, r_2, self.x_1.position - self.x_2.position,
            self.y_1.position - self.y_2.position, self.z_1.position - self.z_2.position,
            self.tilt_x_1.angle - self.tilt_x_2.angle, self.tilt_y_1.angle - self.tilt_y_2.angle, self.tilt_y_1.angle,
            self.tilt_y_2.angle, ahead)
        da, db, dc = approach(
            1.0, s_x, s_y, c_b, s_b, r_1, r_2, self.x_1.velocity - self.x_2.velocity,
            self.y_1.velocity - self.y_2.velocity, self.z_1.velocity - self.z_2.velocity,
            self.tilt_x_1.speed - self.tilt_x_2.speed, self.tilt_y_1.speed - self.tilt_y_2.speed, self.tilt_y_1.speed,
            self.tilt_y_2.speed, faster)
        a_back, b_back, c_back = approach(
            -1.0, s_x, s_y, c_b, s_b, r_1, r_2, self.x_1.position - self.x_2.position,
            self.y_1.position - self.y_2.position, self.z_1.position - self.z_2.position,
            self.tilt_x_1.angle - self.tilt_x_2.angle, self.tilt_y_1.angle - self.tilt_y_2.angle, self.tilt_y_1.angle,
            self.tilt_y_2.angle, ahead)
        da_back, db_back, dc_back = approach(
            -1.0, s_x, s_y, c_b, s_b, r_1, r_2, self.x_1.velocity - self.x_2.velocity,
            self.y_1.velocity - self.y_2.velocity, self.z_1.velocity - self.z_2.velocity,
            self.tilt_x_1.speed - self.tilt_x_2.speed, self.tilt_y_1.speed - self.tilt_y_2.speed, self.tilt_y_1.speed,
            self.tilt_y_2.speed, faster)
        u0, u1, u2 = sliding(
            1.0, s_x, s_y, r_1, r_2, self.x_1.velocity - self.x_2.velocity, self.y_1.velocity - self.y_2.velocity,
            self.tilt_x_1.speed - self.tilt_x_2.speed, self.tilt_y_1.speed - self.tilt_y_2.speed, self.spin_1.speed,
            self.spin_2.speed)
        u0_back, u1_back, u2_back = sliding(
            -1.0, s_x, s_y, r_1, r_2, self.x_1.velocity - self.x_2.velocity, self.y_1.velocity - self.y_2.velocity,
            self.tilt_x_1.speed - self.tilt_x_2.speed, self.tilt_y_1.speed - self.tilt_y_2.speed, self.spin_1.speed,
            self.spin_2.speed)
        self.transmission_error = ahead
        self.deflection = a
        n_x = c_b * s_x
        n_y = c_b * s_y
        n_z = s_b
        gap = self.backlash
        q = 0.0
        turn_1 = 0.0
        turn_2 = 0.0
        turn_1_back = 0.0
        turn_2_back = 0.0
        if self.imperfect:
            # eccentric teeth move with the angle: what they add to the penetration, its rate and its slope
            off_x_1, off_y_1 = turned(
                self.eccentricity_1 * math.cos(self.high_1) + self.runout_x_1,
                self.eccentricity_1 * math.sin(self.high_1) + self.runout_y_1, self.spin_1.angle)
            off_x_2, off_y_2 = turned(
                self.eccentricity_2 * math.cos(self.high_2) + self.runout_x_2,
                self.eccentricity_2 * math.sin(self.high_2) + self.runout_y_2, self.spin_2.angle)
            a += (off_x_1 - off_x_2) * n_x + (off_y_1 - off_y_2) * n_y
            a_back += (off_x_1 - off_x_2) * n_x - (off_y_1 - off_y_2) * n_y
            turn_1 = off_x_1 * n_y - off_y_1 * n_x
            turn_2 = off_y_2 * n_x - off_x_2 * n_y
            turn_1_back = -off_x_1 * n_y - off_y_1 * n_x
            turn_2_back = off_x_2 * n_y + off_y_2 * n_x
            da += turn_1 * self.spin_1.speed + turn_2 * self.spin_2.speed
            da_back += turn_1_back * self.spin_1.speed + turn_2_back * self.spin_2.speed
            b += self.profile_slope / self.edge_1
            q = (self.profile_form - self.wear) / (self.edge_1 * self.edge_1)
            c += self.misalignment
            gap += self.added_backlash
        # front flanks
        n = 0.0
        n_s = 0.0
        n_a = 0.0
        n_1 = 0.0
        n_2 = 0.0
        t = 0.0
        t_s = 0.0
        t_a = 0.0
        stored = 0.0
        damped = 0.0
        rubbed = 0.0
        first = -math.floor((span - self.base_1 * self.spin_1.angle) / self.base_pitch)
        for i in range(self.lines):
            tooth = first + i
            p1 = self.base_1 * self.spin_1.angle - tooth * self.base_pitch
            p2 = self.base_2 * self.spin_2.angle + tooth * self.base_pitch
            a_line = a
            k_line = k_face
            z_low = -half
            z_high = half
            pit = 0.0
            pit_s = 0.0
            pit_half = 0.0
            pit_width = 1.0
            if self.imperfect:
                at_1 = tooth - self.teeth_1 * math.floor(tooth / self.teeth_1)
                at_2 = tooth - self.teeth_2 * math.floor(tooth / self.teeth_2)
                hit_1 = hit(tooth, self.damaged_1, self.teeth_1)
                hit_2 = hit(tooth, self.damaged_2, self.teeth_2)
                wave_1 = 2.0 * math.pi * at_1 / self.teeth_1
                wave_2 = 2.0 * math.pi * at_2 / self.teeth_2
                a_line += self.pitch_1 * self.pattern_1(at_1) + self.pitch_2 * self.pattern_2(at_2)
                a_line += waves(
                    wave_1, self.lobes_cos_1, self.lobes_sin_1, self.lobes3_cos_1, self.lobes3_sin_1,
                    self.lobes4_cos_1, self.lobes4_sin_1)
                a_line += waves(
                    wave_2, self.lobes_cos_2, self.lobes_sin_2, self.lobes3_cos_2, self.lobes3_sin_2,
                    self.lobes4_cos_2, self.lobes4_sin_2)
                k_line *= (
                    (1.0 + self.variation_1 * math.cos(wave_1) + self.variation_sin_1 * math.sin(wave_1))
                    * (1.0 + self.variation_2 * math.cos(wave_2) + self.variation_sin_2 * math.sin(wave_2))
                    * (1.0 - self.crack_1 * hit_1) * (1.0 - self.crack_2 * hit_2))
                z_low += self.width * max(self.chip_1 * hit_1, self.chip_2 * hit_2)
                pit = self.spall_1 * hit_1 + self.spall_2 * hit_2
                pit_s = self.spall_place
                pit_half = 0.5 * self.spall_length * max(hit_1, hit_2)
                pit_width = 0.5 * self.spall_width
            if self.slices == 0:
                d_n, d_ns, d_na, d_n1, d_n2, d_t, d_ts, d_ta, d_e, d_l, d_r = line(
                    z_low, z_high, p1, p2, slope, a_line, b, c, q, da, db, dc, self.base_1 * self.spin_1.speed,
                    self.base_2 * self.spin_2.speed, self.edge_1, self.square_1, self.cube_1, self.relief_1, start_1,
                    self.edge_2, self.square_2, self.cube_2, self.relief_2, start_2, pit, pit_s, pit_half, 0.0,
                    pit_width, k_line, self.e, c_face, self.D_P, u0, u1, u2, self.mu_s, self.v_s, self.mu_d, self.v_d)
                n += d_n
                n_s += d_ns
                n_a += d_na
                n_1 += d_n1
                n_2 += d_n2
                t += d_t
                t_s += d_ts
                t_a += d_ta
                stored += d_e
                damped += d_l
                rubbed += d_r
            else:
                for j in range(self.slices):
                    z = z_low + (z_high - z_low) * (j + 0.5) / self.slices
                    w = (z_high - z_low) / self.slices
                    d_n, d_ns, d_na, d_n1, d_n2, d_t, d_ts, d_ta, d_e, d_l, d_r = patch(
                        z, p1, p2, slope, a_line, b, c, q, da, db, dc, self.base_1 * self.spin_1.speed,
                        self.base_2 * self.spin_2.speed, self.edge_1, self.square_1, self.cube_1, self.relief_1,
                        start_1, self.edge_2, self.square_2, self.cube_2, self.relief_2, start_2, pit, pit_s,
                        pit_half, 0.0, pit_width, k_line, self.e, c_face, self.D_P, u0, u1, u2, self.mu_s, self.v_s,
                        self.mu_d, self.v_d)
                    n += w * d_n
                    n_s += w * d_ns
                    n_a += w * d_na
                    n_1 += w * d_n1
                    n_2 += w * d_n2
                    t += w * d_t
                    t_s += w * d_ts
                    t_a += w * d_ta
                    stored += w * d_e
                    damped += w * d_l
                    rubbed += w * d_r
        # back flanks: the same seen in a mirror, with the backlash between
        m = 0.0
        m_s = 0.0
        m_a = 0.0
        m_1 = 0.0
        m_2 = 0.0
        f = 0.0
        f_s = 0.0
        f_a = 0.0
        if a_back - gap + abs(b_back) * span + abs(c_back) * half > 0.0:
            behind = self.thickness * s_y
            opening = gap / c_b
            first_back = -math.floor((span + self.base_1 * self.spin_1.angle - behind) / self.base_pitch)
            for i in range(self.lines):
                p1 = behind - self.base_1 * self.spin_1.angle - (first_back + i) * self.base_pitch
                p2 = (first_back + i) * self.base_pitch - behind - self.base_2 * self.spin_2.angle - opening
                d_n, d_ns, d_na, d_n1, d_n2, d_t, d_ts, d_ta, d_e, d_l, d_r = line(
                    -half, half, p1, p2, -slope, a_back - gap, b_back, c_back, 0.0, da_back, db_back,
                    dc_back, -self.base_1 * self.spin_1.speed, -self.base_2 * self.spin_2.speed, self.edge_1,
                    self.square_1, self.cube_1, self.relief_1, start_1, self.edge_2, self.square_2, self.cube_2,
                    self.relief_2, start_2, 0.0, 0.0, 0.0, 0.0, 1.0, k_face, self.e, c_face, self.D_P, u0_back,
                    u1_back, u2_back, self.mu_s, self.v_s, self.mu_d, self.v_d)
                m += d_n
                m_s += d_ns
                m_a += d_na
                m_1 += d_n1
                m_2 += d_n2
                f += d_t
                f_s += d_ts
                f_a += d_ta
                stored += d_e
                damped += d_l
                rubbed += d_r
        self.force = n
        self.back_force = m
        self.friction = t + f
        self.energy = stored
        self.contact_loss = damped
        self.friction_loss = rubbed
        # directions: normal (n_x, ±n_y, ∓n_z), line of action (s_x, ±s_y), friction (±s_y, −s_x)
        self.force_x = (n + m) * n_x + (t - f) * s_y
        self.force_y = (n - m) * n_y - (t + f) * s_x
        self.force_z = -(n - m) * n_z
        self.moment_x = (n_a - m_a) * n_y + (n_s + m_s) * s_y * n_z - (t_a + f_a) * s_x
        about_y = -(n_a + m_a) * n_x - (n_s - m_s) * s_x * n_z - (t_a - f_a) * s_y
        self.moment_y_1 = about_y - r_1 * (n - m) * n_z
        self.moment_y_2 = -about_y - r_2 * (n - m) * n_z
        self.x_1.force = -self.force_x
        self.y_1.force = -self.force_y
        self.z_1.force = -self.force_z
        self.x_2.force = self.force_x
        self.y_2.force = self.force_y
        self.z_2.force = self.force_z
        self.tilt_x_1.torque = self.moment_x
        self.tilt_x_2.torque = -self.moment_x
        self.tilt_y_1.torque = self.moment_y_1
        self.tilt_y_2.torque = self.moment_y_2
        self.spin_1.torque = (
            -self.base_1 * ((n - m) * c_b - n_1 + m_1) - n * turn_1 - m * turn_1_back
            + (t + f) * r_1 * s_x + t_s + f_s)
        self.spin_2.torque = (
            -self.base_2 * ((n - m) * c_b - n_2 + m_2) - n * turn_2 - m * turn_2_back
            + (t + f) * r_2 * s_x - t_s - f_s)
