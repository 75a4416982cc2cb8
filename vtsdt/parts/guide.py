"""Sliding shoes on guide rails: contact on three flanges, Coulomb friction, rail profiles over height.

González et al. 2020, Eqs. 3 and 4 and Fig. 3.
"""

from __future__ import annotations

import math

from multibody.declare.component import Component
from multibody.declare.declarations import Energy, Frame, Input, Option, Output, Parameter, Power, Table

__all__ = ["GuidingSystem", "face", "face_power", "shoe", "shoe_power"]


def face(depth, rate, K, C, ramp):
    """Return the normal force of one flange: spring and damper in contact, never pulling."""
    if depth > 0.0:
        share = min(depth / ramp, 1.0)
        force = max(K * depth + C * share * share * (3.0 - 2.0 * share) * rate, 0.0)
    else:
        force = 0.0
    return force


def shoe(side, x, y, v_x, v_y, v_z, delta_x, slope_x, delta_y, slope_y, K, C, L_g, ramp, mu, v_s):
    """Return the force of a rail on its shoe (x, y, z) and the sum of the normal forces of its flanges.

    ``side`` is +1 for a rail on the side of positive x.  The normal forces stay horizontal on a rail that is
    not straight.
    """
    rate_y = v_y - slope_y * v_z
    n_1 = face(side * x + delta_x - L_g, side * v_x + slope_x * v_z, K, C, ramp)
    n_2 = face(y - delta_y - L_g, rate_y, K, C, ramp)
    n_3 = face(delta_y - y - L_g, -rate_y, K, C, ramp)
    normal = n_1 + n_2 + n_3
    return -side * n_1, n_3 - n_2, -mu * normal * math.tanh(v_z / v_s), normal


def face_power(depth, rate, K, C, ramp):
    """Return energy and heat of one flange."""
    s = max(depth, 0.0)
    return 0.5 * K * s * s, (face(depth, rate, K, C, ramp) - K * s) * rate


def shoe_power(side, x, y, v_x, v_y, v_z, delta_x, slope_x, delta_y, slope_y, K, C, L_g, ramp, f_x, f_y):
    """Return energy and heat of a shoe's contacts, and the work that a rail that is not straight does."""
    rate_y = v_y - slope_y * v_z
    e_1, h_1 = face_power(side * x + delta_x - L_g, side * v_x + slope_x * v_z, K, C, ramp)
    e_2, h_2 = face_power(y - delta_y - L_g, rate_y, K, C, ramp)
    e_3, h_3 = face_power(delta_y - y - L_g, -rate_y, K, C, ramp)
    return e_1 + e_2 + e_3, h_1 + h_2 + h_3, (f_y * slope_y - side * f_x * slope_x) * v_z


class GuidingSystem(Component):
    """Two guide rails and the four sliding shoes that hold a body between them.

    Each shoe grips its rail on three flanges: the tip, which keeps the body from moving towards that rail, and
    the two sides, which hold it along y.  A flange that is pressed in by s carries
    F_N = K s + C r(s) ds/dt, never negative, with r rising from 0 to 1 over the first ``ramp`` of s as
    3q² - 2q³; the shoe rubs with mu F_N tanh(v_z/v_s) against its travel (Eqs. 3 and 4).

    A profile is the rail's deviation over height: delta_x towards the body, delta_y along y.  Without lateral
    freedom (``lateral=False``) nothing presses on the rails, and the friction is a signal: the reduced form.
    """

    lateral = Option(True, "True: shoes on rails; False: friction comes as a signal")
    left_curved = Option(False, "True: the left rail has a profile in x")
    right_curved = Option(True, "True: the right rail has a profile in x")
    y_curved = Option(False, "True: both rails have a profile in y")

    stiffness = Parameter(None, "N/m", "contact stiffness K of a flange", min=0.0, when="lateral")
    damping = Parameter(0.0, "N*s/m", "contact damping C of a flange", min=0.0, when="lateral")
    clearance = Parameter(0.0, "m", "clearance L_g of a flange", min=0.0, when="lateral")
    mu = Parameter(0.0, "", "friction coefficient", min=0.0, when="lateral")
    v_s = Parameter(0.01, "m/s", "speed below which friction fades", min=1e-9, when="lateral")
    ramp = Parameter(5e-5, "m", "depth over which the damping sets in", min=1e-12, when="lateral")
    half_gauge = Parameter(None, "m", "x of a shoe in the middle of its play", min=0.0, when="lateral")

    left_x = Table("m", "m", "left rail towards the body over height", "cubic", when="left_curved")
    right_x = Table("m", "m", "right rail towards the body over height", "cubic", when="right_curved")
    left_y = Table("m", "m", "left rail along y over height", "cubic", when="y_curved")
    right_y = Table("m", "m", "right rail along y over height", "cubic", when="y_curved")
    left_deviation = Input("m", "added to the left rail's profile in x", default=0.0, when="lateral")
    right_deviation = Input("m", "added to the right rail's profile in x", default=0.0, when="lateral")
    given_friction = Input("N", "friction force on the body, upwards", when="not lateral")

    left_low = Frame("lower left shoe", when="lateral")
    left_high = Frame("upper left shoe", when="lateral")
    right_low = Frame("lower right shoe", when="lateral")
    right_high = Frame("upper right shoe", when="lateral")
    body = Frame("where the given friction acts", when="not lateral")

    friction = Output("N", "sum of the friction forces on the body, upwards")
    normal = Output("N", "sum of the normal forces of all flanges", when="lateral")
    energy = Energy(when="lateral")
    friction_loss = Power(kind="loss", meaning="power lost to friction")
    contact_loss = Power(kind="loss", meaning="power lost to contact damping", when="lateral")
    rail_work = Power(kind="supply", meaning="work of rails that are not straight", when="lateral")

    def equations(self):
        if self.lateral:
            l1 = self.left_deviation
            l2 = self.left_deviation
            r1 = self.right_deviation
            r2 = self.right_deviation
            if self.left_curved:
                l1 += self.left_x(self.left_low.pz)
                l2 += self.left_x(self.left_high.pz)
                l1_slope = self.left_x.slope(self.left_low.pz)
                l2_slope = self.left_x.slope(self.left_high.pz)
            else:
                l1_slope = 0.0
                l2_slope = 0.0
            if self.right_curved:
                r1 += self.right_x(self.right_low.pz)
                r2 += self.right_x(self.right_high.pz)
                r1_slope = self.right_x.slope(self.right_low.pz)
                r2_slope = self.right_x.slope(self.right_high.pz)
            else:
                r1_slope = 0.0
                r2_slope = 0.0
            if self.y_curved:
                l1_y = self.left_y(self.left_low.pz)
                l2_y = self.left_y(self.left_high.pz)
                r1_y = self.right_y(self.right_low.pz)
                r2_y = self.right_y(self.right_high.pz)
                l1_y_slope = self.left_y.slope(self.left_low.pz)
                l2_y_slope = self.left_y.slope(self.left_high.pz)
                r1_y_slope = self.right_y.slope(self.right_low.pz)
                r2_y_slope = self.right_y.slope(self.right_high.pz)
            else:
                l1_y = 0.0
                l2_y = 0.0
                r1_y = 0.0
                r2_y = 0.0
                l1_y_slope = 0.0
                l2_y_slope = 0.0
                r1_y_slope = 0.0
                r2_y_slope = 0.0
            self.left_low.fx, self.left_low.fy, self.left_low.fz, n_1 = shoe(
                -1.0,
                self.left_low.px + self.half_gauge,
                self.left_low.py,
                self.left_low.vx,
                self.left_low.vy,
                self.left_low.vz,
                l1,
                l1_slope,
                l1_y,
                l1_y_slope,
                self.stiffness,
                self.damping,
                self.clearance,
                self.ramp,
                self.mu,
                self.v_s,
            )
            e_1, h_1, w_1 = shoe_power(
                -1.0,
                self.left_low.px + self.half_gauge,
                self.left_low.py,
                self.left_low.vx,
                self.left_low.vy,
                self.left_low.vz,
                l1,
                l1_slope,
                l1_y,
                l1_y_slope,
                self.stiffness,
                self.damping,
                self.clearance,
                self.ramp,
                self.left_low.fx,
                self.left_low.fy,
            )
            self.left_high.fx, self.left_high.fy, self.left_high.fz, n_2 = shoe(
                -1.0,
                self.left_high.px + self.half_gauge,
                self.left_high.py,
                self.left_high.vx,
                self.left_high.vy,
                self.left_high.vz,
                l2,
                l2_slope,
                l2_y,
                l2_y_slope,
                self.stiffness,
                self.damping,
                self.clearance,
                self.ramp,
                self.mu,
                self.v_s,
            )
            e_2, h_2, w_2 = shoe_power(
                -1.0,
                self.left_high.px + self.half_gauge,
                self.left_high.py,
                self.left_high.vx,
                self.left_high.vy,
                self.left_high.vz,
                l2,
                l2_slope,
                l2_y,
                l2_y_slope,
                self.stiffness,
                self.damping,
                self.clearance,
                self.ramp,
                self.left_high.fx,
                self.left_high.fy,
            )
            self.right_low.fx, self.right_low.fy, self.right_low.fz, n_3 = shoe(
                1.0,
                self.right_low.px - self.half_gauge,
                self.right_low.py,
                self.right_low.vx,
                self.right_low.vy,
                self.right_low.vz,
                r1,
                r1_slope,
                r1_y,
                r1_y_slope,
                self.stiffness,
                self.damping,
                self.clearance,
                self.ramp,
                self.mu,
                self.v_s,
            )
            e_3, h_3, w_3 = shoe_power(
                1.0,
                self.right_low.px - self.half_gauge,
                self.right_low.py,
                self.right_low.vx,
                self.right_low.vy,
                self.right_low.vz,
                r1,
                r1_slope,
                r1_y,
                r1_y_slope,
                self.stiffness,
                self.damping,
                self.clearance,
                self.ramp,
                self.right_low.fx,
                self.right_low.fy,
            )
            self.right_high.fx, self.right_high.fy, self.right_high.fz, n_4 = shoe(
                1.0,
                self.right_high.px - self.half_gauge,
                self.right_high.py,
                self.right_high.vx,
                self.right_high.vy,
                self.right_high.vz,
                r2,
                r2_slope,
                r2_y,
                r2_y_slope,
                self.stiffness,
                self.damping,
                self.clearance,
                self.ramp,
                self.mu,
                self.v_s,
            )
            e_4, h_4, w_4 = shoe_power(
                1.0,
                self.right_high.px - self.half_gauge,
                self.right_high.py,
                self.right_high.vx,
                self.right_high.vy,
                self.right_high.vz,
                r2,
                r2_slope,
                r2_y,
                r2_y_slope,
                self.stiffness,
                self.damping,
                self.clearance,
                self.ramp,
                self.right_high.fx,
                self.right_high.fy,
            )
            self.friction = self.left_low.fz + self.left_high.fz + self.right_low.fz + self.right_high.fz
            self.normal = n_1 + n_2 + n_3 + n_4
            self.energy = e_1 + e_2 + e_3 + e_4
            self.contact_loss = h_1 + h_2 + h_3 + h_4
            self.rail_work = w_1 + w_2 + w_3 + w_4
            self.friction_loss = -(
                self.left_low.fz * self.left_low.vz
                + self.left_high.fz * self.left_high.vz
                + self.right_low.fz * self.right_low.vz
                + self.right_high.fz * self.right_high.vz
            )
        else:
            self.friction = self.given_friction
            self.body.fz = self.given_friction
            self.friction_loss = -self.given_friction * self.body.vz
