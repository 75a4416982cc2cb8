"""Pictures of the lift: every component and connection is in the diagram, the animation moves what moves."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pytest

from vtsdt.lift.lift import Lift
from vtsdt.lift.pictures import animate_trip, diagram, mode_shapes, trip_strip
from vtsdt.lift.schematic import Schematic


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


@pytest.mark.parametrize("make", [Lift.reference, Lift.one_dimensional, Lift.cabin])
def test_the_diagram_names_every_component_and_input(make):
    lift = make()
    axes = diagram(lift).axes[0]
    texts = " ".join(t.get_text() for t in axes.texts)
    for name in (*lift.components, *lift.inputs):
        assert name in texts


def test_the_strip_of_a_trip_has_its_signals_with_units():
    run = Lift.one_dimensional(profile=True).trip("up", inputs={"friction_c": 0.0, "friction_cw": 0.0})
    figure = trip_strip(run)
    labels = [line.get_label() for a in figure.axes for line in a.lines]
    assert {"z_c", "F_c", "i_q", "fric_c"} <= set(labels)
    assert all(a.get_ylabel().startswith("[") for a in figure.axes)


def test_mode_shapes_are_drawn_for_the_vertical_modes():
    figure = mode_shapes(Lift.one_dimensional())
    assert [a.get_title().split(" ")[0] for a in figure.axes] == ["11.78", "33.22", "34.08", "40.41", "53.86"]


def test_the_cabin_stands_where_its_state_says():
    lift = Lift.reference()
    axes = plt.figure().add_subplot()
    drawing = Schematic(lift, axes, exaggeration=1.0)
    drawing.show({"cabin.z": 0.7, "cabin.x": 0.01, "counterweight.z": 1.0})
    corners = drawing.boxes["cabin"].get_xy()
    assert corners[:, 1].min() == pytest.approx(0.7)
    assert corners[:, 0].mean() == pytest.approx(0.01, abs=0.1)


def test_an_animation_is_written(tmp_path):
    lift = Lift.cabin()
    run = lift.trip("up", inputs={"F_c": (np.array([0.0, 0.2]), np.array([313.81, 320.0]))}, until=0.2, step=0.01)
    path = tmp_path / "trip.gif"
    animate_trip(lift, run, path, frames=5)
    assert path.read_bytes()[:6] in (b"GIF87a", b"GIF89a")
