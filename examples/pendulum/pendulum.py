"""A single pendulum that swings freely, with viscous friction in its pivot only, as its authors model it."""

import math

from multibody import Model
from multibody.library import Inertia, RotaryViscousFriction, UnbalancedWeight

MASS, ARM, CENTRAL = 0.1476, 0.1478, 1.091e-4  # kg, m, kg*m2 about the centre of mass (arXiv:2205.06231)


def build(viscous: float = 2.24e-4) -> Model:
    """Return the pendulum; ``viscous`` is the friction of the pivot in N*m*s/rad."""
    swing = Model("pendulum")
    rod = swing.add("rod", Inertia(J=CENTRAL + MASS * ARM**2))
    # The encoder reads pi when the rod hangs.
    weight = swing.add("weight", UnbalancedWeight(m=MASS, arm=ARM, phase=-math.pi, g=9.81))
    pivot = swing.add("pivot", RotaryViscousFriction(viscous=viscous))
    swing.connect(rod.flange, weight.flange, pivot.b)
    swing.connect(pivot.a, swing.ground)
    return swing
