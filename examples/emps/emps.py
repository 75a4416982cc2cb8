"""The EMPS axis: a motor and a ball screw move a carriage, and a controller that is known keeps it on a reference."""

from multibody import Model
from multibody.declare.component import Component
from multibody.declare.declarations import Input, Output, Parameter, Power, State, Translation
from multibody.library import Mass
from multibody.library.friction import Sliding
from multibody.library.laws import coulomb


class Drive(Component):
    """Controller, amplifier and motor.

    voltage = kv · (kp · (reference − position) − speed) + pulse, within ±limit; force = gain · voltage.  The controller
    is sampled: the speed that it works with is late by ``lag``, and its voltage acts on the carriage late by ``hold``.
    """

    kp = Parameter(160.18, "1/s", "gain of the position loop", min=0.0)
    kv = Parameter(243.45, "V*s/m", "gain of the speed loop", min=0.0)
    lag = Parameter(1e-3, "s", "time by which the controller's speed is late", min=1e-5)
    hold = Parameter(5e-4, "s", "time by which the force is late behind the voltage", min=1e-5)
    gain = Parameter(35.15065, "N/V", "force of the motor on the carriage per volt", min=0.0)
    limit = Parameter(10.0, "V", "largest voltage", min=0.0)
    reference = Input("m", "where the carriage should be")
    pulse = Input("V", "voltage added to what the controller asks for")
    carriage = Translation("what is driven")
    speed = State("m/s", "speed that the controller works with")
    driving = State("N", "force of the motor on the carriage")
    voltage = Output("V", "what is sent to the motor")
    force = Output("N", "force that belongs to the voltage, as recorded")
    power = Power(kind="supply", meaning="power brought in")

    def equations(self):
        self.der.speed = (self.carriage.velocity - self.speed) / self.lag
        behind = self.reference - self.carriage.position
        asked = self.kv * (self.kp * behind - self.speed) + self.pulse
        self.voltage = max(-self.limit, min(self.limit, asked))
        self.force = self.gain * self.voltage
        self.der.driving = (self.force - self.driving) / self.hold
        self.carriage.force = self.driving
        self.power = self.driving * self.carriage.velocity


class Guide(Sliding):
    """Friction that is the same in both directions: viscous · v + coulomb · tanh(v / v_s)."""

    viscous = Parameter(200.0, "N*s/m", "force per speed", min=0.0)
    coulomb = Parameter(20.0, "N", "level of dry friction", min=0.0)
    v_s = Parameter(1e-3, "m/s", "speed below which dry friction fades (regularisation)", min=1e-12)

    def equations(self):
        super().equations()
        self.resistance = self.viscous * self.speed + coulomb(self.speed, self.coulomb, self.v_s)


def build(dry: float = 20.0) -> Model:
    """Return the axis; ``dry`` is the level of dry friction in N, zero for viscous friction only."""
    axis = Model("emps")
    drive = axis.add("drive", Drive())
    carriage = axis.add("carriage", Mass(m=95.0))
    guide = axis.add("guide", Guide(coulomb=dry))
    axis.connect(drive.carriage, carriage.flange, guide.b)
    axis.connect(guide.a, axis.ground)
    axis.input("reference.position", drive.reference)
    axis.input("added.pulse", drive.pulse)
    axis.output("motor.force", drive.force)
    return axis
