"""Electrical parts and motors.

Sign convention: a pin's ``current`` flows from the node into the part; a part between ``p`` and ``n`` has the
``voltage`` of p against n and the ``current`` that enters at p.  Earth is ``model.ground``.
"""

from __future__ import annotations

import math

from multibody.declare.component import Component
from multibody.declare.declarations import Energy, Input, Option, Output, Parameter, Pin, Power, Rotation, State
from multibody.library.laws import current_against_drop, voltage_drop

__all__ = [
    "PMSM",
    "Capacitor",
    "CurrentSource",
    "DCMotor",
    "DCMotorDrive",
    "Inductor",
    "Resistor",
    "VoltageSource",
]


class Resistor(Component):
    """A resistor: voltage = R · current."""

    R = Parameter(None, "ohm", "resistance", min=1e-12)
    p = Pin("positive pin")
    n = Pin("negative pin")
    current = Output("A", "current from p to n")
    loss = Power(kind="loss")

    def equations(self):
        self.current = (self.p.voltage - self.n.voltage) / self.R
        self.p.current = self.current
        self.n.current = -self.current
        self.loss = self.R * self.current**2


class Inductor(Component):
    """A coil: L · rate of current = voltage."""

    L = Parameter(None, "H", "inductance", min=1e-15)
    current = State("A", "current from p to n")
    p = Pin("positive pin")
    n = Pin("negative pin")
    energy = Energy()

    def equations(self):
        self.der.current = (self.p.voltage - self.n.voltage) / self.L
        self.p.current = self.current
        self.n.current = -self.current
        self.energy = 0.5 * self.L * self.current**2


class Capacitor(Component):
    """A capacitor: C · rate of voltage = current.  It gives pin p its voltage above pin n."""

    C = Parameter(None, "F", "capacitance", min=1e-18)
    voltage = State("V", "voltage of p against n")
    p = Pin("positive pin", prescribed=True)
    n = Pin("negative pin")
    current = Output("A", "current from p to n")
    energy = Energy()

    def equations(self):
        self.p.voltage = self.n.voltage + self.voltage
        self.current = -self.p.reaction
        self.n.current = self.p.reaction
        self.der.voltage = self.current / self.C
        self.energy = 0.5 * self.C * self.voltage**2


class VoltageSource(Component):
    """A voltage of p above n, given by a signal, whatever current it takes."""

    voltage = Input("V", "voltage of p against n")
    p = Pin("positive pin", prescribed=True)
    n = Pin("negative pin, usually the ground")
    current = Output("A", "current delivered at p")
    power = Power(kind="supply", meaning="power brought in")

    def equations(self):
        self.p.voltage = self.n.voltage + self.voltage
        self.current = self.p.reaction
        self.n.current = self.p.reaction
        self.power = self.voltage * self.current


class CurrentSource(Component):
    """A current delivered at p and taken at n, given by a signal, whatever voltage it takes."""

    current = Input("A", "current delivered at p")
    p = Pin("positive pin")
    n = Pin("negative pin, usually the ground")
    voltage = Output("V", "voltage of p against n")
    power = Power(kind="supply", meaning="power brought in")

    def equations(self):
        self.p.current = -self.current
        self.n.current = self.current
        self.voltage = self.p.voltage - self.n.voltage
        self.power = self.voltage * self.current


class DCMotor(Component):
    """A permanent-magnet DC motor: torque = k_t · current, back-EMF = k_t · speed.

    L · rate of current = voltage − R · current − k_t · speed − drop; ``inductive=False`` leaves L out. The drop of the
    brushes is ``brush_drop`` against the current, and zero unless it is given.  The rotor's inertia is an `Inertia`
    connected to the flange.
    """

    R = Parameter(None, "ohm", "resistance of the winding", min=1e-12)
    L = Parameter(None, "H", "inductance of the winding", min=1e-15, when="inductive")
    k_t = Parameter(None, "N*m/A", "torque constant, also back-EMF constant in V·s/rad")
    brush_drop = Parameter(0.0, "V", "voltage lost at the brushes, against the current", min=0.0)
    i_brush = Parameter(1e-2, "A", "current below which that voltage fades (regularisation)", min=1e-12)
    inductive = Option(True, "False leaves the inductance out; the current then follows at once")
    current = State("A", "current from p to n", when="inductive")
    i = Output("A", "current from p to n")
    torque = Output("N*m", "torque on the flange")
    p = Pin("positive pin")
    n = Pin("negative pin")
    flange = Rotation("rotor")
    energy = Energy(when="inductive")
    loss = Power(kind="loss")

    def equations(self):
        emf = self.k_t * self.flange.speed
        voltage = self.p.voltage - self.n.voltage
        if self.inductive:
            drop = voltage_drop(self.current, self.brush_drop, self.i_brush)
            self.der.current = (voltage - self.R * self.current - emf - drop) / self.L
            self.i = self.current
            self.energy = 0.5 * self.L * self.current**2
        else:
            self.i = current_against_drop(voltage - emf, self.R, self.brush_drop, self.i_brush)
        self.p.current = self.i
        self.n.current = -self.i
        self.torque = self.k_t * self.i
        self.flange.torque = self.torque
        self.loss = self.R * self.i**2 + voltage_drop(self.i, self.brush_drop, self.i_brush) * self.i


class DCMotorDrive(Component):
    """A `DCMotor` whose voltage is a signal, for machines without an electrical circuit."""

    R = Parameter(None, "ohm", "resistance of the winding", min=1e-12)
    L = Parameter(None, "H", "inductance of the winding", min=1e-15, when="inductive")
    k_t = Parameter(None, "N*m/A", "torque constant, also back-EMF constant in V·s/rad")
    brush_drop = Parameter(0.0, "V", "voltage lost at the brushes, against the current", min=0.0)
    i_brush = Parameter(1e-2, "A", "current below which that voltage fades (regularisation)", min=1e-12)
    inductive = Option(True, "False leaves the inductance out; the current then follows at once")
    voltage = Input("V", "voltage on the winding")
    current = State("A", "current", when="inductive")
    i = Output("A", "current")
    torque = Output("N*m", "torque on the flange")
    flange = Rotation("rotor")
    energy = Energy(when="inductive")
    loss = Power(kind="loss")
    power = Power(kind="supply", meaning="electrical power brought in")

    def equations(self):
        emf = self.k_t * self.flange.speed
        if self.inductive:
            drop = voltage_drop(self.current, self.brush_drop, self.i_brush)
            self.der.current = (self.voltage - self.R * self.current - emf - drop) / self.L
            self.i = self.current
            self.energy = 0.5 * self.L * self.current**2
        else:
            self.i = current_against_drop(self.voltage - emf, self.R, self.brush_drop, self.i_brush)
        self.torque = self.k_t * self.i
        self.flange.torque = self.torque
        self.loss = self.R * self.i**2 + voltage_drop(self.i, self.brush_drop, self.i_brush) * self.i
        self.power = self.voltage * self.i


class PMSM(Component):
    """A permanent-magnet synchronous motor in rotor coordinates d–q, amplitude-invariant.

    L_d·i_d' = V_d − R·i_d + ω_e·L_q·i_q,  L_q·i_q' = V_q − R·i_q − ω_e·(L_d·i_d + ψ),
    torque = 3/2·pole_pairs·(ψ + (L_d − L_q)·i_d)·i_q, with ω_e = pole_pairs·speed
    (D. Schröder, "Elektrische Antriebe – Grundlagen", ch. 6; amplitude-invariant Park transformation).
    The dead time of the inverter takes the voltage ``dead_time_drop`` along the current: from V_d the share
    i_d/√(i_d² + i_q² + i_dead²), from V_q that of i_q; zero unless it is given.
    """

    R = Parameter(None, "ohm", "resistance of one phase", min=0.0)
    L_d = Parameter(None, "H", "inductance along the magnet axis", min=1e-15)
    L_q = Parameter(None, "H", "inductance across it", min=1e-15)
    psi = Parameter(None, "Wb", "flux linkage of the magnets")
    pole_pairs = Parameter(1.0, "", "number of pole pairs", min=1.0)
    dead_time_drop = Parameter(0.0, "V", "voltage lost by the inverter's dead time, against the current", min=0.0)
    i_dead = Parameter(1e-2, "A", "current below which that voltage fades (regularisation)", min=1e-12)
    V_d = Input("V", "voltage along the magnet axis")
    V_q = Input("V", "voltage across it")
    i_d = State("A", "current along the magnet axis")
    i_q = State("A", "current across it")
    torque = Output("N*m", "torque on the flange")
    flange = Rotation("rotor")
    energy = Energy()
    loss = Power(kind="loss")
    power = Power(kind="supply", meaning="electrical power brought in")

    def equations(self):
        omega = self.pole_pairs * self.flange.speed
        size = math.sqrt(self.i_d**2 + self.i_q**2 + self.i_dead**2)
        lost_d, lost_q = self.dead_time_drop * self.i_d / size, self.dead_time_drop * self.i_q / size
        self.der.i_d = (self.V_d - self.R * self.i_d - lost_d + omega * self.L_q * self.i_q) / self.L_d
        self.der.i_q = (self.V_q - self.R * self.i_q - lost_q - omega * (self.L_d * self.i_d + self.psi)) / self.L_q
        self.torque = 1.5 * self.pole_pairs * (self.psi + (self.L_d - self.L_q) * self.i_d) * self.i_q
        self.flange.torque = self.torque
        self.energy = 0.75 * (self.L_d * self.i_d**2 + self.L_q * self.i_q**2)
        self.loss = 1.5 * (self.R * (self.i_d**2 + self.i_q**2) + lost_d * self.i_d + lost_q * self.i_q)
        self.power = 1.5 * (self.V_d * self.i_d + self.V_q * self.i_q)
