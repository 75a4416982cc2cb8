"""A friction on one side of a rigid gear is the friction on its other side; behind a spring it is another."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from discrepancy.effects.catalogue import catalogue
from discrepancy.evidence.proposals import moving_together, parameter_of_same_law
from multibody import Model
from multibody.library import (
    CoulombFriction,
    Inertia,
    Mass,
    Rack,
    RotaryViscousFriction,
    SpringDamper,
    TorqueSource,
    ViscousFriction,
)


def conveyor() -> Model:
    """Return a motor with a drum that pulls a belt with dry friction, and a load on a spring behind it."""
    model = Model("conveyor")
    motor, bearing = model.add("motor", Inertia(J=0.01)), model.add("bearing", RotaryViscousFriction(viscous=0.1))
    drive, drum = model.add("drive", TorqueSource()), model.add("drum", Rack(radius=0.1))
    belt, dry = model.add("belt", Mass(m=5.0)), model.add("dry", CoulombFriction(coulomb=2.0))
    spring, load = model.add("spring", SpringDamper(stiffness=500.0, damping=3.0)), model.add("load", Mass(m=2.0))
    rail = model.add("rail", ViscousFriction(viscous=1.0))
    model.connect(drive.flange, motor.flange, bearing.b, drum.a)
    model.connect(drum.b, belt.flange, dry.b, spring.a)
    model.connect(spring.b, load.flange, rail.b)
    model.connect(bearing.a, model.ground)
    model.connect(dry.a, rail.a, model.ground)
    model.input("torque", drive.torque)
    return model


def test_dry_friction_at_the_motor_is_that_of_the_belt_which_it_pulls_without_slip() -> None:
    system = conveyor().build(probes=True)
    time = np.linspace(0.0, 2.0, 201)
    run = system.simulate(2.0, inputs={"torque": lambda t: np.sin(5.0 * t)}, times=time)
    outputs = {name: run[name] for name in system.output_names}
    linearised: Any = SimpleNamespace(system=system, experiments=[None], nominal_outputs=lambda index: outputs)
    together = {name: [p.name for p in others] for name, others in moving_together(linearised).items()}
    assert together == {"bearing": ["dry"], "dry": ["bearing"], "spring": [], "rail": []}
    entries = {e.name: e for e in catalogue(system, [], [], include=["coulomb_friction"])}
    places = moving_together(linearised)
    same = {n: parameter_of_same_law(e, ["dry.coulomb"], places[e.where]) for n, e in entries.items()}
    assert same == {
        "coulomb_friction@bearing": "dry.coulomb",
        "coulomb_friction@dry": "dry.coulomb",
        "coulomb_friction@spring": "",
        "coulomb_friction@rail": "",
    }
