"""All faults of bodies and frames are reported together, with the component's name."""

from __future__ import annotations

import numpy as np
import pytest

from multibody import Component, Frame, Model, ModelError
from multibody.assembly.spatial.symbols import cross, dot, matmul, plus, times
from multibody.library import Spring
from multibody.library.spatial import FixedFrame, FrameSpring, Link, RigidBody, World

GOOD = {"mass": 1.0, "I_xx": 1.0, "I_yy": 1.0, "I_zz": 1.0}


def faults(build) -> str:
    model = Model("m")
    build(model)
    with pytest.raises(ModelError) as caught:
        model.build(compiled=False)
    return "\n".join(caught.value.faults)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"mass": -1.0}, "'mass' is -1 kg, below its least value"),
        ({"mass": 0.0}, "give it a mass"),
        ({"I_xy": 3.0}, "not positive definite"),
        ({"I_xx": 3.0}, "triangle inequality"),
        ({"I_xx": -1.0}, "'I_xx' is -1"),
        ({"mass": float("nan")}, "give a finite number"),
        ({"pitch_start": np.pi / 2}, "quarter turn"),
        ({"tip_w": 1.0}, "no parameter 'tip_w'"),
        ({"x": 1}, "option 'x' is 1: give one of True, False"),
    ],
)
def test_values(values, message):
    text = faults(lambda m: m.add("cabin", Link(**{**GOOD, **values})))
    assert "component 'cabin'" in text
    assert message in text


def test_point_mass_and_thin_rod_are_bodies():
    for inertia in ({}, {"I_xx": 0.1, "I_yy": 0.1}):
        model = Model("m")
        model.add(
            "rod",
            RigidBody(mass=1.0, com_z=-1.0, x=False, y=False, z=False, roll=False, yaw=False, **inertia),
        )
        assert len(model.build(compiled=False).states) == 2


def test_circle_of_parents():
    def build(m):
        for name, other in (("a", "b"), ("b", "c"), ("c", "a")):
            m.add(name, Link(**GOOD))
            m.connect(f"{name}.parent", f"{other}.tip")

    assert "circle ('a' to 'b' to 'c' to 'a')" in faults(build)


def test_body_attached_to_itself():
    def build(m):
        m.add("a", Link(**GOOD))
        m.connect("a.parent", "a.tip")

    assert "circle ('a' to 'a')" in faults(build)


def test_frame_connected_to_a_flange():
    def build(m):
        m.add("body", Link(**GOOD))
        m.add("spring", Spring(stiffness=1.0))
        m.connect("spring.a", "body.tip")
        m.connect("spring.b", m.ground)

    text = faults(build)
    assert "'body.tip' is frame" in text
    assert "'spring.a' is translation" in text


def test_two_fixed_frames_joined():
    def build(m):
        m.add("a", Link(**GOOD))
        m.add("b", Link(**GOOD))
        m.connect("a.tip", "b.tip")
        m.connect("a.origin", m.ground)

    text = faults(build)
    assert "'a.tip' and 'b.tip' are joined, but each is fixed already" in text
    assert "'a.origin' and the ground" in text


def test_frames_that_nothing_fixes():
    def build(m):
        m.add("bush", FrameSpring())
        m.add("other", FrameSpring())
        m.connect("bush.a", "other.a")
        m.connect("other.b", m.ground)

    assert "frame port 'bush.b' (second frame) is not connected" in faults(build)

    def build_on(m):
        build(m)
        m.connect("bush.b", m.ground)

    assert "nothing fixes the frame at 'bush.a', 'other.a'" in faults(build_on)


def test_axis_that_does_not_exist_is_named():
    model = Model("m")
    free = model.add("free", RigidBody(**GOOD))
    with pytest.raises(AttributeError, match="RigidBody 'free' has no port or signal 'yaw_axis'"):
        _ = free.yaw_axis
    locked = model.add("locked", RigidBody(**GOOD, x=False))
    with pytest.raises(AttributeError, match="has no port or signal 'x_axis'"):
        _ = locked.x_axis


def test_two_worlds():
    def build(m):
        m.add("a", World())
        m.add("b", World())
        m.add("body", RigidBody(**GOOD))

    assert "more than one World (a, b)" in faults(build)


def test_model_of_frames_alone():
    model = Model("m")
    model.add("base", FixedFrame(x=1.0))
    model.add("bush", FrameSpring())
    model.connect("bush.a", "base.frame")
    model.connect("bush.b", model.ground)
    assert model.build(compiled=False).state_names == ()


def test_products_and_sums_drop_zeros_and_ones():
    assert times("a", "0.0") == "0.0"
    assert times("1.0", "-a", "-1.0") == "a"
    assert plus("0.0", "-a", "b") == "-a + b"
    assert dot(("a", "0.0", "1.0"), ("b", "c", "-d")) == "a * b - d"
    assert cross(("0.0", "0.0", "1.0"), ("x", "y", "z")) == ("-y", "x", "0.0")
    quarter = (("0.0", "-1.0", "0.0"), ("1.0", "0.0", "0.0"), ("0.0", "0.0", "1.0"))
    assert matmul(quarter, quarter) == (("-1.0", "0.0", "0.0"), ("0.0", "-1.0", "0.0"), ("0.0", "0.0", "1.0"))


def test_written_sums_have_the_value_of_the_numbers():
    """Signs and brackets: the text of nested products evaluates to what numpy computes."""
    rng = np.random.default_rng(3)
    names = {n: float(v) for n, v in zip("abcdefghi", rng.normal(size=9), strict=True)}
    m = (("a", "-b", "0.0"), ("c", "d", "-e"), ("1.0", "-1.0", "f"))
    v = ("g", "-h", plus("i", "-a"))
    number = np.array([[eval(t, {}, names) for t in row] for row in m])
    vector = np.array([eval(t, {}, names) for t in v])
    written = [
        eval(t, {}, names) for t in cross(v, tuple(plus(times(x, y), "-i") for x, y in zip(m[1], v, strict=True)))
    ]
    np.testing.assert_allclose(written, np.cross(vector, number[1] * vector - names["i"]), rtol=1e-12)
    squared = [[eval(t, {}, names) for t in row] for row in matmul(m, m)]
    np.testing.assert_allclose(squared, number @ number, rtol=1e-12, atol=1e-15)


class FeelsAcceleration(Component):
    """A force that depends on the acceleration of its own frame."""

    frame = Frame("where it acts")

    def equations(self):
        self.frame.fz = -2.0 * self.frame.az


def test_force_from_the_acceleration_it_causes_is_an_algebraic_loop():
    def build(m):
        m.add("body", RigidBody(**GOOD))
        m.add("odd", FeelsAcceleration())
        m.connect("odd.frame", "body.origin")

    text = faults(build)
    assert "algebraic loop" in text
    assert "odd" in text
