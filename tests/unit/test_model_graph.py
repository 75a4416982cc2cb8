"""Parts of a model taken out again: components, connections, inputs and outputs."""

from __future__ import annotations

import numpy as np
import pytest

from multibody import Model
from multibody.library import ForceSource, Gain, Mass, Spring, VelocitySensor


@pytest.fixture
def model() -> Model:
    """A mass on a spring, a measured velocity that is fed back, and a part whose name begins with another's."""
    model = Model("machine")
    body = model.add("body", Mass(m=1.0))
    spring = model.add("body.spring", Spring(stiffness=100.0))
    sensor = model.add("sensor", VelocitySensor())
    gain = model.add("gain", Gain(k=-2.0, input_unit="m/s", output_unit="N"))
    force = model.add("force", ForceSource())
    model.connect(body.flange, spring.b, sensor.flange, force.flange)
    model.connect(spring.a, model.ground)
    model.connect(sensor.velocity, gain.input)
    model.connect(gain.output, force.force)
    model.output("v", "sensor.velocity")
    return model


def test_a_removed_component_takes_its_ends_of_connections_along(model):
    model.remove("body.spring")
    assert "body.spring" not in model.components
    assert model.connections[0] == ("body.flange", "sensor.flange", "force.flange")
    assert ("body.spring.a", "ground") not in model.connections
    assert len(model.connections) == 3


def test_a_name_that_begins_with_the_removed_one_stays(model):
    model.remove("body")
    assert ("body.spring.a", "ground") in model.connections
    assert "body.spring.b" in model.connections[0]


def test_what_fed_only_the_removed_component_is_no_input_any_more(model):
    model.disconnect("gain.output")
    model.input("command", "force.force", default=0.0)
    model.input("both", "gain.input")
    model.remove("force")
    assert list(model.inputs) == ["both"]
    assert model.remove_input("both").targets == ["gain.input"]
    assert model.inputs == {}


def test_a_loop_that_was_cut_can_be_driven_from_outside(model):
    closed = model.build(compiled=False)
    opened = model.copy()
    opened.disconnect("sensor.velocity")
    opened.input("v_measured", "gain.input")
    opened = opened.build(compiled=False)
    x = np.add(closed.start, [0.1, 0.5])
    assert opened.input_names == ("v_measured",)
    assert opened.rhs(0.0, x, [0.5]).tolist() == closed.rhs(0.0, x).tolist()
    assert len(model.connections) == 4  # the original keeps its loop


def test_an_output_stands_for_another_quantity_in_its_place(model):
    model.output("x", "body.position")
    model.redirect_output("v", "body.velocity")
    assert list(model.outputs.items()) == [("v", "body.velocity"), ("x", "body.position")]
    model.remove_output("v")
    assert list(model.outputs) == ["x"]
