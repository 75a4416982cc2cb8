"""Sensors between ports and signals, and measuring chains inside the model."""

from __future__ import annotations

from multibody.declare.component import Component
from multibody.declare.declarations import Input, Option, Output, Parameter, Pin, Rotation, State, Translation, Unit

__all__ = [
    "AccelerationSensor",
    "AngleSensor",
    "CurrentSensor",
    "ForceSensor",
    "PositionSensor",
    "SensorChannel",
    "SpeedSensor",
    "TorqueSensor",
    "VelocitySensor",
    "VoltageSensor",
]


class PositionSensor(Component):
    """The position of a flange as a signal."""

    flange = Translation("what is observed")
    position = Output("m", "its position")

    def equations(self):
        self.position = self.flange.position


class VelocitySensor(Component):
    """The velocity of a flange as a signal."""

    flange = Translation("what is observed")
    velocity = Output("m/s", "its velocity")

    def equations(self):
        self.velocity = self.flange.velocity


class AccelerationSensor(Component):
    """The acceleration of a flange as a signal; there has to be a mass on it."""

    flange = Translation("what is observed")
    acceleration = Output("m/s**2", "its acceleration")

    def equations(self):
        self.acceleration = self.flange.acceleration


class AngleSensor(Component):
    """The angle of a flange as a signal."""

    flange = Rotation("what is observed")
    angle = Output("rad", "its angle")

    def equations(self):
        self.angle = self.flange.angle


class SpeedSensor(Component):
    """The speed of a turning flange as a signal."""

    flange = Rotation("what is observed")
    speed = Output("rad/s", "its speed")

    def equations(self):
        self.speed = self.flange.speed


class ForceSensor(Component):
    """A rigid force sensor between two flanges, which it holds at the same position."""

    a = Translation("first side")
    b = Translation("second side")
    force = Output("N", "positive in tension")

    def coupling(self):
        self.b.position = self.a.position

    def coupling_inverse(self):
        self.a.position = self.b.position

    def equations(self):
        self.force = -self.b.reaction


class TorqueSensor(Component):
    """A rigid torque sensor between two flanges, which it holds at the same angle."""

    a = Rotation("first side")
    b = Rotation("second side")
    torque = Output("N*m", "torque that a passes on to b")

    def coupling(self):
        self.b.angle = self.a.angle

    def coupling_inverse(self):
        self.a.angle = self.b.angle

    def equations(self):
        self.torque = self.b.reaction


class CurrentSensor(Component):
    """An ideal ammeter between two pins: it prescribes the voltage of pin p at pin n.

    Pin n must not be connected to a source or the ground: put the meter on the side of the source.
    """

    p = Pin("where the current enters")
    n = Pin("where it leaves", prescribed=True)
    current = Output("A", "current from p to n")

    def equations(self):
        self.n.voltage = self.p.voltage
        self.current = self.n.reaction
        self.p.current = self.n.reaction


class VoltageSensor(Component):
    """An ideal voltmeter between two pins."""

    p = Pin("positive pin")
    n = Pin("negative pin, usually the ground")
    voltage = Output("V", "voltage of p against n")

    def equations(self):
        self.voltage = self.p.voltage - self.n.voltage


class SensorChannel(Component):
    """A measuring chain inside the model: output = gain · (lagged) input + offset.

    Noise, sampling and quantisation are not differential equations; see `multibody.library.measurement` for
    them.
    """

    unit = Unit("1", "unit of the signal")
    lagging = Option(False, "whether the chain has a lag of first order")
    gain = Parameter(1.0, "", "factor; 1 is right")
    offset = Parameter(0.0, "{unit}", "value at zero")
    time_constant = Parameter(1e-3, "s", "lag", min=1e-12, when="lagging")
    input = Input("{unit}", "what is measured")
    lagged = State("{unit}", "input behind the lag", when="lagging")
    output = Output("{unit}", "what is read")

    def equations(self):
        if self.lagging:
            self.der.lagged = (self.input - self.lagged) / self.time_constant
            self.output = self.gain * self.lagged + self.offset
        else:
            self.output = self.gain * self.input + self.offset
