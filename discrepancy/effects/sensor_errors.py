"""A sensor with its errors, as a part of an updated model."""

from __future__ import annotations

from multibody.declare.component import Component
from multibody.declare.declarations import Input, Option, Output, Parameter, State, Unit

__all__ = ["FaultySensor"]


class FaultySensor(Component):
    """A reading with errors: reading = (1 + gain)·true(t − delay) + offset + drift·(t − begin), true behind a lag.

    The lag is a low-pass of first order: give ``lagged`` the start value of what is measured where that is not zero.
    The delay is the Padé approximation [2/2] of `multibody.library.Delay`: give ``z_1`` that value.
    """

    unit = Unit("1", "unit of the signal")
    late = Option(False, "whether the reading comes late")
    slow = Option(False, "whether the reading lags")
    gain = Parameter(0.0, "", "relative error")
    offset = Parameter(0.0, "{unit}", "what is read at zero")
    drift = Parameter(0.0, "{unit}/s", "change of the reading per time")
    begin = Parameter(0.0, "s", "time at which the drift begins")
    delay = Parameter(1e-3, "s", "by how much the reading is late", min=1e-9, when="late")
    lag = Parameter(1e-3, "s", "time constant of the lag", min=1e-9, when="slow")
    true = Input("{unit}", "what is measured")
    z_1 = State("{unit}", "inner state; equals the true value at rest", when="late")
    z_2 = State("{unit}", "inner state, its rate times the delay", when="late")
    lagged = State("{unit}", "what is measured, behind the lag", when="slow")
    reading = Output("{unit}", "what is read")

    def equations(self):
        if self.slow:
            self.der.lagged = (self.true - self.lagged) / self.lag
            seen = self.lagged
        else:
            seen = self.true
        if self.late:
            self.der.z_1 = self.z_2 / self.delay
            self.der.z_2 = 12.0 * (seen - self.z_1 - self.z_2 / 2.0) / self.delay
            read = seen - self.z_2
        else:
            read = seen
        self.reading = (1.0 + self.gain) * read + self.offset + self.drift * (self.time - self.begin)
