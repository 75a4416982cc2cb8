"""Parts that move along a line: mass, spring, damper, sources.

Sign convention: a flange's ``force`` is what the part exerts on the flange, positive in the positive direction.
"""

from __future__ import annotations

from multibody.component import Component
from multibody.declare import Energy, Input, Option, Output, Parameter, Power, Translation

__all__ = ["Damper", "ForceSource", "Mass", "Spring"]


class Mass(Component):
    """A body that slides along a line.

    m·a = Σ forces on the flange.  ``free=False`` holds it where it starts and takes its two states away.
    """

    m = Parameter(1.0, "kg", "mass", min=0.0)
    free = Option(True, "False holds the body at its start position")
    flange = Translation("where forces act", inertia="m")


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


class ForceSource(Component):
    """A force on a flange, given by a signal."""

    force = Input("N", "force on the flange")
    flange = Translation("where it acts")
    power = Power(kind="supply", meaning="power brought in")

    def equations(self):
        self.flange.force = self.force
        self.power = self.force * self.flange.velocity
