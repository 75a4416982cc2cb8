"""Signals generated inside a model: constant, step, ramp, sine, table over time, and motion profiles."""

from __future__ import annotations

import math

from multibody.declare.component import Component
from multibody.declare.declarations import Output, Parameter, Table, Unit
from multibody.library.profiles import jerk_limited, trapezoidal

__all__ = ["Constant", "Ramp", "SCurveProfile", "Sine", "Step", "TableReference", "TrapezoidalProfile"]


class _Source(Component):
    unit = Unit("1", "unit of the signal")
    output = Output("{unit}", "the signal")


class Constant(_Source):
    """A signal that does not change."""

    value = Parameter(None, "{unit}", "its value")

    def equations(self):
        self.output = self.value


class Step(_Source):
    """A signal that jumps by ``height`` at ``start``."""

    offset = Parameter(0.0, "{unit}", "value before the step")
    height = Parameter(1.0, "{unit}", "by how much it jumps")
    start = Parameter(0.0, "s", "when")

    def equations(self):
        self.output = self.offset + (self.height if self.time >= self.start else 0.0)


class Ramp(_Source):
    """A signal that rises by ``height`` within ``duration``, beginning at ``start``."""

    offset = Parameter(0.0, "{unit}", "value before the ramp")
    height = Parameter(1.0, "{unit}", "by how much it rises")
    start = Parameter(0.0, "s", "when it begins")
    duration = Parameter(1.0, "s", "how long it takes", min=1e-12)

    features = {"duration": "time"}  # noqa: RUF012

    def equations(self):
        self.output = self.offset + self.height * min(max((self.time - self.start) / self.duration, 0.0), 1.0)


class Sine(_Source):
    """offset + amplitude · sin(2π · frequency · time + phase)"""

    offset = Parameter(0.0, "{unit}", "mean value")
    amplitude = Parameter(1.0, "{unit}", "amplitude (half of peak to peak)")
    frequency = Parameter(1.0, "Hz", "frequency", min=0.0)
    phase = Parameter(0.0, "rad", "phase at time 0")

    def equations(self):
        angle = 2.0 * math.pi * self.frequency * self.time + self.phase
        self.output = self.offset + self.amplitude * math.sin(angle)


class TableReference(_Source):
    """A signal given by points over time, joined by straight lines, constant beyond them."""

    points = Table("s", "{unit}", "the signal over time")

    features = {"points": "time"}  # noqa: RUF012

    def equations(self):
        self.output = self.points(self.time)


class _Profile(Component):
    position_unit = Unit("rad", "unit of the position: rad or m")
    distance = Parameter(None, "{position_unit}", "length of the move, with its sign")
    v_max = Parameter(None, "{position_unit}/s", "largest speed", min=1e-12)
    a_max = Parameter(None, "{position_unit}/s**2", "largest acceleration", min=1e-12)
    start = Parameter(0.0, "s", "when the move begins")
    offset = Parameter(0.0, "{position_unit}", "position before the move")
    position = Output("{position_unit}", "position of the reference")
    velocity = Output("{position_unit}/s", "its rate")
    acceleration = Output("{position_unit}/s**2", "the rate of that")
    duration = Output("s", "how long the move takes")

    features = {"duration": "time"}  # noqa: RUF012


class TrapezoidalProfile(_Profile):
    """A move from rest to rest with constant acceleration, constant speed and constant deceleration."""

    def equations(self):
        after = self.time - self.start
        s, self.velocity, self.acceleration, self.duration = trapezoidal(after, self.distance, self.v_max, self.a_max)
        self.position = self.offset + s


class SCurveProfile(_Profile):
    """A move from rest to rest with limited speed, acceleration and jerk."""

    j_max = Parameter(None, "{position_unit}/s**3", "largest jerk", min=1e-12)

    def equations(self):
        after = self.time - self.start
        s, self.velocity, self.acceleration, self.duration = jerk_limited(
            after, self.distance, self.v_max, self.a_max, self.j_max
        )
        self.position = self.offset + s
