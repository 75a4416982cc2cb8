"""Models of the same structure share their equations within a process, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from multibody import Model, ModelError
from multibody.assembly import assemble as assembly
from multibody.assembly import structure_cache
from multibody.compile import assembled as plan
from multibody.library import Mass, Spring
from vtsdt.lift.lift import Lift

NAMED = ("states", "inputs", "parameters", "outputs", "speed_names", "input_delays", "rate_states")
TEXTS = ("rhs", "outputs", "speeds", "rhs_tangent", "outputs_tangent", "rhs_columns")


@pytest.fixture
def assembled(monkeypatch):
    """Return the list of models that are assembled from now on, starting with an empty cache."""
    names = []
    real = assembly.assemble

    def counted(model, **options):
        names.append(model.name)
        return real(model, **options)

    structure_cache.clear()
    monkeypatch.setattr(plan, "_built", plan.BUILDS)
    monkeypatch.setattr(assembly, "assemble", counted)
    yield names
    structure_cache.clear()


def oscillator(stiffness=100.0, mass=Mass, **start):
    model = Model("oscillator")
    body = model.add("body", mass(m=1.0, **start))
    spring = model.add("spring", Spring(stiffness=stiffness))
    model.connect(spring.a, model.ground)
    model.connect(spring.b, body.flange)
    return model


def same(stored, fresh):
    for name in NAMED:
        assert getattr(stored, name) == getattr(fresh, name), name
    assert {n: stored.texts[n] for n in TEXTS} == {n: fresh.texts[n] for n in TEXTS}
    np.testing.assert_array_equal(stored.sparsity, fresh.sparsity)
    assert stored.places == fresh.places


def test_other_values_and_fewer_outputs_come_from_one_assembly(assembled):
    lift = Lift.one_dimensional()
    changed = lift.with_values({"cabin.mass": 321.0})
    lift.build(probes=True)
    systems = [m.build(probes=True, outputs=o) for m in (lift, changed) for o in (None, ("a_c", "F_c"))]
    assert len(assembled) == 1
    assert systems[2].p[systems[2].index("parameter", "cabin.mass")] == 321.0
    assert systems[0].p[systems[0].index("parameter", "cabin.mass")] != 321.0
    for k, model in ((2, changed), (3, changed)):
        structure_cache.clear()
        same(systems[k], model.build(probes=True, outputs=None if k == 2 else ("a_c", "F_c")))


def test_what_is_not_a_value_is_another_structure(assembled, monkeypatch):
    oscillator().build()
    oscillator(200.0).build()
    assert len(assembled) == 1
    assert oscillator(position=0.2).build().start[0] == 0.2
    oscillator().build(energy=True)
    oscillator().build(probes=True)
    oscillator().copy("other").build()
    assert len(assembled) == 5

    class Heavy(Mass):
        """A mass of this test."""

    assert oscillator(mass=Heavy).build().state_names == oscillator().build().state_names
    assert len(assembled) == 6

    def equations(self):
        self.a.force = 2.0 * self.stiffness * (self.a.position - self.b.position)
        self.b.force = -self.a.force
        self.force = self.a.force
        self.energy = self.stiffness * (self.a.position - self.b.position) ** 2

    before = structure_cache.structure_key(oscillator())
    monkeypatch.setattr(Spring, "equations", equations, raising=False)
    assert structure_cache.structure_key(oscillator()) != before


def test_faults_are_reported_although_the_structure_is_known(assembled):
    oscillator().build()
    with pytest.raises(ModelError, match="least value"):
        oscillator(-1.0).build()
    with pytest.raises(ModelError, match=r"no output 'body\.positon'"):
        oscillator().build(outputs=["body.positon"])
    assert structure_cache.structure_key(oscillator(-1.0)) is None
    spring = oscillator().components["spring"]
    spring.made_of = object()  # a value that cannot be part of a key
    model = Model("odd")
    model.add("spring", spring)
    assert structure_cache.structure_key(model) is None


def test_the_least_recently_used_structure_is_removed(assembled, monkeypatch):
    monkeypatch.setattr(structure_cache, "CAPACITY", 2)
    for k in range(3):
        oscillator().copy(f"number {k}").build()
    assert len(structure_cache._stored) == 2
    oscillator().copy("number 0").build()
    assert len(assembled) == 4


def test_a_stored_plan_keeps_its_own_values(assembled):
    first = oscillator(100.0).build()
    second = oscillator(101.0).build()
    assert [s.p[s.index("parameter", "spring.stiffness")] for s in (first, second)] == [100.0, 101.0]
    assert first.texts["rhs"] == second.texts["rhs"]
