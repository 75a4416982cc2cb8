"""Parts that turn about an axis: inertias, springs, dampers, stops, play, pendulum, and sources of torque and motion.

Sign convention: a flange's ``torque`` is what the part exerts on the flange, positive in the positive
direction. A part between ``a`` and ``b`` has a ``twist_torque`` that is positive when b is turned ahead of a.
"""

from __future__ import annotations

import math

from multibody.declare.component import Component
from multibody.declare.declarations import Energy, Input, Option, Output, Parameter, Power, Rotation, State
from multibody.library.laws import clearance_contact, contact

__all__ = [
    "AngleSource",
    "Inertia",
    "Pendulum",
    "RotaryBacklash",
    "RotaryEndStop",
    "SpeedSource",
    "TorqueSource",
    "TorsionDamper",
    "TorsionSpring",
    "UnbalancedWeight",
]


class Inertia(Component):
    """A body that turns about an axis.

    J·α = Σ torques on the flange.  ``free=False`` holds it at its start angle and removes its two states.
    """

    J = Parameter(1.0, "kg*m**2", "moment of inertia about the axis", min=0.0)
    free = Option(True, "False holds the body at its start angle")
    flange = Rotation("where torques act", inertia="J")


class Pendulum(Inertia):
    """A body that hangs on a horizontal axis; angle 0 is straight down.

    J·α = Σ torques on the flange − m·g·arm·sin(angle), with J about the axis.
    """

    m = Parameter(None, "kg", "mass", min=0.0)
    arm = Parameter(None, "m", "distance of the centre of mass from the axis", min=0.0)
    g = Parameter(9.80665, "m/s**2", "acceleration of free fall")
    energy = Energy(meaning="potential energy, zero at the lowest point")

    def equations(self):
        moment = self.m * self.g * self.arm
        self.flange.torque = -moment * math.sin(self.flange.angle)
        self.energy = moment * (1.0 - math.cos(self.flange.angle))


class UnbalancedWeight(Component):
    """The weight of a load on an arm whose inertia is elsewhere (unbalance of a shaft, an arm on a gear).

    torque on the flange = −m·g·arm·sin(angle + phase)
    """

    m = Parameter(None, "kg", "mass whose weight acts", min=0.0)
    arm = Parameter(None, "m", "distance from the axis", min=0.0)
    phase = Parameter(0.0, "rad", "angle of the arm from straight down when the flange is at zero")
    g = Parameter(9.80665, "m/s**2", "acceleration of free fall")
    flange = Rotation("where it acts")
    energy = Energy(meaning="potential energy, zero at the lowest point")

    def equations(self):
        moment = self.m * self.g * self.arm
        self.flange.torque = -moment * math.sin(self.flange.angle + self.phase)
        self.energy = moment * (1.0 - math.cos(self.flange.angle + self.phase))


class TorsionSpring(Component):
    """A linear torsion spring between two flanges.

    twist_torque = stiffness · (angle of b − angle of a − angle)
    """

    stiffness = Parameter(None, "N*m/rad", "torque per angle", min=0.0)
    angle = Parameter(0.0, "rad", "angle from a to b without torque")
    a = Rotation("first end")
    b = Rotation("second end")
    twist_torque = Output("N*m", "positive when b is turned ahead of a")
    energy = Energy()

    def equations(self):
        twist = self.b.angle - self.a.angle - self.angle
        self.twist_torque = self.stiffness * twist
        self.a.torque = self.twist_torque
        self.b.torque = -self.twist_torque
        self.energy = 0.5 * self.stiffness * twist**2


class TorsionDamper(Component):
    """A linear torsion damper between two flanges.

    twist_torque = damping · (speed of b − speed of a)
    """

    damping = Parameter(None, "N*m*s/rad", "torque per speed", min=0.0)
    a = Rotation("first end")
    b = Rotation("second end")
    twist_torque = Output("N*m", "positive when b turns faster than a")
    loss = Power(kind="loss")

    def equations(self):
        rate = self.b.speed - self.a.speed
        self.twist_torque = self.damping * rate
        self.a.torque = self.twist_torque
        self.b.torque = -self.twist_torque
        self.loss = self.damping * rate**2


class RotaryEndStop(Component):
    """A stop that limits the angle from a to b; see `EndStop` for its law."""

    stiffness = Parameter(None, "N*m/rad", "stiffness of the contact", min=0.0)
    damping = Parameter(0.0, "N*m*s/rad", "damping of the contact", min=0.0)
    limit = Parameter(0.0, "rad", "angle from a to b at which contact begins")
    side = Option("upper", "which way the stop limits the angle", choices=("upper", "lower"))
    a = Rotation("first side, usually the ground")
    b = Rotation("second side")
    torque = Output("N*m", "contact torque, never negative")
    energy = Energy()
    loss = Power(kind="loss")

    def equations(self):
        way = 1.0 if self.side == "upper" else -1.0
        depth = way * (self.b.angle - self.a.angle - self.limit)
        rate = way * (self.b.speed - self.a.speed)
        self.torque = contact(depth, rate, self.stiffness, self.damping)
        self.a.torque = way * self.torque
        self.b.torque = -way * self.torque
        touching = max(depth, 0.0)
        self.energy = 0.5 * self.stiffness * touching**2
        self.loss = (self.torque - self.stiffness * touching) * rate


class RotaryBacklash(Component):
    """Play between two flanges (gear teeth, a coupling); see `Backlash` for its law."""

    gap = Parameter(None, "rad", "whole width of the play", min=0.0)
    stiffness = Parameter(None, "N*m/rad", "stiffness of the contact", min=0.0)
    damping = Parameter(0.0, "N*m*s/rad", "damping of the contact", min=0.0)
    a = Rotation("first side")
    b = Rotation("second side")
    twist_torque = Output("N*m", "positive when b is turned ahead of a")
    relative_speed = Output("rad/s", "rate of b relative to a")
    energy = Energy()
    loss = Power(kind="loss")

    features = {"gap": "relative_speed"}  # noqa: RUF012

    def equations(self):
        x = self.b.angle - self.a.angle
        self.relative_speed = self.b.speed - self.a.speed
        self.twist_torque = clearance_contact(x, self.relative_speed, self.gap, self.stiffness, self.damping)
        self.a.torque = self.twist_torque
        self.b.torque = -self.twist_torque
        depth = max(abs(x) - 0.5 * self.gap, 0.0)
        elastic = self.stiffness * depth * math.copysign(1.0, x)
        self.energy = 0.5 * self.stiffness * depth**2
        self.loss = (self.twist_torque - elastic) * self.relative_speed


class TorqueSource(Component):
    """A torque on a flange, given by a signal."""

    torque = Input("N*m", "torque on the flange")
    flange = Rotation("where it acts")
    power = Power(kind="supply", meaning="power brought in")

    def equations(self):
        self.flange.torque = self.torque
        self.power = self.torque * self.flange.speed


class AngleSource(Component):
    """A flange whose motion is given by signals, whatever torque it takes; see `PositionSource`."""

    angle = Input("rad", "angle of the flange")
    speed = Input("rad/s", "its rate")
    acceleration = Input("rad/s**2", "the rate of that")
    flange = Rotation("what is turned", prescribed=True)
    torque = Output("N*m", "torque that the motion takes")
    power = Power(kind="supply", meaning="power brought in")

    def equations(self):
        self.flange.angle = self.angle
        self.flange.speed = self.speed
        self.flange.acceleration = self.acceleration
        self.torque = self.flange.reaction
        self.power = self.flange.reaction * self.flange.speed


class SpeedSource(Component):
    """A flange that follows a speed signal with a short lag, at any torque; see `VelocitySource`."""

    reference = Input("rad/s", "speed to follow")
    time_constant = Parameter(1e-3, "s", "lag with which it follows", min=1e-9)
    angle = State("rad", "angle of the flange")
    speed = State("rad/s", "speed of the flange")
    flange = Rotation("what is turned", prescribed=True)
    torque = Output("N*m", "torque that the motion takes")
    power = Power(kind="supply", meaning="power brought in")

    def equations(self):
        rate = (self.reference - self.speed) / self.time_constant
        self.der.angle = self.speed
        self.der.speed = rate
        self.flange.angle = self.angle
        self.flange.speed = self.speed
        self.flange.acceleration = rate
        self.torque = self.flange.reaction
        self.power = self.flange.reaction * self.speed
