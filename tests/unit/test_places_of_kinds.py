"""At which connections of a machine a kind of effect is asked."""

from __future__ import annotations

import pytest

from discrepancy.effects.catalogue import catalogue
from multibody import Model
from multibody.library import Mass, SpringDamper, ViscousFriction


@pytest.mark.parametrize("kind", ["angle_harmonic", "local_bump"])
def test_what_belongs_to_a_place_of_the_travel_is_not_asked_in_the_stretch_of_a_spring_between_two_bodies(kind) -> None:
    """Cogging and a tight spot belong to the way of a body along the ground, on a spring or not."""
    model = Model("table")
    motor, table = model.add("motor", Mass(m=1.0)), model.add("table", Mass(m=4.0))
    nut = model.add("nut", SpringDamper(stiffness=1e6, damping=100.0))
    guide = model.add("guide", ViscousFriction(viscous=5.0))
    spring = model.add("spring", SpringDamper(stiffness=40.0, damping=1.0))
    model.connect(motor.flange, nut.b, spring.b)
    model.connect(nut.a, table.flange, guide.b)
    model.connect(spring.a, guide.a, model.ground)
    names = {e.name for e in catalogue(model.build(probes=True), [], [], include=[kind, "backlash"])}
    assert f"{kind}@guide" in names
    assert f"{kind}@spring" in names
    assert f"{kind}@nut" not in names
    assert "backlash@nut" in names
