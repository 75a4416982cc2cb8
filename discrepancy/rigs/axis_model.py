"""A linear axis: a servo motor drives a carriage on a guide through an elastic coupling and a ball screw."""

import math

import multibody.library as lib
from multibody.machine.model import Model

LEAD = 0.04  # m of travel for one turn of the screw


def build(mass: float = 40.0, viscous: float = 60.0, coulomb: float = 0.0) -> Model:
    """Return the axis: mass of the carriage in kg, friction of its guide in N*s/m, and dry friction in N."""
    axis = Model("axis")
    setpoint = axis.add("setpoint", lib.Gain(k=2.0 * math.pi / LEAD, input_unit="m", output_unit="rad"))
    control = axis.add("controller", lib.PositionController(k_position=20.0, k_speed=0.12, k_i=1.8, output_unit="N*m"))
    drive = axis.add("drive", lib.TorqueSource())
    motor = axis.add("motor", lib.Inertia(J=5e-4))
    angle, speed = axis.add("encoder", lib.AngleSensor()), axis.add("tachometer", lib.SpeedSensor())
    coupling = axis.add("coupling", lib.TorsionSpring(stiffness=30.0))
    damper = axis.add("damper", lib.TorsionDamper(damping=0.006))
    screw = axis.add("screw", lib.Screw(lead=LEAD))
    carriage = axis.add("carriage", lib.Mass(m=mass))
    guide = axis.add("guide", lib.ViscousFriction(viscous=viscous))

    axis.connect(setpoint.output, control.reference)
    axis.connect(control.output, drive.torque)
    axis.connect(drive.flange, motor.flange, angle.flange, speed.flange, coupling.a, damper.a)
    axis.connect(coupling.b, damper.b, screw.a)
    axis.connect(screw.b, carriage.flange, guide.b)
    axis.connect(guide.a, axis.ground)
    axis.connect(angle.angle, control.position)
    axis.connect(speed.speed, control.speed)
    if coulomb > 0.0:
        dry = axis.add("dry_friction", lib.CoulombFriction(coulomb=coulomb, v_s=2e-3))
        axis.connect(dry.b, carriage.flange)
        axis.connect(dry.a, axis.ground)
    axis.input("reference.position", setpoint.input)
    axis.output("motor.torque", control.output)
    return axis
