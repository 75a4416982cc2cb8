"""Liquid in tanks, pipes, orifices, pumps and cylinders.

Sign convention: a fluid port's ``volume_flow`` goes from the node into the part, and its ``pressure`` is above ambient;
``model.ground`` is the surroundings, pressure zero.  A part between ``a`` and ``b`` has the ``drop`` of pressure from a
to b and the ``flow`` that enters at a.  The liquid's density does not change; `Volume` holds its compressibility.
"""

from __future__ import annotations

import math

from multibody.declare.component import Component
from multibody.declare.declarations import (
    Energy,
    FluidPort,
    Input,
    Option,
    Output,
    Parameter,
    Power,
    State,
    Translation,
)
from multibody.library.laws import leakage, pipe_flow, turbulent_flow

__all__ = [
    "Cylinder",
    "FlowSensor",
    "FlowSource",
    "Leaky",
    "Orifice",
    "Pipe",
    "PressureSensor",
    "PressureSource",
    "Tank",
    "Volume",
]


class Leaky(Component):
    """What parts with a seal share: leakage, laminar and turbulent, zero unless it is given.

    leakage(Δp) = leak · Δp + leak_turbulent · Δp/(Δp² + p_s²)^¼, from the higher pressure to the lower.
    """

    leak = Parameter(0.0, "m**3/(s*Pa)", "laminar leakage: flow per pressure", min=0.0)
    leak_turbulent = Parameter(0.0, "m**3/(s*Pa**0.5)", "turbulent leakage: flow per root of the pressure", min=0.0)
    p_s = Parameter(100.0, "Pa", "pressure below which turbulent flow becomes laminar (regularisation)", min=1e-9)
    leaked = Output("m**3/s", "flow that leaks")


class Tank(Leaky):
    """An open tank: area · rate of level = inflow, pressure at its bottom = density · gravity · level.

    It leaks at its bottom into the surroundings.
    """

    area = Parameter(None, "m**2", "surface of the liquid", min=1e-12)
    density = Parameter(1000.0, "kg/m**3", "density of the liquid", min=1e-9)
    gravity = Parameter(9.81, "m/s**2", "gravity", min=0.0)
    level = State("m", "height of the liquid above the port")
    port = FluidPort("connection at the bottom", prescribed=True)
    pressure = Output("Pa", "pressure at the bottom")
    energy = Energy()
    loss = Power(kind="loss")

    def equations(self):
        self.pressure = self.density * self.gravity * self.level
        self.port.pressure = self.pressure
        self.leaked = leakage(self.pressure, self.leak, self.leak_turbulent, self.p_s)
        self.der.level = (-self.port.reaction - self.leaked) / self.area
        self.energy = 0.5 * self.density * self.gravity * self.area * self.level**2
        self.loss = self.pressure * self.leaked


class Volume(Leaky):
    """An enclosed volume of liquid that yields: capacity · rate of pressure = inflow.

    ``capacity`` is volume over bulk modulus, or what an accumulator, a hose or its air takes per pressure.  It leaks
    into the surroundings.
    """

    capacity = Parameter(None, "m**3/Pa", "volume taken per pressure", min=1e-30)
    pressure = State("Pa", "pressure above ambient")
    port = FluidPort("connection", prescribed=True)
    energy = Energy()
    loss = Power(kind="loss")

    def equations(self):
        self.port.pressure = self.pressure
        self.leaked = leakage(self.pressure, self.leak, self.leak_turbulent, self.p_s)
        self.der.pressure = (-self.port.reaction - self.leaked) / self.capacity
        self.energy = 0.5 * self.capacity * self.pressure**2
        self.loss = self.pressure * self.leaked


class Pipe(Component):
    """A pipe: drop = resistance · flow + quadratic_loss · flow·|flow|, laminar friction and losses of its fittings.

    With ``inertial=True`` the liquid in it has inertia, and the flow is a state:
    inertance · rate of flow = drop − losses (inertance = density · length / cross-section).
    """

    resistance = Parameter(None, "Pa*s/m**3", "pressure per flow; 128·η·length/(π·diameter⁴)", min=1e-30)
    quadratic_loss = Parameter(0.0, "Pa*s**2/m**6", "pressure per squared flow of bends, valves and filters", min=0.0)
    inertial = Option(False, "whether the liquid in it has inertia")
    inertance = Parameter(None, "Pa*s**2/m**3", "pressure per rate of flow", min=1e-30, when="inertial")
    through = State("m**3/s", "flow from a to b", when="inertial")
    a = FluidPort("first end")
    b = FluidPort("second end")
    drop = Output("Pa", "pressure of a above b")
    flow = Output("m**3/s", "flow from a to b")
    loss = Power(kind="loss")
    energy = Energy(when="inertial")

    def equations(self):
        self.drop = self.a.pressure - self.b.pressure
        if self.inertial:
            lost = self.resistance * self.through + self.quadratic_loss * self.through * abs(self.through)
            self.der.through = (self.drop - lost) / self.inertance
            self.flow = self.through
            self.loss = lost * self.through
            self.energy = 0.5 * self.inertance * self.through**2
        else:
            self.flow = pipe_flow(self.drop, self.resistance, self.quadratic_loss)
            self.loss = self.drop * self.flow
        self.a.volume_flow = self.flow
        self.b.volume_flow = -self.flow


class Orifice(Component):
    """A sharp-edged orifice: flow = discharge · area · √(2·drop/density), turbulent, laminar below ``p_s``.

    With ``controlled=True`` the signal ``opening`` multiplies the area: a valve.
    """

    area = Parameter(None, "m**2", "cross-section", min=0.0)
    discharge = Parameter(0.7, "", "coefficient of discharge", min=0.0)
    density = Parameter(1000.0, "kg/m**3", "density of the liquid", min=1e-9)
    p_s = Parameter(100.0, "Pa", "pressure below which the flow is laminar (regularisation)", min=1e-9)
    controlled = Option(False, "whether a signal opens it")
    opening = Input("", "share of the area that is open", when="controlled")
    a = FluidPort("first side")
    b = FluidPort("second side")
    drop = Output("Pa", "pressure of a above b")
    flow = Output("m**3/s", "flow from a to b")
    loss = Power(kind="loss")

    def equations(self):
        self.drop = self.a.pressure - self.b.pressure
        factor = self.discharge * self.area * math.sqrt(2.0 / self.density)
        if self.controlled:
            self.flow = self.opening * turbulent_flow(self.drop, factor, self.p_s)
        else:
            self.flow = turbulent_flow(self.drop, factor, self.p_s)
        self.a.volume_flow = self.flow
        self.b.volume_flow = -self.flow
        self.loss = self.drop * self.flow


class FlowSource(Leaky):
    """A pump: a flow given by a signal, taken at the inlet a and delivered at b; it leaks back from b to a."""

    flow = Input("m**3/s", "flow from a to b")
    a = FluidPort("inlet, or the ground")
    b = FluidPort("outlet")
    drop = Output("Pa", "pressure of the outlet above the inlet")
    loss = Power(kind="loss")
    power = Power(kind="supply", meaning="power brought in")

    def equations(self):
        self.drop = self.b.pressure - self.a.pressure
        self.leaked = leakage(self.drop, self.leak, self.leak_turbulent, self.p_s)
        self.a.volume_flow = self.flow - self.leaked
        self.b.volume_flow = self.leaked - self.flow
        self.power = self.drop * self.flow
        self.loss = self.drop * self.leaked


class PressureSource(Component):
    """A pressure given by a signal, whatever flow it takes."""

    pressure = Input("Pa", "pressure above ambient")
    port = FluidPort("outlet", prescribed=True)
    flow = Output("m**3/s", "flow delivered")
    power = Power(kind="supply", meaning="power brought in")

    def equations(self):
        self.port.pressure = self.pressure
        self.flow = self.port.reaction
        self.power = self.pressure * self.flow


class Cylinder(Leaky):
    """A piston between two chambers: force = area_a · pressure of a − area_b · pressure of b.

    The piston draws area · velocity from chamber a and returns it from chamber b; it leaks from a to b.  Connect an
    open side to the ground.  The chambers' compressibility is a `Volume` on each side.
    """

    area_a = Parameter(None, "m**2", "area on which chamber a acts", min=0.0)
    area_b = Parameter(None, "m**2", "area on which chamber b acts", min=0.0)
    a = FluidPort("chamber whose pressure pushes in the positive direction")
    b = FluidPort("the other chamber")
    piston = Translation("rod")
    force = Output("N", "force on the rod")
    loss = Power(kind="loss")

    def equations(self):
        self.leaked = leakage(self.a.pressure - self.b.pressure, self.leak, self.leak_turbulent, self.p_s)
        self.force = self.area_a * self.a.pressure - self.area_b * self.b.pressure
        self.piston.force = self.force
        self.a.volume_flow = self.area_a * self.piston.velocity + self.leaked
        self.b.volume_flow = -self.area_b * self.piston.velocity - self.leaked
        self.loss = (self.a.pressure - self.b.pressure) * self.leaked


class PressureSensor(Component):
    """The pressure of a node above ambient, as a signal."""

    port = FluidPort("what is observed")
    pressure = Output("Pa", "its pressure")

    def equations(self):
        self.pressure = self.port.pressure


class FlowSensor(Component):
    """An ideal flow meter between two ports: it prescribes the pressure of b at a.

    Port b must not be connected to a source, a tank or the ground: put the meter on the side of the source.
    """

    a = FluidPort("where the flow enters")
    b = FluidPort("where it leaves", prescribed=True)
    flow = Output("m**3/s", "flow from a to b")

    def equations(self):
        self.b.pressure = self.a.pressure
        self.flow = self.b.reaction
        self.a.volume_flow = self.b.reaction
