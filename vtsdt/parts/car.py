"""Cabin and counterweight: a rigid body with four guide shoes, a rope hitch, and frames for load and sensors."""

from __future__ import annotations

from multibody.declare.component import Component
from multibody.declare.declarations import Frame, Input, Option, Output, Parameter, Power
from multibody.declare.rigid_body import RigidBody

__all__ = ["Accelerometer", "Car", "Hoist"]


class Car(RigidBody):
    """The body of cabin or counterweight (González et al. 2020, Eqs. 1 and 2); its origin is on the floor."""

    shoe_x = Parameter(None, "m", "shoes at x = ±shoe_x")
    shoe_low = Parameter(None, "m", "height of the lower shoes")
    shoe_high = Parameter(None, "m", "height of the upper shoes")
    hitch = Frame("rope hitch", offset=(None, None, 0.0))
    left_low = Frame("lower left shoe", offset=("-shoe_x", None, "shoe_low"))
    left_high = Frame("upper left shoe", offset=("-shoe_x", None, "shoe_high"))
    right_low = Frame("lower right shoe", offset=("shoe_x", None, "shoe_low"))
    right_high = Frame("upper right shoe", offset=("shoe_x", None, "shoe_high"))
    floor = Frame("where a load stands", offset=(0.0, 0.0, 0.0))
    accelerometer = Frame("accelerometer", offset=(0.0, 0.0, 0.0), angles=(0.0, 0.0, None))


class Accelerometer(Component):
    """A vertical accelerometer on the cabin's floor: sensitive to tilt, with a gain and an offset.

    Its mounting angles are the body's parameters ``accelerometer_roll`` and ``accelerometer_pitch``.
    """

    frame = Frame("where it sits")
    gain = Parameter(1.0, "", "factor; 1 is right")
    offset = Parameter(0.0, "m/s**2", "reading at rest")
    reading = Output("m/s**2", "acceleration along its own axis, without gravity")

    def equations(self):
        specific_force = (
            self.frame.r13 * (self.frame.ax - self.frame.gx)
            + self.frame.r23 * (self.frame.ay - self.frame.gy)
            + self.frame.r33 * (self.frame.az - self.frame.gz)
        )
        self.reading = self.gain * (specific_force + self.frame.gz) + self.offset


class Hoist(Component):
    """A given rope tension on a hitch: what remains of the ropes in a model of the cabin alone.

    The rope runs to a fixed point above the origin of the body's axis; with ``vertical=True`` it pulls straight up.
    """

    vertical = Option(False, "True: the pull has no lateral part")
    height = Parameter(None, "m", "height of the upper end", when="not vertical")
    tension = Input("N", "tension of the rope")
    hitch = Frame("where it pulls")
    power = Power(kind="supply", meaning="power of the rope's pull")

    def equations(self):
        if self.vertical:
            self.hitch.fz = self.tension
        else:
            dx = -self.hitch.px
            dy = -self.hitch.py
            dz = self.height - self.hitch.pz
            per_length = self.tension / (dx * dx + dy * dy + dz * dz) ** 0.5
            self.hitch.fx = per_length * dx
            self.hitch.fy = per_length * dy
            self.hitch.fz = per_length * dz
        self.power = self.hitch.fx * self.hitch.vx + self.hitch.fy * self.hitch.vy + self.hitch.fz * self.hitch.vz
