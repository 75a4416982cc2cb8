"""Rolling bearings as bushings between a shaft and its seat, with clearance and with defects of race or element."""

from __future__ import annotations

import math

from gearbox.parts.tooth_contact import bell
from multibody.declare.component import Component
from multibody.declare.declarations import Energy, Input, Option, Output, Parameter, Power, Rotation, Translation

__all__ = ["BearingBushing", "SeatLoad", "pulse"]


def share_beyond(x, y, clearance):
    """Return which share of a radial displacement lies beyond a clearance: 1 without clearance, 0 within it."""
    radius = math.sqrt(x * x + y * y)
    return 1.0 - clearance / max(radius, 1e-18) if radius >= clearance else 0.0


def pulse(phase, half):
    """Return a bump of height 1 at every full turn of ``phase``, ``half`` (rad) wide to each side, and its slope."""
    height, slope = bell(phase - 2.0 * math.pi * math.floor(phase / (2.0 * math.pi) + 0.5), 0.0, half)
    return height, slope


class BearingBushing(Component):
    """Springs and dampers along x, y and z between a shaft, ``place`` from its centre of mass, and a bearing seat.

    Within the radial clearance the bearing carries nothing; without clearance the bushing is linear.

    With ``defects=True`` a race or a rolling element can have a pit: whenever it is rolled over, the shaft gives way by
    its depth, along the direction in which the pit then lies.  A pit of the outer ring stays where it is and is passed
    by every element, elements·(1 − ratio)/2 times a turn of the shaft; one of the inner ring turns with the shaft and
    meets elements·(1 + ratio)/2; one of an element goes round with the cage, (1 − ratio)/2 turns, and touches a race
    (1 − ratio²)/ratio times.  There is no slip, and the whole circumference carries load.
    """

    defects = Option(False, "True: pits of rings and elements can be given")
    place = Parameter(None, "m", "distance from the shaft's centre of mass along z")
    stiffness_radial = Parameter(None, "N/m", "stiffness along x and y", min=0.0)
    stiffness_axial = Parameter(0.0, "N/m", "stiffness along z; zero for a floating bearing", min=0.0)
    damping_radial = Parameter(0.0, "N*s/m", "damping along x and y", min=0.0)
    damping_axial = Parameter(0.0, "N*s/m", "damping along z", min=0.0)
    clearance = Parameter(0.0, "m", "radial clearance: play from the middle to one side", min=0.0)
    elements = Parameter(9.0, "", "number of rolling elements", min=1.0, when="defects")
    ratio = Parameter(
        0.2,
        "",
        "diameter of the elements over pitch diameter, times cos(contact angle)",
        min=1e-3,
        max=0.9,
        when="defects",
    )
    outer_pit = Parameter(0.0, "m", "depth of a pit in the outer ring", when="defects")
    inner_pit = Parameter(0.0, "m", "depth of a pit in the inner ring", when="defects")
    element_pit = Parameter(0.0, "m", "depth of a pit in a rolling element", when="defects")
    outer_angle = Parameter(0.0, "rad", "where the pit of the outer ring is, from the x axis", when="defects")
    pit_width = Parameter(0.6, "rad", "half width of a pit, of the 2π between two passes", min=1e-3, when="defects")

    x = Translation("shaft across, in the plane of the axes")
    y = Translation("shaft across, normal to it")
    z = Translation("shaft along its axis")
    tilt_x = Rotation("tilt of the shaft about x")
    tilt_y = Rotation("tilt of the shaft about y")
    spin = Rotation("turning of the shaft", when="defects")
    seat_x = Translation("seat along x")
    seat_y = Translation("seat along y")
    seat_z = Translation("seat along z")

    force_x = Output("N", "force on the seat along x")
    force_y = Output("N", "force on the seat along y")
    force_z = Output("N", "force on the seat along z")
    energy = Energy()
    loss = Power(kind="loss")
    pit_work = Power(kind="supply", meaning="work of pits that are rolled over", when="defects")

    def equations(self):
        dx = self.x.position + self.place * self.tilt_y.angle - self.seat_x.position
        dy = self.y.position - self.place * self.tilt_x.angle - self.seat_y.position
        dz = self.z.position - self.seat_z.position
        vx = self.x.velocity + self.place * self.tilt_y.speed - self.seat_x.velocity
        vy = self.y.velocity - self.place * self.tilt_x.speed - self.seat_y.velocity
        vz = self.z.velocity - self.seat_z.velocity
        if self.defects:
            outer_rate = self.elements * 0.5 * (1.0 - self.ratio)
            inner_rate = self.elements * 0.5 * (1.0 + self.ratio)
            element_rate = (1.0 - self.ratio * self.ratio) / self.ratio
            cage = 0.5 * (1.0 - self.ratio)
            p_o, s_o = pulse(outer_rate * self.spin.angle, self.pit_width)
            p_i, s_i = pulse(inner_rate * self.spin.angle, self.pit_width)
            p_e, s_e = pulse(element_rate * self.spin.angle, self.pit_width)
            c_i = math.cos(self.spin.angle)
            d_i = math.sin(self.spin.angle)
            c_e = math.cos(cage * self.spin.angle)
            d_e = math.sin(cage * self.spin.angle)
            away_x = (
                self.outer_pit * p_o * math.cos(self.outer_angle)
                + self.inner_pit * p_i * c_i
                + self.element_pit * p_e * c_e
            )
            away_y = (
                self.outer_pit * p_o * math.sin(self.outer_angle)
                + self.inner_pit * p_i * d_i
                + self.element_pit * p_e * d_e
            )
            rate_x = self.spin.speed * (
                self.outer_pit * s_o * outer_rate * math.cos(self.outer_angle)
                + self.inner_pit * (s_i * inner_rate * c_i - p_i * d_i)
                + self.element_pit * (s_e * element_rate * c_e - p_e * d_e * cage)
            )
            rate_y = self.spin.speed * (
                self.outer_pit * s_o * outer_rate * math.sin(self.outer_angle)
                + self.inner_pit * (s_i * inner_rate * d_i + p_i * c_i)
                + self.element_pit * (s_e * element_rate * d_e + p_e * c_e * cage)
            )
            dx -= away_x
            dy -= away_y
            vx -= rate_x
            vy -= rate_y
            self.pit_work = -self.force_x * rate_x - self.force_y * rate_y
        share = share_beyond(dx, dy, self.clearance)
        self.force_x = share * (self.stiffness_radial * dx + self.damping_radial * vx)
        self.force_y = share * (self.stiffness_radial * dy + self.damping_radial * vy)
        self.force_z = self.stiffness_axial * dz + self.damping_axial * vz
        self.x.force = -self.force_x
        self.y.force = -self.force_y
        self.z.force = -self.force_z
        self.seat_x.force = self.force_x
        self.seat_y.force = self.force_y
        self.seat_z.force = self.force_z
        self.tilt_x.torque = self.place * self.force_y
        self.tilt_y.torque = -self.place * self.force_x
        beyond = share * math.sqrt(dx * dx + dy * dy)
        self.energy = 0.5 * self.stiffness_radial * beyond * beyond + 0.5 * self.stiffness_axial * dz * dz
        self.loss = share * self.damping_radial * (vx * vx + vy * vy) + self.damping_axial * vz * vz


class SeatLoad(Component):
    """What the two bearings of a shaft without lateral motion pass on: the mesh force, by the rule of levers.

    The reduced form of two `BearingBushing`: a shaft that cannot move across carries a force and a moment on its middle
    straight to its seats, at z = low and z = high; the axial force goes to the low one.
    """

    low = Parameter(None, "m", "place of the low bearing along z")
    high = Parameter(None, "m", "place of the high bearing along z")
    force_x = Input("N", "force on the shaft along x")
    force_y = Input("N", "force on the shaft along y")
    force_z = Input("N", "force on the shaft along z")
    moment_x = Input("N*m", "moment on the shaft about x")
    moment_y = Input("N*m", "moment on the shaft about y")
    sign = Parameter(1.0, "", "1: the forces as given, −1: the opposite")
    moment_sign = Parameter(1.0, "", "the same for the moment about x")
    low_x = Translation("low seat along x")
    low_y = Translation("low seat along y")
    low_z = Translation("low seat along z")
    high_x = Translation("high seat along x")
    high_y = Translation("high seat along y")
    high_z = Translation("high seat along z")
    power = Power(kind="supply", meaning="work on the seats, which the rigid shaft does not notice")

    def equations(self):
        span = self.high - self.low
        self.high_x.force = (-self.sign * self.force_x * self.low + self.moment_y) / span
        self.low_x.force = self.sign * self.force_x - self.high_x.force
        self.high_y.force = (-self.sign * self.force_y * self.low - self.moment_sign * self.moment_x) / span
        self.low_y.force = self.sign * self.force_y - self.high_y.force
        self.low_z.force = self.sign * self.force_z
        self.high_z.force = 0.0
        self.power = (
            self.high_x.force * self.high_x.velocity
            + self.low_x.force * self.low_x.velocity
            + self.high_y.force * self.high_y.velocity
            + self.low_y.force * self.low_y.velocity
            + self.low_z.force * self.low_z.velocity
        )
