"""Forces of laws along a given motion: those of the closed form, and many shapes at once what each is alone."""

import numpy as np
import pytest

from discrepancy.effects.kinds import kind_named
from discrepancy.effects.law_along_motion import law_forces
from discrepancy.effects.shape_grids import MotionRange

TIME = np.linspace(0.0, 2.0, 401)
MOTION = {
    "position": 0.1 * np.sin(3.0 * TIME),
    "velocity": 0.3 * np.cos(3.0 * TIME),
    "acceleration": -0.9 * np.sin(3.0 * TIME),
}
RANGE = MotionRange(low=-0.1, high=0.1, speed=0.3, turns=False, scale=1e3)


def test_viscous_friction_and_inertia_are_the_closed_form():
    viscous = law_forces(kind_named("viscous_friction"), TIME, MOTION, [{}, {}], [{"viscous": 2.0}, {"viscous": 5.0}])
    assert viscous == pytest.approx(-np.outer([2.0, 5.0], MOTION["velocity"]))
    inertia = law_forces(kind_named("added_inertia"), TIME, MOTION, [{}], [{"inertia": 3.0}])
    assert inertia == pytest.approx(-3.0 * MOTION["acceleration"][None])


def test_dry_friction_is_its_level_against_the_motion():
    found = law_forces(kind_named("coulomb_friction"), TIME, MOTION, [{"v_s": 1e-6}], [{"coulomb": 4.0}])
    moving = np.abs(MOTION["velocity"]) > 1e-3
    assert found[0][moving] == pytest.approx(-4.0 * np.sign(MOTION["velocity"][moving]))


@pytest.mark.parametrize("name", ["coulomb_friction", "stribeck_friction", "hysteresis"])
def test_many_shapes_at_once_are_what_each_is_alone(name):
    """A hysteresis has a state of its own: its force is integrated."""
    kind = kind_named(name)
    shapes = kind.shape_grid(RANGE)
    strengths = [dict.fromkeys(kind.strengths, 1.0 + k) for k in range(len(shapes))]
    together = law_forces(kind, TIME, MOTION, shapes, strengths)
    alone = [law_forces(kind, TIME, MOTION, [s], [z])[0] for s, z in zip(shapes, strengths, strict=True)]
    assert len(shapes) > 1
    assert np.array_equal(together, alone)
    assert not np.allclose(together[0] / 1.0, together[-1] / len(shapes))
