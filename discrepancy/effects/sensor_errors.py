"""A sensor with its errors, as a part of an updated model."""

from __future__ import annotations

from multibody.declare.component import Component
from multibody.declare.declarations import Input, Option, Output, Parameter, State, Unit

__all__ = ["FaultySensor"]


class FaultySensor(Component):
    """A reading with errors: reading = (1 + gain)·true(t − delay) + offset + drift·(t − begin).

    The delay is the Padé approximation [2/2] of `multibody.library.Delay`: give ``z_1`` the start value of what is
    measured where that is not zero.
    """

    unit = Unit("1", "unit of the signal")
    late = Option(False, "whether the reading comes late")
    gain = Parameter(0.0, "", "relative error")
    offset = Parameter(0.0, "{unit}", "what is read at zero")
    drift = Parameter(0.0, "{unit}/s", "change of the reading per time")
    begin = Parameter(0.0, "s", "time at which the drift begins")
    delay = Parameter(1e-3, "s", "by how much the reading is late", min=1e-9, when="late")
    true = Input("{unit}", "what is measured")
    z_1 = State("{unit}", "inner state; equals the true value at rest", when="late")
    z_2 = State("{unit}", "inner state, its rate times the delay", when="late")
    reading = Output("{unit}", "what is read")

    def equations(self):
        if self.late:
            self.der.z_1 = self.z_2 / self.delay
            self.der.z_2 = 12.0 * (self.true - self.z_1 - self.z_2 / 2.0) / self.delay
            self.reading = (
                (1.0 + self.gain) * (self.true - self.z_2) + self.offset + self.drift * (self.time - self.begin)
            )
        else:
            self.reading = (1.0 + self.gain) * self.true + self.offset + self.drift * (self.time - self.begin)
