"""A pendulum that a motor of little torque swings up: a rigid rod with a weight, viscous friction in its bearing."""

from multibody import Model
from multibody.library import Inertia, RotaryViscousFriction, TorqueSource, UnbalancedWeight

MASS, ARM = 0.676, 0.45  # kg, m: weight with rod and mounting, and their centre of mass (testbench description)


def build(inertia: float = 0.15, viscous: float = 0.1) -> Model:
    """Return the pendulum: inertia with the motor's rotor in kg*m2, viscous friction in N*m*s/rad."""
    swing = Model("torque_limited_pendulum")
    motor = swing.add("motor", TorqueSource())
    rod = swing.add("rod", Inertia(J=inertia))
    weight = swing.add("weight", UnbalancedWeight(m=MASS, arm=ARM))
    bearing = swing.add("bearing", RotaryViscousFriction(viscous=viscous))
    swing.connect(motor.flange, rod.flange, weight.flange, bearing.b)
    swing.connect(bearing.a, swing.ground)
    swing.input("motor.torque", motor.torque)
    return swing
