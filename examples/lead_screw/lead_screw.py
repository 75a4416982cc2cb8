"""A lead screw drive at given speed; the torque that this takes is what the motor measures."""

from multibody import Model
from multibody.library import Inertia, RotaryViscousFriction, SpeedSource


def build(inertia: float = 2.186e-6, viscous: float = 1e-4) -> Model:
    """Return the drive: inertia in kg*m2 and viscous friction in N*m*s/rad, both at the motor."""
    drive = Model("lead_screw")
    motor = drive.add("motor", SpeedSource(time_constant=5e-3))
    rotor = drive.add("rotor", Inertia(J=inertia))
    screw = drive.add("screw", RotaryViscousFriction(viscous=viscous))
    drive.connect(motor.flange, rotor.flange, screw.b)
    drive.connect(screw.a, drive.ground)
    drive.input("reference.speed", motor.reference)
    return drive
