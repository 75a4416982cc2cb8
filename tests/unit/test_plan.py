"""Assembled equations from an earlier process: the same to the last bit, and never stale."""

from __future__ import annotations

import numpy as np
import pytest

from multibody import Model, ModelError
from multibody.compile import assembled as plan
from multibody.library import Mass, Spring
from vtsdt.lift.lift import Lift

TEXTS = ("rhs", "outputs", "speeds", "rhs_tangent", "outputs_tangent", "rhs_columns")


@pytest.fixture
def new_process(tmp_path, monkeypatch):
    """Return a function after which builds are those of a new process, in a cache of their own."""
    monkeypatch.setenv("VTSDT_CACHE", str(tmp_path))

    def begin():
        monkeypatch.setattr(plan, "_built", 0)
        return sorted(tmp_path.glob("plan_*.json"))

    begin()
    return begin


@pytest.fixture
def no_assembly(monkeypatch):
    """Return a function that makes every assembly fail from then on."""

    def refuse(*given, **options):
        raise AssertionError("assembled again")

    return lambda: monkeypatch.setattr("multibody.assembly.assemble.assemble", refuse)


def oscillator(stiffness=100.0, mass=Mass):
    model = Model("oscillator")
    body = model.add("body", mass(m=1.0, position=0.1))
    spring = model.add("spring", Spring(stiffness=stiffness))
    model.connect(spring.a, model.ground)
    model.connect(spring.b, body.flange)
    model.feature("stripe", 0.01, "body.velocity")
    return model


@pytest.mark.parametrize("options", [{}, {"energy": True}, {"outputs": ["cabin.z"]}])
def test_a_lift_from_the_cache_is_the_lift(options, new_process, no_assembly):
    lift = Lift.one_dimensional()
    first = lift.build(**options)
    texts = {name: first.texts[name] for name in TEXTS}
    places = first.places
    assert len(new_process()) == 1
    no_assembly()
    other = Lift.one_dimensional()
    second = other.build(**options)
    for name in ("states", "inputs", "parameters", "outputs", "speed_names", "input_delays", "rate_states"):
        assert getattr(second, name) == getattr(first, name)
    assert {name: second.texts[name] for name in TEXTS} == texts
    assert second.places == places
    np.testing.assert_array_equal(second.sparsity, first.sparsity)
    np.testing.assert_array_equal(second.colours, first.colours)


def test_a_derivative_that_was_never_written_is_written_from_the_model(new_process):
    oscillator().build()
    new_process()
    late = oscillator().build()
    new_process()
    assert late.texts["rhs_tangent"] == oscillator(101.0).build().texts["rhs_tangent"]
    assert late.simulate(0.1, method="Rodas5P")["body.position"].size == 1001


def test_whatever_differs_is_another_plan(new_process):
    given = [
        oscillator(),
        oscillator(101.0),
        oscillator().copy("other name"),
        oscillator().with_values({"body.position": 0.2}),
        Lift.cabin(),
    ]
    wider = oscillator()
    wider.feature("stripe", 0.02, "body.velocity")
    for model in (*given, wider):
        new_process()
        system = model.build()
        new_process()
        again = model.build()
        assert again.parameters == system.parameters
        assert again.states == system.states
    assert len(new_process()) == 6
    assert oscillator(101.0).build().p[oscillator().build().index("parameter", "spring.stiffness")] == 101.0


def test_an_edited_package_makes_a_new_plan(new_process, monkeypatch):
    oscillator().build()
    new_process()
    monkeypatch.setattr(plan, "_package", lambda name: "edited")
    oscillator().build()
    assert len(new_process()) == 2


def test_a_class_whose_text_is_not_in_a_package_is_assembled_every_time(new_process, monkeypatch):
    class Heavy(Mass):
        """A mass of this test."""

    oscillator(mass=Heavy).build()
    assert new_process() == []

    def equations(self):
        self.a.force = 2.0 * self.stiffness * self.stretch

    monkeypatch.setattr(Spring, "equations", equations, raising=False)
    assert plan._built == 0
    with pytest.raises(plan.NoKey):
        plan._key(oscillator(), False, None)


def test_a_damaged_file_is_assembled_anew(new_process):
    first = oscillator().build()
    (path,) = new_process()
    path.write_bytes(path.read_bytes()[:-9])
    assert oscillator().build().texts["rhs"] == first.texts["rhs"]


def test_a_faulty_model_is_refused_every_time_and_old_plans_are_removed(new_process, monkeypatch):
    for _ in range(2):
        faulty = oscillator()
        faulty.input("force", "body.nothing")
        with pytest.raises(ModelError, match=r"body\.nothing"):
            faulty.build()
        assert new_process() == []
    monkeypatch.setattr(plan, "KEPT", 2)
    for k in range(4):
        new_process()
        oscillator(100.0 + k).build()
    assert len(new_process()) == 2
