"""Parts that move along a line: masses, springs, dampers, stops, play, ropes, and sources of force and motion.

Sign convention: a flange's ``force`` is what the part exerts on the flange, positive in the positive
direction. A part between ``a`` and ``b`` has a ``tension`` that is positive when it pulls its ends together.
"""

from __future__ import annotations

import math

from multibody.declare.component import Component
from multibody.declare.declarations import Energy, Input, Option, Output, Parameter, Power, State, Translation
from multibody.library.laws import clearance_contact, contact, tension_only

__all__ = [
    "Backlash",
    "Damper",
    "EndStop",
    "ForceSource",
    "InclinedMass",
    "Mass",
    "PositionSource",
    "RopeSegment",
    "Spring",
    "SpringDamper",
    "VelocitySource",
    "Weight",
    "WoundRope",
]


class Mass(Component):
    """A body that slides along a line.

    m·a = Σ forces on the flange.  ``free=False`` holds it at its start and removes its two states.
    """

    m = Parameter(1.0, "kg", "mass", min=0.0)
    free = Option(True, "False holds the body at its start position")
    flange = Translation("where forces act", inertia="m")


class InclinedMass(Mass):
    """A body on a track that rises by the angle ``incline`` along the positive direction (π/2: straight up).

    m·a = Σ forces on the flange − m·g·sin(incline)
    """

    incline = Parameter(math.pi / 2, "rad", "slope of the positive direction above the horizontal")
    g = Parameter(9.80665, "m/s**2", "acceleration of free fall")
    energy = Energy(meaning="potential energy")

    def equations(self):
        self.flange.force = -self.m * self.g * math.sin(self.incline)
        self.energy = self.m * self.g * math.sin(self.incline) * self.flange.position


class Weight(Component):
    """The weight of a load that has its inertia elsewhere (a counterweight over a pulley, a share of a rope).

    force on the flange = −m·g·sin(incline)
    """

    m = Parameter(None, "kg", "mass whose weight acts", min=0.0)
    incline = Parameter(math.pi / 2, "rad", "slope of the positive direction above the horizontal")
    g = Parameter(9.80665, "m/s**2", "acceleration of free fall")
    flange = Translation("where it acts")
    energy = Energy(meaning="potential energy")

    def equations(self):
        self.flange.force = -self.m * self.g * math.sin(self.incline)
        self.energy = self.m * self.g * math.sin(self.incline) * self.flange.position


class Spring(Component):
    """A linear spring between two flanges.

    tension = stiffness · (position of b − position of a − length)
    """

    stiffness = Parameter(None, "N/m", "force per length", min=0.0)
    length = Parameter(0.0, "m", "distance from a to b without force")
    a = Translation("first end")
    b = Translation("second end")
    tension = Output("N", "positive when stretched")
    energy = Energy()

    def equations(self):
        stretch = self.b.position - self.a.position - self.length
        self.tension = self.stiffness * stretch
        self.a.force = self.tension
        self.b.force = -self.tension
        self.energy = 0.5 * self.stiffness * stretch**2


class Damper(Component):
    """A linear damper between two flanges.

    tension = damping · (velocity of b − velocity of a)
    """

    damping = Parameter(None, "N*s/m", "force per speed", min=0.0)
    a = Translation("first end")
    b = Translation("second end")
    tension = Output("N", "positive when the ends part")
    loss = Power(kind="loss")

    def equations(self):
        rate = self.b.velocity - self.a.velocity
        self.tension = self.damping * rate
        self.a.force = self.tension
        self.b.force = -self.tension
        self.loss = self.damping * rate**2


class SpringDamper(Component):
    """A spring and a damper in parallel (Kelvin-Voigt).

    tension = stiffness · (b − a − length) + damping · (rate of b − rate of a)
    """

    stiffness = Parameter(None, "N/m", "force per length", min=0.0)
    damping = Parameter(0.0, "N*s/m", "force per speed", min=0.0)
    length = Parameter(0.0, "m", "distance from a to b without force")
    a = Translation("first end")
    b = Translation("second end")
    tension = Output("N", "positive when stretched")
    energy = Energy()
    loss = Power(kind="loss")

    def equations(self):
        stretch = self.b.position - self.a.position - self.length
        rate = self.b.velocity - self.a.velocity
        self.tension = self.stiffness * stretch + self.damping * rate
        self.a.force = self.tension
        self.b.force = -self.tension
        self.energy = 0.5 * self.stiffness * stretch**2
        self.loss = self.damping * rate**2


class EndStop(Component):
    """A stop that limits the distance from a to b; free motion until it is reached.

    With ``side="upper"`` it acts where b − a > ``limit``, with ``side="lower"`` where b − a < ``limit``. The
    damping force is limited to the spring force, so that the stop neither pulls when it is left nor jumps
    when it is reached.
    """

    stiffness = Parameter(None, "N/m", "stiffness of the contact", min=0.0)
    damping = Parameter(0.0, "N*s/m", "damping of the contact", min=0.0)
    limit = Parameter(0.0, "m", "distance from a to b at which contact begins")
    side = Option("upper", "which way the stop limits the distance", choices=("upper", "lower"))
    a = Translation("first side, usually the ground")
    b = Translation("second side")
    force = Output("N", "contact force, never negative")
    energy = Energy()
    loss = Power(kind="loss")

    def equations(self):
        way = 1.0 if self.side == "upper" else -1.0
        depth = way * (self.b.position - self.a.position - self.limit)
        rate = way * (self.b.velocity - self.a.velocity)
        self.force = contact(depth, rate, self.stiffness, self.damping)
        self.a.force = way * self.force
        self.b.force = -way * self.force
        touching = max(depth, 0.0)
        self.energy = 0.5 * self.stiffness * touching**2
        self.loss = (self.force - self.stiffness * touching) * rate


class Backlash(Component):
    """Play between two flanges: no force within ``gap``, a damped contact at either end of it.

    Contact begins where |b − a| > gap/2.  The contact is that of `EndStop`.
    """

    gap = Parameter(None, "m", "whole width of the play", min=0.0)
    stiffness = Parameter(None, "N/m", "stiffness of the contact", min=0.0)
    damping = Parameter(0.0, "N*s/m", "damping of the contact", min=0.0)
    a = Translation("first side")
    b = Translation("second side")
    tension = Output("N", "positive where b pulls away from a")
    relative_velocity = Output("m/s", "rate of b relative to a")
    energy = Energy()
    loss = Power(kind="loss")

    features = {"gap": "relative_velocity"}  # noqa: RUF012

    def equations(self):
        x = self.b.position - self.a.position
        self.relative_velocity = self.b.velocity - self.a.velocity
        self.tension = clearance_contact(x, self.relative_velocity, self.gap, self.stiffness, self.damping)
        self.a.force = self.tension
        self.b.force = -self.tension
        depth = max(abs(x) - 0.5 * self.gap, 0.0)
        elastic = self.stiffness * depth * math.copysign(1.0, x)
        self.energy = 0.5 * self.stiffness * depth**2
        self.loss = (self.tension - elastic) * self.relative_velocity


class RopeSegment(Component):
    """A length of rope between two flanges; it pulls and never pushes.

    tension = EA/length · (b − a − length) + damping · rate while it is stretched, otherwise 0. The damping
    force is limited to the elastic force, so that the tension does not jump when the rope tightens.
    """

    EA = Parameter(None, "N", "longitudinal stiffness E·A", min=0.0)
    length = Parameter(None, "m", "free length", min=0.0)
    damping = Parameter(0.0, "N*s/m", "damping of the segment", min=0.0)
    a = Translation("lower end")
    b = Translation("upper end")
    tension = Output("N", "never negative")
    energy = Energy()
    loss = Power(kind="loss")

    def equations(self):
        stiffness = self.EA / self.length
        stretch = self.b.position - self.a.position - self.length
        rate = self.b.velocity - self.a.velocity
        self.tension = tension_only(stretch, rate, stiffness, self.damping)
        self.a.force = self.tension
        self.b.force = -self.tension
        taut = max(stretch, 0.0)
        self.energy = 0.5 * stiffness * taut**2
        self.loss = (self.tension - stiffness * taut) * rate


class WoundRope(RopeSegment):
    """A rope whose free length is a signal, because it is paid out or wound up at one of its ends.

    Rope that leaves the segment takes its strain energy with it; ``power`` accounts for this energy and for the work
    of the tension on the rope that passes.
    """

    length = Input("m", "free length")  # type: ignore[assignment]
    length_rate = Input("m/s", "rate of the free length, positive when rope is paid out")
    power = Power(kind="supply", meaning="power brought in with the rope")

    def equations(self):
        stiffness = self.EA / self.length
        stretch = self.b.position - self.a.position - self.length
        rate = self.b.velocity - self.a.velocity - self.length_rate
        self.tension = tension_only(stretch, rate, stiffness, self.damping)
        self.a.force = self.tension
        self.b.force = -self.tension
        taut = max(stretch, 0.0)
        self.energy = 0.5 * stiffness * taut**2
        self.loss = (self.tension - stiffness * taut) * rate
        self.power = -(self.tension + self.energy / self.length) * self.length_rate


class ForceSource(Component):
    """A force on a flange, given by a signal."""

    force = Input("N", "force on the flange")
    flange = Translation("where it acts")
    power = Power(kind="supply", meaning="power brought in")

    def equations(self):
        self.flange.force = self.force
        self.power = self.force * self.flange.velocity


class PositionSource(Component):
    """A flange whose motion is given by signals, whatever force it takes.

    The three signals have to be consistent: velocity the rate of position, acceleration that of velocity.  The
    motion profiles of the library supply all three.
    """

    position = Input("m", "position of the flange")
    velocity = Input("m/s", "its rate")
    acceleration = Input("m/s**2", "the rate of that")
    flange = Translation("what is moved", prescribed=True)
    force = Output("N", "force that the motion takes")
    power = Power(kind="supply", meaning="power brought in")

    def equations(self):
        self.flange.position = self.position
        self.flange.velocity = self.velocity
        self.flange.acceleration = self.acceleration
        self.force = self.flange.reaction
        self.power = self.flange.reaction * self.flange.velocity


class VelocitySource(Component):
    """A flange that follows a speed signal with a short lag, whatever force it takes.

    rate of speed = (signal − speed) / time_constant. The lag is there because a speed that jumps would take
    an infinite force.
    """

    reference = Input("m/s", "speed to follow")
    time_constant = Parameter(1e-3, "s", "lag with which it follows", min=1e-9)
    position = State("m", "position of the flange")
    speed = State("m/s", "speed of the flange")
    flange = Translation("what is moved", prescribed=True)
    force = Output("N", "force that the motion takes")
    power = Power(kind="supply", meaning="power brought in")

    def equations(self):
        rate = (self.reference - self.speed) / self.time_constant
        self.der.position = self.speed
        self.der.speed = rate
        self.flange.position = self.position
        self.flange.velocity = self.speed
        self.flange.acceleration = rate
        self.force = self.flange.reaction
        self.power = self.flange.reaction * self.speed
