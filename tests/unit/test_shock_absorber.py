"""What a spring with a damper beside it can hide: damping of two kinds, and a spring that bends about some centre."""

from __future__ import annotations

from discrepancy.effects.catalogue import catalogue
from discrepancy.effects.effect import Effect
from discrepancy.effects.kinds import kind_named
from discrepancy.effects.shape_grids import MotionRange
from multibody import Model
from multibody.library import Mass, PositionSource, SpringDamper


def strut() -> Model:
    """A body on a strut over a road."""
    model = Model("strut")
    road, body = model.add("road", PositionSource()), model.add("body", Mass(m=300.0))
    leg = model.add("strut", SpringDamper(stiffness=1.8e4, damping=1400.0))
    model.connect(road.flange, leg.a)
    model.connect(leg.b, body.flange)
    for name in ("position", "velocity", "acceleration"):
        model.input(f"road.{name}", f"road.{name}")
    return model


def test_damping_that_differs_with_direction_and_drag_are_looked_for():
    system = strut().build()
    found = {e.kind.name for e in catalogue(system, ("body.position",), ()) if e.where == "strut"}
    assert {"asymmetric_viscous_friction", "quadratic_drag", "extra_damping", "cubic_stiffness"} <= found
    # the same law as extra_damping
    assert "viscous_friction" not in found


def test_the_centre_of_a_spring_that_hardens_is_fitted():
    place = next(p for p in strut().places() if p.name == "strut")
    effect = Effect.at_place("cubic_stiffness", place, strengths={"stiffness": 6e6}, shape={"centre": 0.002})
    moved = {q.name.rpartition(".")[2]: q for q in effect.uncertain({"centre": 0.03})}
    assert (moved["centre"].value, moved["centre"].min, moved["centre"].max) == (0.002, 0.002 - 0.03, 0.002 + 0.03)
    shapes = kind_named("cubic_stiffness").shapes
    assert shapes(MotionRange(low=-0.01, high=0.05, speed=1.0, scale=1.8e4)) == [{"centre": 0.0}, {"centre": 0.02}]
    assert shapes(MotionRange(low=-0.01, high=0.05, speed=1.0)) == [{"centre": 0.02}]
