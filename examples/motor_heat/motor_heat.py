"""The heat of an electric motor: winding and housing.  As a data sheet has it, all heat leaves through the housing."""

from multibody import Model
from multibody.library import HeatCapacity, HeatSource, TemperatureSource, ThermalConductance


def build() -> Model:
    model = Model("motor heat")
    loss = model.add("loss", HeatSource())
    winding = model.add("winding", HeatCapacity(capacity=900.0))
    slot = model.add("slot", ThermalConductance(conductance=6.0))
    housing = model.add("housing", HeatCapacity(capacity=5200.0))
    surface = model.add("surface", ThermalConductance(conductance=2.5))
    hall = model.add("hall", TemperatureSource())
    model.connect(loss.port, winding.port, slot.a)
    model.connect(slot.b, housing.port, surface.a)
    model.connect(surface.b, hall.port)
    model.input("loss", loss.heat)
    model.input("hall.temperature", hall.temperature)
    return model
