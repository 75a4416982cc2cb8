"""All faults of a model are reported together, with the part and the remedy."""

from __future__ import annotations

import math
import textwrap

import pytest

from multibody import (
    Component,
    EquationError,
    Input,
    Model,
    ModelError,
    Option,
    Output,
    Parameter,
    Pin,
    Power,
    Rotation,
    State,
    Table,
    Translation,
    Unknown,
)
from multibody.library import Damper, ForceSource, Mass, Spring


class Rotor(Component):
    J = Parameter(1.0, "kg*m**2", "inertia", min=0.0)
    free = Option(True, "False holds it")
    flange = Rotation("shaft", inertia="J")


class Turned(Component):
    """Gives its flange an angle."""

    angle = Input("rad", "angle", default=0.0)
    flange = Rotation("shaft", prescribed=True)

    def equations(self):
        self.flange.angle = self.angle
        self.flange.speed = 0.0
        self.flange.acceleration = 0.0


class Ratio(Component):
    ratio = Parameter(2.0, "", "turns of a for one of b")
    a = Rotation("fast side")
    b = Rotation("slow side")

    def coupling(self):
        self.b.angle = self.a.angle / self.ratio

    def coupling_inverse(self):
        self.a.angle = self.b.angle * self.ratio


class Gain(Component):
    factor = Parameter(1.0, "", "factor")
    u = Input("m", "input")
    y = Output("m", "output")

    def equations(self):
        self.y = self.factor * self.u


class Watch(Component):
    """Shows the position of a flange."""

    flange = Translation("watched")
    position = Output("m", "position")

    def equations(self):
        self.position = self.flange.position


class Resistor(Component):
    R = Parameter(1.0, "ohm", "resistance", min=1e-9)
    p = Pin("positive")
    n = Pin("negative")

    def equations(self):
        current = (self.p.voltage - self.n.voltage) / self.R
        self.p.current = current
        self.n.current = -current


class CurrentSource(Component):
    amperes = Parameter(1.0, "A", "current")
    p = Pin("positive")
    n = Pin("negative")

    def equations(self):
        self.p.current = -self.amperes
        self.n.current = self.amperes


class VoltageSource(Component):
    volts = Parameter(1.0, "V", "voltage")
    p = Pin("positive", prescribed=True)
    n = Pin("negative")

    def equations(self):
        self.p.voltage = self.n.voltage + self.volts
        self.n.current = -self.p.reaction


class Curve(Component):
    curve = Table("m", "N", "force over position", default=([0.0, 1.0], [0.0, 1.0]))
    flange = Translation("where it acts")

    def equations(self):
        self.flange.force = self.curve(self.flange.position)


def faults(model: Model) -> list[str]:
    with pytest.raises(ModelError) as caught:
        model.build()
    assert all(fault in str(caught.value) for fault in caught.value.faults)
    return list(caught.value.faults)


def only(model: Model, *words: str) -> None:
    """Assert that the model has one fault, whose sentence has all the words."""
    reported = faults(model)
    assert len(reported) == 1, reported
    for word in words:
        assert word in reported[0]


def oscillator() -> Model:
    model = Model("m")
    body, spring = model.add("body", Mass(m=1.0)), model.add("spring", Spring(stiffness=1.0))
    model.connect(spring.a, model.ground)
    model.connect(spring.b, body.flange)
    return model


def rotors(*parts: tuple[str, Component]) -> Model:
    model = Model("m")
    for name, part in parts:
        model.add(name, part)
    return model


def with_part(component: Component, *ports: str) -> Model:
    """Return the oscillator with a part added whose ports are joined to the body."""
    model = oscillator()
    model.add("part", component)
    for port in ports:
        model.connect(f"part.{port}", "body.flange")
    return model


# ------------------------------------------------------------------ the graph


def test_empty_model():
    only(Model("m"), "no components", "model.add(")


def test_unconnected_port():
    model = oscillator()
    damper = model.add("damper", Damper(damping=1.0))
    model.connect(damper.a, model.ground)
    only(model, "translation port 'damper.b'", "not connected", "ground")


def test_missing_input_names_the_declaration_that_would_help():
    only(
        with_part(ForceSource(), "flange"),
        "input 'part.force' (force on the flange, N) has no source",
        "model.input(",
    )


def test_name_used_twice():
    model = oscillator()
    model.add("body", Mass())
    only(model, "'body' is used twice")


@pytest.mark.parametrize("name", ["2nd", "a b", "a__b", "end_", "_hidden", "a..b", ""])
def test_bad_component_name(name):
    model = oscillator()
    model.add(name, Mass())
    only(model, f"'{name}' cannot be the name of a component", "use")


@pytest.mark.parametrize("name", ["ground", "energy", "input.x", "probe"])
def test_names_that_the_model_uses_itself(name):
    model = oscillator()
    model.add(name, Mass())
    only(model, f"component '{name}'", "rename")


def test_component_that_has_the_name_of_a_port_of_another():
    model = oscillator()
    model.add("body.flange", Mass())
    only(model, "component 'body.flange'", "'flange' of component 'body'", "rename")


def test_bad_input_name():
    model = with_part(ForceSource(), "flange")
    model.input("force [N]", "part.force")
    only(model, "'force [N]' cannot be the name of a model input")


def test_unknown_component_and_port_with_nearest_name():
    model = oscillator()
    model.connect("sprin.a", "body.flange")
    model.connect("spring.b", "body.flnge")
    assert [
        "no component for 'sprin.a'; did you mean 'spring'?" in faults(model)[0],
        "did you mean 'flange'?" in faults(model)[1],
    ] == [True, True]


def test_attribute_of_a_part_with_nearest_name():
    with pytest.raises(AttributeError, match=r"Mass 'body' has no port or signal 'flage'; did you mean 'flange'\?"):
        _ = oscillator().part("body").flage
    with pytest.raises(KeyError, match="did you mean 'body'"):
        oscillator().part("boddy")


def test_connection_to_itself():
    model = oscillator()
    model.connect("body.flange", "body.flange")
    only(model, "needs two different endpoints")


def test_different_domains_joined():
    model = oscillator()
    model.add("rotor", Rotor())
    model.connect("rotor.flange", "body.flange")
    only(model, "'rotor.flange' is rotation", "'body.flange' is translation", "converting part")


def test_port_joined_to_signal():
    model = with_part(Watch(), "flange")
    model.connect("part.position", "body.flange")
    only(model, "mixes ports and signals", "sensor")


def test_two_outputs_joined():
    model = with_part(Watch(), "flange")
    model.connect("part.position", "spring.tension")
    only(model, "2 outputs", "exactly one output")


def test_inputs_joined_without_an_output():
    model = oscillator()
    for name in ("one", "two"):
        model.add(name, Gain())
    model.input("x", "one.u")
    model.input("y", "two.u")
    model.connect("one.u", "two.u")
    only(model, "no output", "exactly one output")


def test_input_with_two_sources():
    model = with_part(Watch(), "flange")
    model.add("gain", Gain())
    model.connect("part.position", "gain.u")
    model.input("x", "gain.u")
    only(model, "input 'gain.u' has two sources", "part.position", "x")


def test_output_whose_unit_differs_from_the_input():
    model = oscillator()
    model.add("gain", Gain())
    model.connect("spring.tension", "gain.u")
    only(model, "'spring.tension' is in N but 'gain.u' takes m")


def test_model_input_of_different_units_or_feeding_nothing():
    model = with_part(ForceSource(), "flange")
    model.add("gain", Gain())
    model.input("both", "part.force", "gain.u")
    model.input("none")
    model.input("wrong", "part.forse")
    message = "\n".join(faults(model))
    assert "model input 'both' feeds inputs of different units (N and m at 'gain.u')" in message
    assert "model input 'none' feeds nothing" in message
    assert "'part.forse' is not an input of a component; did you mean 'part.force'?" in message


def test_model_input_and_output_declared_twice():
    model = with_part(ForceSource(), "flange")
    for _ in range(2):
        model.input("x", "part.force")
        model.output("y", "body.position")
    assert {"the model input 'x' is declared twice", "the model output 'y' is declared twice"} <= set(faults(model))


def test_model_output_that_does_not_exist():
    model = oscillator()
    model.output("y", "spring.tensoin")
    only(model, "model output 'y'", "no quantity 'spring.tensoin'", "did you mean 'spring.tension'?")


def test_outputs_asked_for_that_do_not_exist():
    with pytest.raises(ModelError, match=r"no output 'spring.tensoin'; did you mean 'spring.tension'\?"):
        oscillator().build(outputs=["spring.tensoin"])


def test_not_a_component():
    model = oscillator()
    model.add("text", "Mass")
    model.add("kind", Mass)
    reported = faults(model)
    assert "'text' is a str, not a component" in reported[0]
    assert "'kind' is the class Mass, not a component: add an instance" in reported[1]


def test_init_that_forgets_its_base():
    class Forgetful(Component):
        def __init__(self):
            pass

    model = oscillator()
    model.add("part", Forgetful())
    only(model, "component 'part'", "super().__init__")


# ------------------------------------------------------------------ values


@pytest.mark.parametrize(
    ("component", "words"),
    [
        (lambda: Mass(m="3 kgg"), ("'m'", "unknown unit 'kgg'", "write it as")),
        (lambda: Mass(m="3 m"), ("'m'", "'m' cannot be converted to 'kg'")),
        (lambda: Mass(m="heavy"), ("'heavy' is not a number with a unit",)),
        (lambda: Mass(m=[1.0, 2.0]), ("'m'", "number")),
        (lambda: Mass(m=None), ("'m' (mass, kg) is required",)),
        (lambda: Mass(m=-1.0), ("'m' is -1 kg, below its least value 0",)),
        (lambda: Mass(m=math.nan), ("'m' is nan", "finite")),
        (lambda: Mass(m=math.inf), ("'m' is inf", "finite")),
        (lambda: Mass(mass=1.0), ("Mass has no parameter 'mass'",)),
        (lambda: Mass(postion=1.0), ("did you mean 'position'?",)),
        (lambda: Mass(position="2 s"), ("start value 'position'", "'s' cannot be converted to 'm'")),
        (lambda: Mass(free="yes"), ("option 'free' is 'yes'", "True, False")),
        (lambda: Spring(), ("'stiffness' (force per length, N/m) is required",)),
        (lambda: Curve(curve=([0.0, 1.0], [0.0])), ("table 'curve'", "as many x as y")),
        (lambda: Curve(curve=([1.0, 0.0], [0.0, 1.0])), ("table 'curve'", "x must increase", "point 1")),
        (lambda: Curve(curve=([0.0, 1.0], [0.0, math.nan])), ("table 'curve'", "not finite")),
        (lambda: Curve(curve=3.0), ("table 'curve'", "two sequences")),
        (lambda: Curve(curve=([0.0], [0.0])), ("table 'curve'", "at least two points")),
    ],
)
def test_value_at_fault_names_the_component_and_the_parameter(component, words):
    part = component()
    model = oscillator()
    model.add("part", part)
    for port in part.of_kind(Translation):
        model.connect(f"part.{port}", "body.flange" if port in ("flange", "a") else model.ground)
    only(model, "component 'part'", *words)


def test_all_faults_at_once():
    model = oscillator()
    model.add("heavy", Mass(m=-1.0, position="1 s", colour="red"))
    model.add("rope", Spring())
    model.connect("heavy.flange", "rope.c")
    model.add("broken", HalfAssigned())
    model.connect("broken.flange", "heavy.flange")
    message = "\n".join(faults(model))
    for words in (
        "below its least value",
        "start value 'position'",
        "'colour'",
        "'stiffness'",
        "'c'",
        "rope.a",
        "rope.b",
        "one branch only",
    ):
        assert words in message


def test_values_replaced_by_name_are_checked():
    with pytest.raises(ModelError, match=r"no parameter 'body.mass'"):
        oscillator().with_values({"body.mass": 1.0})
    with pytest.raises(ModelError, match="below its least value"):
        oscillator().with_values({"body.m": -1.0}).build()


# ------------------------------------------------------------------ degrees of freedom


def test_ground_and_prescribed():
    model = rotors(("drive", Turned()))
    model.connect("drive.flange", model.ground)
    only(model, "over-constrained", "'drive.flange' prescribes it", "connected to the ground", "keep one")


def test_two_locks_on_one_node():
    model = rotors(("one", Rotor(free=False)), ("two", Rotor(free=False)))
    model.connect("one.flange", "two.flange")
    only(model, "over-constrained", "'one.flange' is locked", "'two.flange' is locked")


def test_both_sides_of_a_gear_held():
    model = rotors(("gear", Ratio()), ("drive", Turned()))
    model.connect("gear.a", model.ground)
    model.connect("gear.b", "drive.flange")
    only(model, "over-constrained", "'gear' ties", "spring into the loop")


def test_loop_of_gears():
    model = rotors(("rotor", Rotor()), ("other", Rotor()), ("one", Ratio()), ("two", Ratio(ratio=3.0)))
    for gear in ("one", "two"):
        model.connect(f"{gear}.a", "rotor.flange")
        model.connect(f"{gear}.b", "other.flange")
    only(model, "over-constrained", "'two' ties")


def test_three_gears_in_a_ring():
    model = rotors(*((f"g{k}", Ratio()) for k in range(3)), *((f"r{k}", Rotor()) for k in range(3)))
    for k in range(3):
        model.connect(f"g{k}.a", f"r{k}.flange")
        model.connect(f"g{k}.b", f"r{(k + 1) % 3}.flange")
    only(model, "over-constrained", "'g2' ties")


def test_two_voltages_on_one_node():
    model = rotors(("one", VoltageSource()), ("two", VoltageSource()))
    model.connect("one.p", "two.p")
    model.connect("one.n", "two.n", model.ground)
    only(model, "over-constrained: the voltage", "'one.p'", "'two.p'")


def test_node_without_mass_or_damping():
    model = oscillator()
    rope = model.add("rope", Spring(stiffness=1.0))
    end = model.add("end", Spring(stiffness=1.0))
    model.connect(rope.a, "body.flange")
    model.connect(rope.b, end.a)
    model.connect(end.b, model.ground)
    only(model, "node at 'rope.b' has neither mass nor damping", "add a Mass")


def test_voltage_that_nothing_sets():
    model = rotors(("source", CurrentSource()), ("other", CurrentSource()))
    model.connect("source.p", "other.p")
    model.connect("source.n", "other.n", model.ground)
    only(model, "nothing sets the voltage at 'source.p", "resistor, a source or the ground")


def test_circuit_without_ground():
    model = rotors(("source", VoltageSource()), ("load", Resistor()))
    model.connect("source.p", "load.p")
    model.connect("source.n", "load.n")
    only(model, "no pin of this circuit is connected to the ground", "source.n")


def test_damper_between_two_nodes_without_mass():
    """Springs on both sides of a damper: the forces do not determine the speeds of its ends."""
    model = rotors(("one", Spring(stiffness=1.0)), ("damper", Damper(damping=1.0)), ("two", Spring(stiffness=2.0)))
    model.connect("one.a", model.ground)
    model.connect("one.b", "damper.a")
    model.connect("damper.b", "two.a")
    model.connect("two.b", model.ground)
    only(model, "one.b", "damper.b", "add a mass")


# ------------------------------------------------------------------ equations that do not fit together


def test_algebraic_loop_names_all_its_parts():
    model = Model("m")
    for k in range(3):
        model.add(f"gain{k}", Gain())
    for k in range(3):
        model.connect(f"gain{k}.y", f"gain{(k + 1) % 3}.u")
    only(
        model,
        "algebraic loop",
        "gain0 (Gain, ",
        "gain1 (Gain, ",
        "gain2 (Gain, ",
        "test_model_faults.py:",
        "break it",
    )


class NoOutput(Component):
    y = Output("m", "never assigned")


class NoRate(Component):
    s = State("m", "never integrated")
    y = Output("m", "s")

    def equations(self):
        self.y = self.s


class NoResidual(Component):
    z = Unknown("m", "never determined")


class HalfAssigned(Component):
    flange = Translation("shaft")
    power = Power()

    def equations(self):
        if self.flange.velocity > 0.0:
            self.flange.force = -1.0
        self.power = 0.0


class HalfLocal(Component):
    flange = Translation("shaft")

    def equations(self):
        if self.flange.velocity > 0.0:
            side = 1.0
        self.flange.force = -side


class BeforeValue(Component):
    flange = Translation("shaft")

    def equations(self):
        total = total + self.flange.velocity  # noqa: F821
        self.flange.force = -total


class TakesTime(Component):
    flange = Translation("shaft")

    def equations(self, t):
        self.flange.force = -t


class ReadsNothing(Component):
    """Reads its own flow, which nobody assigns."""

    flange = Translation("shaft")
    y = Output("N", "force")

    def equations(self):
        self.y = self.flange.force


class ReadsReaction(Component):
    flange = Translation("shaft")
    y = Output("N", "force")

    def equations(self):
        self.y = self.flange.reaction


@pytest.mark.parametrize(
    ("component", "words"),
    [
        (NoOutput, ("component 'part' (NoOutput): output 'y' has no equation", "assign self.y")),
        (NoRate, ("state 's' has no rate", "assign self.der.s")),
        (NoResidual, ("unknown 'z'", "assign self.zero.z")),
        (
            HalfAssigned,
            (
                "part (HalfAssigned, test_model_faults.py:",
                "'self.flange.force' is assigned in one branch only",
            ),
        ),
        (HalfLocal, ("'side' is assigned in one branch only", "every branch")),
        (BeforeValue, ("'total' is used before it has a value", "give it one in a line above")),
        (TakesTime, ("part (TakesTime, test_model_faults.py:", "'equations' must take self and nothing else")),
        (ReadsNothing, ("nothing determines 'part.flange.force'", "part (ReadsNothing")),
        (ReadsReaction, ("nothing determines", "reaction")),
    ],
)
def test_equations_that_leave_something_open(component, words):
    part = component()
    only(with_part(part, *part.of_kind(Translation)), *words)


def test_acceleration_where_nothing_has_mass():
    class Reads(Component):
        flange = Translation("end")
        y = Output("m/s**2", "acceleration")

        def equations(self):
            self.y = self.flange.acceleration

    model = rotors(("damper", Damper(damping=1.0)), ("spring", Spring(stiffness=1.0)), ("part", Reads()))
    model.connect("damper.a", "spring.a", model.ground)
    model.connect("damper.b", "spring.b", "part.flange")
    only(model, "nothing determines", "acceleration", "add a Mass")


def test_functions_that_call_each_other_in_a_circle():
    only(with_part(Circular(), "flange"), "may not call each other in a circle", "ping", "pong")


def ping(x):
    return pong(x)


def pong(x):
    return ping(x)


class Circular(Component):
    flange = Translation("shaft")

    def equations(self):
        self.flange.force = ping(self.flange.position)


# ------------------------------------------------------------------ declarations


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({"m": Parameter(1.0, "kgg", "mass")}, ("Parameter 'm'", "unknown unit 'kgg'")),
        ({"m": Parameter(1.0, "mm", "gap")}, ("Parameter 'm'", "'mm' is not SI")),
        ({"m": Parameter("1", "kg", "mass")}, ("default is '1', not a number",)),
        ({"m": Parameter(1.0, "kg", "mass", min=2.0, max=0.0)}, ("min 2 is above max 0",)),
        ({"copy": Parameter(1.0, "kg", "mass")}, ("'copy' is reserved", "another name")),
        ({"time": Parameter(1.0, "s", "time")}, ("'time' is reserved",)),
        ({"a__b": Parameter(1.0, "s", "time")}, ("'a__b' cannot be the name of a Parameter",)),
        ({"lambda_": Parameter(1.0, "s", "time")}, ("'lambda_' cannot be the name",)),
        ({"c": Table("m", "N", "curve", "spline", ([0, 1], [0, 1]))}, ("interpolation 'spline' is unknown",)),
        ({"p": Power(kind="heat")}, ("kind 'heat' is unknown",)),
        (
            {"f": Translation("f", inertia="mas"), "mass": Parameter(1.0, "kg", "m")},
            ("inertia='mas'", "'mass'?"),
        ),
        (
            {"f": Translation("f", inertia="J"), "J": Parameter(1.0, "kg*m**2", "J")},
            ("'J' is in kg*m**2", "in kg"),
        ),
        (
            {"f": Translation("f", inertia="m"), "m": Parameter(1.0, "kg", "m"), "position": State("m", "p")},
            ("State 'position' has the name of a quantity", "rename"),
        ),
        ({"features": {"gap": "speed"}}, ("features: 'gap' is no parameter",)),
    ],
)
def test_declaration_at_fault(body, words):
    cls = type("Made", (Component,), body)
    model = oscillator()
    model.add("part", cls())
    message = "\n".join(faults(model))
    assert "component 'part' (Made)" in message
    for word in words:
        assert word in message


def test_correct_declarations_need_no_unit_library():
    """Reading units costs a quarter of a second at import; a plain model must not pay for it."""
    import subprocess
    import sys

    code = textwrap.dedent("""
        import sys
        from multibody import Model
        from multibody.library import Mass, Spring
        model = Model("m")
        body, spring = model.add("body", Mass(m=1.0)), model.add("spring", Spring(stiffness=1.0))
        model.connect(spring.a, model.ground)
        model.connect(spring.b, body.flange)
        model.build()
        print("pint" in sys.modules)
    """)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_equation_error_is_a_value_error():
    assert issubclass(EquationError, ValueError)
