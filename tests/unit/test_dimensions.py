"""Dimensions in equations: what is wrong is told with file and line, and every part that ships is right."""

from __future__ import annotations

import importlib
import itertools
import math
import pkgutil
from collections.abc import Iterator

import pytest

import discrepancy.effects
import discrepancy.rigs
import gearbox.parts
import multibody.library
import vtsdt.parts
import vtsdt.rig
from multibody import Component, Input, Model, Output, Parameter, State, Translation
from multibody.assembly.dimensions import component_dimension_faults
from multibody.declare.declarations import Option, Table

ROOMS = (discrepancy.effects, discrepancy.rigs, gearbox.parts, multibody.library, vtsdt.parts, vtsdt.rig)

for _room in ROOMS:
    for _file in pkgutil.iter_modules(_room.__path__, f"{_room.__name__}."):
        importlib.import_module(_file.name)


def shipped(cls: type = Component) -> Iterator[type]:
    for below in cls.__subclasses__():
        if below.__module__.startswith(tuple(f"{room.__name__}." for room in ROOMS)):
            yield below
        yield from shipped(below)


PARTS = sorted(set(shipped()), key=lambda cls: (cls.__module__, cls.__qualname__))


def with_each_option(cls: type) -> Iterator[Component]:
    """Every choice of a class's options, one component each; at most 64 of a class."""
    options = [(name, o) for name, o in cls.declarations.items() if isinstance(o, Option)]
    values = [o.choices or ((True, False) if isinstance(o.default, bool) else (o.default,)) for _, o in options]
    for chosen in itertools.islice(itertools.product(*values), 64):
        yield cls(**dict(zip((name for name, _ in options), chosen, strict=True)))


@pytest.mark.parametrize("cls", PARTS, ids=lambda cls: f"{cls.__module__}.{cls.__qualname__}")
def test_what_ships_has_no_fault(cls):
    for part in with_each_option(cls):
        if not part.only_python:
            assert component_dimension_faults("part", part) == ()


def test_the_parts_that_ship_are_seen():
    names = {cls.__name__ for cls in PARTS}
    assert {"SpringDamper", "GuidingSystem", "HelicalMesh", "CoulombEffect", "Tank"} <= names


def sluggish(v, level):
    """Return something that adds a speed to a level."""
    return math.tanh(v) * level + v


class Wrong(Component):
    """A part whose lines are wrong one by one, each in its own way."""

    stiffness = Parameter(1.0, "N/m", "of the spring")
    damping = Parameter(1.0, "N*s/m", "of the damper")
    mass = Parameter(1.0, "kg", "of the body")
    curve = Table("m/s", "N", "force over speed", default=((0.0, 1.0), (0.0, 1.0)))
    command = Input("V", "what is asked", default=0.0)
    a = Translation("end")
    way = State("m", "that was covered")
    force = Output("N", "on the end")
    energy = Output("J", "in the spring")
    pull = Output("N", "by a function")
    drag = Output("N", "by a table")
    ripple = Output("", "along the way")
    larger = Output("N", "of two")
    power = Output("W", "by a root")

    def equations(self):
        x = self.a.position
        v = self.a.velocity
        self.force = self.damping * x
        self.a.force = self.stiffness * x + self.mass * v
        self.der.way = self.a.acceleration
        self.energy = 0.5 * self.stiffness * x**2
        self.pull = sluggish(v, self.force)
        self.drag = self.curve(x)
        self.ripple = math.sin(x)
        self.larger = max(self.force, self.command)
        self.power = self.force * math.sqrt(self.stiffness / self.mass)


FOUND = [
    "'part.force' is in kg*m/s**2, and 'part.damping * x' is in kg*m/s",
    "'part.stiffness * x' is in kg*m/s**2, and 'part.mass * v' is in kg*m/s",
    "'part.der.way' is in m/s, and 'part.a.acceleration' is in m/s**2",
    "in sluggish: the argument of tanh has to be a plain number, and 'v' is in m/s",
    "in sluggish: 'math.tanh(v) * level' is in kg*m/s**2, and 'v' is in m/s",
    "table 'curve' is over m/s, and 'x' is in m",
    "the argument of sin has to be a plain number, and 'x' is in m",
    "'part.force' is in kg*m/s**2, and 'part.command' is in kg*m**2/(s**3*A)",
    "'part.power' is in kg*m**2/s**3, and 'part.force * math.sqrt(part.stiffness / part.mass)' is in kg*m/s**3",
]


def test_each_wrong_line_is_told_once_with_its_place():
    faults = component_dimension_faults("part", Wrong())
    first = Wrong.equations.__code__.co_firstlineno
    lines = [int(fault.partition("test_dimensions.py:")[2].partition(")")[0]) - first for fault in faults]
    assert sorted(lines) == [3, 4, 5, 7, 7, 8, 9, 10, 11]
    for words in FOUND:
        assert sum(words in fault for fault in faults) == 1, (words, faults)


class Right(Component):
    """What may look wrong and is not."""

    mass = Parameter(1.0, "kg", "of the body")
    level = Parameter(1.0, "N", "of friction")
    exponent = Parameter(1.5, "", "of a law")
    a = Translation("end")
    weight = Output("N", "of the body")
    ratio = Output("", "of the speed to 1 mm/s")
    angle = Output("rad", "that a way covers on a radius of 1 m, as a plain number")

    def equations(self):
        self.a.force = self.weight + self.level * self.ratio**self.exponent - 9.81 * self.mass
        self.weight = 9.81 * self.mass  # below what it is used by
        self.ratio = self.a.velocity / 1e-3
        self.angle = math.atan2(self.a.position, self.a.position + 1e-12) + 1.0


def test_what_may_carry_a_unit_is_left_open():
    assert component_dimension_faults("part", Right()) == ()


def test_a_model_tells_each_class_once_and_still_builds():
    model = Model("two")
    for name in ("first", "second"):
        part = model.add(name, Wrong())
        model.connect(part.a, model.ground)
    faults = model.dimension_faults()
    assert len(faults) == len(FOUND)
    assert all(fault.startswith("first (Wrong, test_dimensions.py:") for fault in faults)
    assert "first.force" in model.build(compiled=False).output_names
