"""Flanges with a recorded motion, whose output is the force or torque that the motion needs."""

from __future__ import annotations

from multibody.declare.component import Component
from multibody.declare.declarations import Input, Output, Rotation, Translation

__all__ = ["GivenAngle", "GivenPosition"]


class GivenPosition(Component):
    """A flange that moves as recorded.

    ``force`` is what the motion needs beyond all forces in the model: the recorded drive force, or zero.
    """

    position = Input("m", "recorded position")
    velocity = Input("m/s", "its rate")
    acceleration = Input("m/s**2", "the rate of that")
    flange = Translation("what is moved", prescribed=True)
    force = Output("N", "force that the motion needs here")

    def equations(self):
        self.flange.position = self.position
        self.flange.velocity = self.velocity
        self.flange.acceleration = self.acceleration
        self.force = self.flange.reaction


class GivenAngle(Component):
    """A flange that turns as recorded; see `GivenPosition`."""

    angle = Input("rad", "recorded angle")
    speed = Input("rad/s", "its rate")
    acceleration = Input("rad/s**2", "the rate of that")
    flange = Rotation("what is turned", prescribed=True)
    torque = Output("N*m", "torque that the motion needs here")

    def equations(self):
        self.flange.angle = self.angle
        self.flange.speed = self.speed
        self.flange.acceleration = self.acceleration
        self.torque = self.flange.reaction
