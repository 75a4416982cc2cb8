"""Heat: capacities, conductances, radiation and sources.

Sign convention: a heat port's ``heat_flow`` goes from the node into the part; temperatures are absolute, in K.  The
surroundings are a `FixedTemperature`, not ``model.ground``, whose temperature is 0 K.
"""

from __future__ import annotations

from multibody.declare.component import Component
from multibody.declare.declarations import Energy, HeatPort, Input, Option, Output, Parameter, Power, State
from multibody.library.laws import radiated

__all__ = [
    "FixedTemperature",
    "HeatCapacity",
    "HeatSource",
    "RecordedTemperature",
    "TemperatureSensor",
    "TemperatureSource",
    "ThermalConductance",
    "ThermalRadiation",
    "WarmBody",
]


class WarmBody(Component):
    """What parts with a surface share: heat lost to the surroundings, zero unless it is given.

    lost = loss_conductance · (T − ambient) + radiation · (T⁴ − ambient⁴)

    With ``recorded_ambient`` the temperature of the surroundings is the input ``surroundings`` in place of ``ambient``.
    """

    loss_conductance = Parameter(0.0, "W/K", "heat lost to the surroundings per temperature", min=0.0)
    radiation = Parameter(0.0, "W/K**4", "radiation: emissivity · 5.67e-8 W/(m² K⁴) · surface", min=0.0)
    recorded_ambient = Option(False, "whether the temperature of the surroundings is a signal")
    ambient = Parameter(293.15, "K", "temperature of the surroundings", min=0.0)
    surroundings = Input("K", "temperature of the surroundings", when="recorded_ambient")
    lost = Power(kind="loss", meaning="heat lost to the surroundings")


class HeatCapacity(WarmBody):
    """A body of one temperature: capacity · rate of temperature = heat that flows in − heat lost."""

    capacity = Parameter(None, "J/K", "heat capacity", min=1e-12)
    temperature = State("K", "temperature", start=293.15, min=0.0)
    port = HeatPort("its surface", prescribed=True)
    energy = Energy(meaning="heat stored above 0 K")

    def equations(self):
        self.port.temperature = self.temperature
        around = self.surroundings if self.recorded_ambient else self.ambient
        self.lost = self.loss_conductance * (self.temperature - around) + radiated(
            self.temperature, around, self.radiation
        )
        self.der.temperature = (-self.port.reaction - self.lost) / self.capacity
        self.energy = self.capacity * self.temperature


class ThermalConductance(Component):
    """Conduction or convection: heat_flow = conductance · (temperature of a − temperature of b)."""

    conductance = Parameter(None, "W/K", "heat per temperature", min=0.0)
    a = HeatPort("first side")
    b = HeatPort("second side")
    heat_flow = Output("W", "heat from a to b")

    def equations(self):
        self.heat_flow = self.conductance * (self.a.temperature - self.b.temperature)
        self.a.heat_flow = self.heat_flow
        self.b.heat_flow = -self.heat_flow


class ThermalRadiation(Component):
    """Radiation between two surfaces: heat_flow = radiation · (T_a⁴ − T_b⁴), the law of Stefan and Boltzmann."""

    radiation = Parameter(None, "W/K**4", "emissivity · 5.67e-8 W/(m² K⁴) · surface", min=0.0)
    a = HeatPort("first surface")
    b = HeatPort("second surface")
    heat_flow = Output("W", "heat from a to b")

    def equations(self):
        self.heat_flow = radiated(self.a.temperature, self.b.temperature, self.radiation)
        self.a.heat_flow = self.heat_flow
        self.b.heat_flow = -self.heat_flow


class HeatSource(Component):
    """Heat brought in, given by a signal: a heater, or the ``loss`` of another part."""

    heat = Input("W", "heat brought in")
    port = HeatPort("where it goes")
    power = Power(kind="supply", meaning="heat brought in")

    def equations(self):
        self.port.heat_flow = -self.heat
        self.power = self.heat


class FixedTemperature(Component):
    """Surroundings of constant temperature, whatever heat they take."""

    temperature = Parameter(293.15, "K", "temperature", min=0.0)
    port = HeatPort("what touches them", prescribed=True)
    taken = Power(kind="loss", meaning="heat that the surroundings take")

    def equations(self):
        self.port.temperature = self.temperature
        self.taken = -self.port.reaction


class TemperatureSource(Component):
    """A temperature given by a signal, whatever heat it takes."""

    temperature = Input("K", "temperature")
    port = HeatPort("what has it", prescribed=True)
    taken = Power(kind="loss", meaning="heat that it takes")

    def equations(self):
        self.port.temperature = self.temperature
        self.taken = -self.port.reaction


class TemperatureSensor(Component):
    """The temperature of a node as a signal."""

    port = HeatPort("what is observed")
    temperature = Output("K", "its temperature")

    def equations(self):
        self.temperature = self.port.temperature


class RecordedTemperature(Component):
    """A temperature from a recording, on which nothing in the model depends yet.

    Effects that change with temperature take it from here: feed it by a model input whose column was recorded.
    """

    recorded = Input("K", "temperature from the recording")
    temperature = Output("K", "the same")

    def equations(self):
        self.temperature = self.recorded
