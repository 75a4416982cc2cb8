"""A balance of hundreds of forces, and the energy of hundreds of parts, can be written and read."""

from __future__ import annotations

import multibody.library as lib
from multibody.assembly.dynamics import MOST_TERMS, total
from multibody.machine.model import Model


def test_a_mass_on_very_many_springs_is_assembled():
    m = Model("bed of springs")
    mass = m.add("mass", lib.Mass(m=1.0))
    for k in range(400):  # Python reads no more than about 300 sums one inside the other
        spring = m.add(f"spring_{k}", lib.SpringDamper(stiffness=1.0, damping=0.0))
        m.connect(spring.b, mass.flange)
        m.connect(spring.a, m.ground)
    assert len(m.build().states) == 2


def test_a_sum_of_sums_has_every_term_once():
    names = [f"x{k}" for k in range(MOST_TERMS**2 + 3)]
    values = {name: 2**k for k, name in enumerate(names)}
    assert eval(total(names), {}, values) == 2 ** len(names) - 1
