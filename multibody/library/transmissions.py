"""Transmissions: gear, screw, rack, rigid links and a crank, ideal, slipping or with losses in proportion to the power.

The motion of one side is a function of the other's (``coupling``); the machine loses a degree of freedom and
no spring or constraint force is needed. Which side follows is decided when the model is assembled. Giving an
``efficiency`` makes a transmission lossy: the effort that it transmits is then an unknown of an implicit equation,
because it depends on the losses, which depend on it.  A belt, a rope or a friction wheel creeps: of `SlippingRack` and
`SlippingGear` the two sides are independent, and what is transmitted follows from the slip between them.
"""

from __future__ import annotations

import math
from typing import Any

from multibody.declare.component import Component
from multibody.declare.declarations import Option, Output, Parameter, Power, Rotation, Translation, Unknown
from multibody.library.laws import creep_traction, transmission_loss

__all__ = ["Crank", "Gear", "Rack", "RigidLink", "RigidShaft", "Screw", "SlippingGear", "SlippingRack"]


class _Lossy(Component):
    """Base of transmissions with an efficiency: giving one switches the losses on."""

    lossy = Option(False, "whether power is lost; set by giving an efficiency")

    def __init__(self, **given: Any):
        given["lossy"] = given.get("lossy", False) or "efficiency" in given
        super().__init__(**given)


class Gear(_Lossy):
    """A gear stage: angle of a = ratio · angle of b.

    A ratio above 1 makes b slower and stronger; a negative one turns it round. With an ``efficiency``,
    driving b takes 1/efficiency times the ideal torque at a, and being driven by b leaves efficiency times
    the ideal torque.
    """

    ratio = Parameter(None, "", "turns of a for one turn of b")
    efficiency = Parameter(1.0, "", "power out over power in, both ways", min=0.05, max=1.0, when="lossy")
    v_s = Parameter(1e-2, "rad/s", "speed of b below which losses fade", min=1e-12, when="lossy")
    a = Rotation("fast side, where ratio > 1")
    b = Rotation("slow side")
    torque = Output("N*m", "torque that the gear exerts on b")
    transmitted = Unknown("N*m", "torque that the gear exerts on b", when="lossy")
    loss = Power(kind="loss", when="lossy")

    def coupling(self):
        self.b.angle = self.a.angle / self.ratio

    def coupling_inverse(self):
        self.a.angle = self.ratio * self.b.angle

    def equations(self):
        if self.lossy:
            self.zero.transmitted = self.transmitted - self.b.reaction
            lost = transmission_loss(self.transmitted, self.b.speed, self.efficiency, self.v_s)
            self.a.torque = -lost / self.ratio
            self.torque = self.transmitted
            self.loss = lost * self.b.speed
        else:
            self.torque = self.b.reaction


class Screw(_Lossy):
    """A lead screw: position of b = lead · angle of a / 2π.

    With an ``efficiency`` losses follow the power as in `Gear`; self-locking screws are not covered.
    """

    lead = Parameter(None, "m", "travel for one turn")
    efficiency = Parameter(1.0, "", "power out over power in, both ways", min=0.05, max=1.0, when="lossy")
    v_s = Parameter(1e-4, "m/s", "speed of the nut below which losses fade", min=1e-12, when="lossy")
    a = Rotation("screw")
    b = Translation("nut")
    force = Output("N", "force that the screw exerts on b")
    transmitted = Unknown("N", "force that the screw exerts on b", when="lossy")
    loss = Power(kind="loss", when="lossy")

    def coupling(self):
        self.b.position = self.lead / (2.0 * math.pi) * self.a.angle

    def coupling_inverse(self):
        self.a.angle = 2.0 * math.pi / self.lead * self.b.position

    def equations(self):
        if self.lossy:
            self.zero.transmitted = self.transmitted - self.b.reaction
            lost = transmission_loss(self.transmitted, self.b.velocity, self.efficiency, self.v_s)
            self.a.torque = -lost * self.lead / (2.0 * math.pi)
            self.force = self.transmitted
            self.loss = lost * self.b.velocity
        else:
            self.force = self.b.reaction


class Rack(_Lossy):
    """A pinion on a rack, a rope on a drum, a belt on a pulley: position of b = radius · angle of a.

    With an ``efficiency`` losses follow the power as in `Gear`.
    """

    radius = Parameter(None, "m", "travel for one radian")
    efficiency = Parameter(1.0, "", "power out over power in, both ways", min=0.05, max=1.0, when="lossy")
    v_s = Parameter(1e-3, "m/s", "speed of the rack below which losses fade", min=1e-12, when="lossy")
    a = Rotation("pinion, drum or pulley")
    b = Translation("rack, rope or belt")
    force = Output("N", "force that the pinion exerts on b")
    transmitted = Unknown("N", "force that the pinion exerts on b", when="lossy")
    loss = Power(kind="loss", when="lossy")

    def coupling(self):
        self.b.position = self.radius * self.a.angle

    def coupling_inverse(self):
        self.a.angle = self.b.position / self.radius

    def equations(self):
        if self.lossy:
            self.zero.transmitted = self.transmitted - self.b.reaction
            lost = transmission_loss(self.transmitted, self.b.velocity, self.efficiency, self.v_s)
            self.a.torque = -lost * self.radius
            self.force = self.transmitted
            self.loss = lost * self.b.velocity
        else:
            self.force = self.b.reaction


class SlippingGear(Component):
    """A belt drive or a pair of friction wheels that creeps: what it transmits is in proportion to the relative slip.

    torque on b = (speed of a/ratio − speed of b) / (creep · √((speed of a/ratio)² + v_s²)); a gets 1/ratio of it.
    """

    ratio = Parameter(None, "", "turns of a for one turn of b, without slip")
    creep = Parameter(None, "1/(N*m)", "relative slip per torque on b", min=1e-30)
    v_s = Parameter(1e-2, "rad/s", "speed of b below which the slip is in proportion to the torque alone", min=1e-12)
    a = Rotation("driving side")
    b = Rotation("driven side")
    torque = Output("N*m", "torque that is exerted on b")
    slip = Output("rad/s", "speed by which b stays behind")
    loss = Power(kind="loss")

    def equations(self):
        surface = self.a.speed / self.ratio
        self.slip = surface - self.b.speed
        self.torque = creep_traction(self.slip, surface, self.creep, self.v_s)
        self.b.torque = self.torque
        self.a.torque = -self.torque / self.ratio
        self.loss = self.torque * self.slip


class SlippingRack(Component):
    """A rope on a drum, a belt on a pulley or a wheel on a track that creeps: it transmits in proportion to the slip.

    force on b = (radius · speed of a − velocity of b) / (creep · √((radius · speed of a)² + v_s²)).
    """

    radius = Parameter(None, "m", "travel for one radian, without slip")
    creep = Parameter(None, "1/N", "relative slip per force on b", min=1e-30)
    v_s = Parameter(1e-2, "m/s", "speed below which the slip is in proportion to the force alone", min=1e-12)
    a = Rotation("drum, pulley or wheel")
    b = Translation("rope, belt or track")
    force = Output("N", "force that is exerted on b")
    slip = Output("m/s", "speed by which b stays behind")
    loss = Power(kind="loss")

    def equations(self):
        surface = self.radius * self.a.speed
        self.slip = surface - self.b.velocity
        self.force = creep_traction(self.slip, surface, self.creep, self.v_s)
        self.b.force = self.force
        self.a.torque = -self.radius * self.force
        self.loss = self.force * self.slip


class RigidLink(Component):
    """A rigid rod: position of b = position of a + length; ``tension`` is what a sensor in it would read."""

    length = Parameter(0.0, "m", "distance from a to b")
    a = Translation("first end")
    b = Translation("second end")
    tension = Output("N", "positive when the rod pulls its ends together")

    def coupling(self):
        self.b.position = self.a.position + self.length

    def coupling_inverse(self):
        self.a.position = self.b.position - self.length

    def equations(self):
        self.tension = -self.b.reaction


class RigidShaft(Component):
    """A rigid shaft: angle of b = angle of a + offset."""

    offset = Parameter(0.0, "rad", "angle from a to b")
    a = Rotation("first end")
    b = Rotation("second end")
    torque = Output("N*m", "torque that the shaft exerts on b")

    def coupling(self):
        self.b.angle = self.a.angle + self.offset

    def coupling_inverse(self):
        self.a.angle = self.b.angle - self.offset

    def equations(self):
        self.torque = self.b.reaction


class Crank(Component):
    """A slider-crank: b slides on a line through the axis of a.

    position of b = radius·cos(angle) + √(rod² − radius²·sin²(angle)); the crank leads, and the rod has to be
    longer than the radius.
    """

    radius = Parameter(None, "m", "radius of the crank", min=0.0)
    rod = Parameter(None, "m", "length of the connecting rod", min=0.0)
    a = Rotation("crank; angle 0 with the slider farthest out")
    b = Translation("slider, measured from the axis")
    force = Output("N", "force that the rod exerts on b")

    def coupling(self):
        across = self.radius * math.sin(self.a.angle)
        self.b.position = self.radius * math.cos(self.a.angle) + math.sqrt(self.rod**2 - across**2)

    def equations(self):
        self.force = self.b.reaction
