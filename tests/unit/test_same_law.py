"""A law that the machine has already with a fitted strength is not offered, also where parts are coupled rigidly."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from discrepancy.effects.catalogue import catalogue
from discrepancy.evidence.same_law import parameters_of_same_law
from multibody import Model
from multibody import library as lib


def drive(elastic: bool):
    """Return motor, gear and belt; with or without a spring between gear and belt."""
    m = Model("drive")
    motor = m.add("motor", lib.Inertia(J=0.01))
    bearing = m.add("bearing", lib.RotaryViscousFriction(viscous=0.01))
    rack = m.add("rack", lib.Rack(radius=0.1))
    belt = m.add("belt", lib.Mass(m=10.0))
    dry = m.add("dry", lib.CoulombFriction(coulomb=20.0, v_s=1e-3))
    m.connect(motor.flange, bearing.b, rack.a)
    m.connect(bearing.a, m.ground)
    if elastic:
        spring = m.add("spring", lib.SpringDamper(stiffness=1e4, damping=10.0))
        m.connect(rack.b, spring.a)
        m.connect(spring.b, belt.flange, dry.b)
    else:
        m.connect(rack.b, belt.flange, dry.b)
    m.connect(dry.a, m.ground)
    return m.build()


def asked(elastic: bool) -> dict[str, str]:
    system = drive(elastic)
    speed = np.sin(np.linspace(0.0, 6.0, 50))
    values = {}
    for place in system.places:
        factor = 0.1 if place.domain == "translation" else 1.0
        late = 1e-3 * np.cos(np.linspace(0.0, 6.0, 50)) if elastic and place.domain == "translation" else 0.0
        values[f"place.{place.name}.{place.motion_names()[1][0]}"] = factor * (speed + late)
    linearised = SimpleNamespace(
        system=system,
        experiments=[None],
        nominal_outputs=lambda i: values,
        sensitivities=lambda: SimpleNamespace(names=("dry.coulomb",)),
    )
    return parameters_of_same_law(linearised, catalogue(system, (), ()))


def test_friction_on_either_side_of_a_rigid_rack_is_one() -> None:
    found = asked(elastic=False)
    assert found["coulomb_friction@bearing"] == "dry.coulomb"
    assert found["coulomb_friction@dry"] == "dry.coulomb"
    assert "viscous_friction@bearing" not in found


def test_friction_on_either_side_of_a_spring_is_two() -> None:
    found = asked(elastic=True)
    assert found["coulomb_friction@dry"] == "dry.coulomb"
    assert "coulomb_friction@bearing" not in found
