"""Signatures and docstrings of components agree with what their constructors accept."""

from __future__ import annotations

import importlib
import inspect
import itertools
import re

import pytest

from multibody import Component, Frame, Option, Parameter, Rotation, State, Table, Unit
from multibody.declare.rigid_body import RigidBody
from multibody.declare.signature import RequiredWhere, written_docstring

MODULES = (
    "multibody.library",
    "multibody.library.spatial",
    "vtsdt.parts.car",
    "vtsdt.parts.control",
    "vtsdt.parts.guide",
    "vtsdt.parts.machine",
    "vtsdt.parts.rope",
    "gearbox.parts.bearings",
    "gearbox.parts.mesh",
    "gearbox.parts.shafts",
    "discrepancy.effects.laws",
    "discrepancy.effects.sensor_errors",
)
CLASSES = {
    cls
    for module in map(importlib.import_module, MODULES)
    for cls in vars(module).values()
    if isinstance(cls, type) and issubclass(cls, Component) and cls is not Component
}


def name_of(cls: type[Component]) -> str:
    return f"{cls.__module__}.{cls.__name__}"


def value_for(name, cls):
    """Return a value of the right kind for an argument."""
    item = cls.declarations.get(name)
    if isinstance(item, Table):
        return ((0.0, 1.0), (0.0, 1.0))
    if isinstance(item, Option | Unit):
        return item.default
    if isinstance(item, Parameter):
        return item.default if item.default is not None else max(item.min or 0.0, min(1.0, item.max or 1.0))
    return 0.0


def choices_of(option):
    if isinstance(option.default, bool):
        return (True, False)
    return option.choices or (option.default, *range(1, 4))


def structures(cls):
    """Return choices of the options: all together, or one changed at a time where that would be too many."""
    options = {n: choices_of(d) for n, d in cls.declarations.items() if isinstance(d, Option)}
    every = 1
    for choices in options.values():
        every *= len(choices)
    if every <= 256:
        return [dict(zip(options, chosen, strict=True)) for chosen in itertools.product(*options.values())]
    return [{n: choice} for n, choices in options.items() for choice in choices]


def refused_in(component):
    return set(re.findall(r"has no parameter '(\w+)'", "\n".join(component.faults)))


def missing_in(component):
    return set(re.findall(r"'(\w+)' \(.*\) is required", "\n".join(component.faults)))


@pytest.mark.parametrize("cls", sorted(CLASSES, key=name_of), ids=name_of)
def test_signature_is_what_the_constructor_accepts(cls):
    parameters = inspect.signature(cls).parameters
    assert {p.kind for p in parameters.values()} <= {inspect.Parameter.KEYWORD_ONLY}
    given = {name: value_for(name, cls) for name in parameters}
    accepted, wanted = set(), {}
    for structure in structures(cls):
        accepted |= given.keys() - refused_in(cls(**{**given, **structure}))
        for name in missing_in(cls(**structure)):
            wanted.setdefault(name, []).append(structure)
    assert accepted == set(parameters)
    required = {n for n, p in parameters.items() if p.default is p.empty}
    conditional = {n for n, p in parameters.items() if isinstance(p.default, RequiredWhere)}
    assert set(wanted) == required | conditional
    assert required == {n for n, where in wanted.items() if len(where) == len(structures(cls))}
    # the declarations name nothing that the signature leaves out
    declared = {n for n, d in cls.declarations.items() if isinstance(d, Parameter | Table | Option | Unit | State)}
    assert declared <= set(parameters)


@pytest.mark.parametrize("cls", sorted(CLASSES, key=name_of), ids=name_of)
def test_defaults_in_the_signature_are_those_of_the_component(cls):
    parameters = inspect.signature(cls).parameters
    component = cls(**{n: value_for(n, cls) for n, p in parameters.items() if p.default is p.empty})
    for kind in (component.values, component.starts, component.options, component.units):
        for name, value in kind.items():
            if parameters[name].default is not inspect.Parameter.empty:
                assert value == parameters[name].default, name


@pytest.mark.parametrize("cls", sorted(CLASSES, key=name_of), ids=name_of)
def test_docstring_lists_every_argument_once(cls):
    text = inspect.getdoc(cls)
    assert text.startswith(inspect.cleandoc(written_docstring(cls)).splitlines()[0])
    section = text.partition("\nParameters\n----------\n")[2].partition("\n\n")[0]
    listed = re.findall(r"^(\w+) : ", section, re.MULTILINE)
    assert listed == list(inspect.signature(cls).parameters)


def test_a_class_of_a_users_own_constructor_keeps_its_arguments():
    class Fan(Component):
        """A fan.

        Examples
        --------
        >>> Fan(3, drag=2.0)
        """

        drag = Parameter(None, "N*m*s", "drag", max=5.0)
        noisy = Option(False, "whether it hums")
        J = Parameter(1.0, "kg*m**2", "inertia", when="noisy")
        axis = Rotation("shaft", inertia="J")

        def __init__(self, blades, **given):
            super().__init__(**given)
            self.blades = blades

    assert str(inspect.signature(Fan)) == "(blades, *, drag, noisy=False, J=1.0, angle=0.0, speed=0.0)"
    assert inspect.getdoc(Fan).splitlines() == [
        "A fan.",
        "",
        "Parameters",
        "----------",
        "drag : float, N*m*s",
        "    drag, at most 5.",
        "noisy : bool, default False",
        "    whether it hums.",
        "J : float, kg*m**2, default 1, where noisy",
        "    inertia.",
        "angle : float, rad, default 0",
        "    angle at the start.",
        "speed : float, rad/s, default 0",
        "    speed at the start.",
        "",
        "Attributes",
        "----------",
        "axis : rotation port",
        "    shaft.",
        "",
        "Examples",
        "--------",
        ">>> Fan(3, drag=2.0)",
    ]


def test_a_subclass_without_docstring_has_its_parents_and_its_own_arguments():
    class Trolley(RigidBody):
        hitch = Frame("hitch", offset=(0.0, 0.0, 0.5))

    text = inspect.getdoc(Trolley)
    assert text.startswith("A rigid body with six Boolean degrees of freedom")
    assert "hitch_z : float, m, default 0.5" in text
    assert text.count("\nParameters\n") == 1
