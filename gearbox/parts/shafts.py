"""A shaft with its gear as one rigid body of six degrees of freedom about an axis on which it spins."""

from __future__ import annotations

import math

from multibody.declare.component import Component
from multibody.declare.declarations import Option, Output, Parameter, Power, Rotation, Translation

__all__ = ["GearShaft"]


class GearShaft(Component):
    """A gear fixed to its shaft: small displacements of its centre of mass, small tilts, and the turning about z.

    The body is a rotor whose axis stays near z, so that x, y, z and both tilts are small and enter linearly, while the
    spin angle grows without limit; the gyroscopic moments −J·ω·φ̇_y and J·ω·φ̇_x join the tilts.  Each motion can be
    locked (``x_free=False``, …), and its states leave the model: with the spin alone it is a torsional model.

    An unbalance U turns with the shaft and pulls with U·ω² (its inertia forces by angular acceleration, U·α, are left
    out: next to the centrifugal force they count only while the shaft is hardly turning).
    """

    mass = Parameter(None, "kg", "mass of gear and shaft", min=1e-9)
    J = Parameter(None, "kg*m**2", "moment of inertia about the axis", min=1e-12)
    J_t = Parameter(None, "kg*m**2", "moment of inertia about a diameter, through the centre of mass", min=1e-12)
    unbalance = Parameter(0.0, "kg*m", "mass times distance from the axis")
    unbalance_angle = Parameter(0.0, "rad", "where the unbalance is, from the x axis at angle 0")
    unbalance_x = Parameter(0.0, "kg*m", "the same by its parts: along x at angle 0, added")
    unbalance_y = Parameter(0.0, "kg*m", "along y at angle 0, added")
    drag = Parameter(0.0, "N*m*s/rad", "viscous resistance of bearings, seals and oil against turning", min=0.0)

    x_free = Option(True, "False takes away the motion across, in the plane of the axes")
    y_free = Option(True, "False takes away the motion across, normal to the plane of the axes")
    z_free = Option(True, "False takes away the motion along the axis")
    tilt_x_free = Option(True, "False takes away the tilt about x")
    tilt_y_free = Option(True, "False takes away the tilt about y")
    spin_free = Option(True, "False holds the shaft at its start angle")

    x = Translation("across, in the plane of the axes", inertia="mass")
    y = Translation("across, normal to the plane of the axes", inertia="mass")
    z = Translation("along the axis", inertia="mass")
    tilt_x = Rotation("tilt about x", inertia="J_t")
    tilt_y = Rotation("tilt about y", inertia="J_t")
    spin = Rotation("turning about the axis", inertia="J")

    loss = Power(kind="loss", meaning="power lost to drag")
    unbalance_force = Output("N", "centrifugal force of the unbalance")
    unbalance_power = Power(kind="supply", meaning="work of the turning unbalance on the motion across")

    def equations(self):
        u_x = self.unbalance * math.cos(self.unbalance_angle) + self.unbalance_x
        u_y = self.unbalance * math.sin(self.unbalance_angle) + self.unbalance_y
        faster = self.spin.speed * self.spin.speed
        self.x.force = faster * (u_x * math.cos(self.spin.angle) - u_y * math.sin(self.spin.angle))
        self.y.force = faster * (u_x * math.sin(self.spin.angle) + u_y * math.cos(self.spin.angle))
        self.unbalance_force = math.hypot(self.x.force, self.y.force)
        self.unbalance_power = self.x.force * self.x.velocity + self.y.force * self.y.velocity
        self.tilt_x.torque = -self.J * self.spin.speed * self.tilt_y.speed
        self.tilt_y.torque = self.J * self.spin.speed * self.tilt_x.speed
        self.spin.torque = -self.drag * self.spin.speed
        self.loss = self.drag * self.spin.speed * self.spin.speed
