"""A kind of effect that acts at several kinds of places, or with two laws at one, is one kind under one name."""

from __future__ import annotations

import numpy as np
import pytest

from discrepancy.effects.catalogue import catalogue
from discrepancy.effects.effect import Effect
from discrepancy.effects.kinds import kind_named, kinds
from discrepancy.effects.law_along_motion import law_forces
from multibody import Component, Input, Model, Output, Parameter, State, Translation
from multibody.library import CoulombFriction, Mass, SpringDamper, ViscousFriction


class Drive(Component):
    """A speed controller with its motor in one part: force = gain·error + integral."""

    gain = Parameter(50.0, "N*s/m", "gain")
    rate = Parameter(100.0, "N/m", "gain of the integral")
    reference = Input("m/s", "reference of the speed")
    flange = Translation("what it drives")
    integral = State("N", "integral part")
    command = Output("N", "force")

    def equations(self):
        error = self.reference - self.flange.velocity
        self.der.integral = self.rate * error
        self.command = self.gain * error + self.integral
        self.flange.force = self.command


def driven() -> Model:
    model = Model("driven")
    body = model.add("body", Mass(m=2.0))
    drive = model.add("drive", Drive())
    rail = model.add("rail", ViscousFriction(viscous=3.0))
    dry = model.add("dry", CoulombFriction(coulomb=1.0))
    model.connect(drive.flange, body.flange, rail.b, dry.b)
    model.connect(rail.a, dry.a, model.ground)
    model.input("reference", drive.reference)
    return model


def test_a_late_force_of_a_drive_is_an_input_delay() -> None:
    system = driven().build(probes=True)
    entries = {e.name: e for e in catalogue(system, ["body.velocity"], ["reference"], include=["input_delay"])}
    assert sorted(entries) == ["input_delay@drive", "input_delay@reference"]
    late = entries["input_delay@drive"]
    assert late.kind.at == "connection"
    assert late.load == "drive.command"
    # under its earlier name as well
    names = [e.name for e in catalogue(system, ["body.velocity"], ["reference"], include=["controller_delay@drive"])]
    assert names == ["input_delay@drive"]
    assert kind_named("controller_delay") is kinds()["input_delay"]


def test_a_drive_that_is_late_by_nothing_is_the_machine_itself() -> None:
    model = driven()
    entry = next(e for e in catalogue(model.build(probes=True), [], [], include=["input_delay@drive"]))
    assert entry.place is not None
    absent = Effect.at_place(
        "input_delay", entry.place, where="drive", strengths={"lag": 0.0}, shape={"filter": 0.02}, load=entry.load
    )
    assert absent.definition is entry.kind
    assert absent.unit("lag") == "s"
    without, with_it = model.build(), absent.added_to(model).build()
    own = [with_it.index("state", n) for n in without.state_names]
    rng = np.random.default_rng(4)
    for _ in range(10):
        x = rng.standard_normal(len(with_it.states))
        assert np.array_equal(with_it.rhs(0.0, x, [0.3])[own], without.rhs(0.0, x[own], [0.3]))


def test_a_late_force_is_nearly_a_delay() -> None:
    """With lag = 2·filter the force that arrives is that of `lag` ago, for motions that are slow against it."""
    kind = kind_named("input_delay").form(connection=True)
    time = np.linspace(0.0, 4.0, 4001)
    lag, load = 0.02, np.sin(5.0 * time)
    (change,) = law_forces(kind, time, {"position": 0.0 * time, "load": load}, [{"filter": lag / 2}], [{"lag": lag}])
    later = time > 0.2  # it begins without what came before; the phase of the Padé approximation is off by (ωτ)³/12
    np.testing.assert_allclose((load + change)[later], np.sin(5.0 * (time - lag))[later], atol=2e-4)


def test_the_form_follows_from_what_an_effect_has() -> None:
    dry = kind_named("coulomb_friction")
    assert dry.form(connection=True).law == "Coulomb"
    assert dry.form(connection=True, strengths=("level",)).law == "Hysteresis"
    spot = Effect(kind="local_bump", where="rail", strengths={"push": 1.0}, ports=("rail.b", "ground"))
    assert spot.definition.law == "Push"


def test_both_laws_of_a_kind_are_listed_only_where_they_are_asked_for() -> None:
    model = Model("free")
    body = model.add("body", Mass(m=2.0))
    spring = model.add("spring", SpringDamper(stiffness=50.0, damping=1.0))
    model.connect(spring.b, body.flange)
    model.connect(spring.a, model.ground)
    system = model.build(probes=True)
    listed = [e.name for e in catalogue(system, [], [])]
    assert len(set(listed)) == len(listed)
    every = [e.key for e in catalogue(system, [], [], include=["coulomb_friction", "local_bump"], every_law=True)]
    assert every == [
        "coulomb_friction@spring:Coulomb",
        "coulomb_friction@spring:Hysteresis",
        "local_bump@spring:Bump",
        "local_bump@spring:Push",
    ]


def test_friction_does_not_follow_the_friction_between_the_same_parts() -> None:
    """What acts between the two sides does not pass through them: the load of a rail is what drives it."""
    entries = catalogue(driven().build(probes=True), [], [], include=["load_dependent_friction"])
    assert [(e.name, e.load) for e in entries] == [("load_dependent_friction@rail", "drive.command")]


def test_a_kind_without_a_law_for_a_place_keeps_its_own() -> None:
    assert kind_named("sensor_gain").form(connection=True).at == "sensor"
    with pytest.raises(ValueError, match="acts on a sensor"):
        Effect.at_place("sensor_gain", driven().build(probes=True).places[0])
