"""Models in files: the same equations come back, and every broken file has its message."""

from __future__ import annotations

import json
import subprocess
import sys
import textwrap

import numpy as np
import pytest

from multibody import Component, Model, ModelError, Option, Output, Parameter, Table, Translation
from multibody.library import Damper, ForceSource, Mass, Spring
from multibody.model.storage import save


class Curve(Component):
    """A user's own component, in this file."""

    gain = Parameter(1.0, "", "factor")
    kind = Option("soft", "law", choices=("soft", "hard"))
    curve = Table("m", "N", "force", "cubic", ([-1.0, 0.0, 1.0], [-1.0, 0.0, 3.0]))
    flange = Translation("where it acts")
    y = Output("N", "force")

    def equations(self):
        self.y = bent(self.curve(self.flange.position), self.gain) if self.kind == "soft" else self.gain
        self.flange.force = -self.y


def bent(x, gain):
    return gain * x * abs(x)


def machine() -> Model:
    model = Model("axis")
    body = model.add("axis.body", Mass(m="1500 g", position=0.1 + 0.2, velocity=-1 / 3))
    spring, damper = model.add("spring", Spring(stiffness=1e5 / 3)), model.add("damper", Damper(damping=0.1))
    curve = model.add("curve", Curve(gain=0.7, kind="soft", curve=([-0.5, 0.1, 0.9], [-2.0, 0.3, 1.1])))
    push = model.add("push", ForceSource())
    model.connect(spring.a, damper.a, model.ground)
    model.connect(spring.b, damper.b, body.flange, curve.flange, push.flange)
    model.input("force", push.force, default=2.0)
    model.output("tension", spring.tension)
    return model.with_input_error("force", gain=0.01, delay=0.002)


def test_round_trip_gives_identical_equations(tmp_path):
    first = machine()
    path = first.save(tmp_path / "axis.json")
    second = Model.load(path)
    assert second.name == "axis"
    a, b = first.build(compiled=False), second.build(compiled=False)
    assert a.texts == b.texts
    for kind in ("states", "inputs", "parameters", "outputs"):
        assert getattr(a, kind) == getattr(b, kind)  # units, meanings, bounds and values, to the last bit
    assert second.connections == first.connections
    assert second.inputs == first.inputs
    # a second writing is the same file
    assert second.save(tmp_path / "again.json").read_text() == path.read_text()


def test_file_has_names_and_no_code(tmp_path):
    content = json.loads(save(machine(), tmp_path / "axis.json").read_text())
    assert content["schema"] == 1
    assert content["components"]["spring"]["class"] == "multibody.library.translation:Spring"
    assert content["components"]["curve"]["class"].endswith("test_storage.py:Curve")
    assert not content["components"]["curve"]["class"].startswith("/")
    assert content["components"]["axis.body"]["values"] == {"m": 1.5}
    assert content["components"]["axis.body"]["starts"] == {"position": 0.1 + 0.2, "velocity": -1 / 3}


USER = """
from multibody import Component, Output, Parameter, Translation


def law(x, k):
    return k * x


class Cushion(Component):
    k = Parameter(3.0, "N/m", "stiffness")
    flange = Translation("end")
    y = Output("N", "force")

    def equations(self):
        self.y = law(self.flange.position, self.k)
        self.flange.force = -self.y
"""


def test_user_file_moves_with_the_model_and_is_needed(tmp_path):
    """Written in one process beside its file; read in another, from another folder; refused without the
    file.
    """
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "cushions.py").write_text(USER)
    write = """
        import sys
        sys.path.insert(0, "one")
        from cushions import Cushion
        from multibody import Model
        from multibody.library import Mass
        model = Model("m")
        body, part = model.add("body", Mass(m=2.0)), model.add("part", Cushion(k=5.0))
        model.connect(part.flange, body.flange)
        model.save("one/model.json")
        print(model.build(compiled=False).texts["rhs"])
    """
    read = """
        from multibody import Model
        print(Model.load("two/model.json").build(compiled=False).texts["rhs"])
    """
    texts = []
    for code in (write, read):
        if code is read:
            (tmp_path / "one").rename(tmp_path / "two")
        done = subprocess.run(
            [sys.executable, "-c", textwrap.dedent(code)], cwd=tmp_path, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        texts.append(done.stdout)
    assert texts[0] == texts[1]
    content = json.loads((tmp_path / "two" / "model.json").read_text())
    assert content["components"]["part"]["class"] == "cushions.py:Cushion"
    (tmp_path / "two" / "cushions.py").unlink()
    with pytest.raises(ModelError, match=r"cushions\.py' is needed for its component classes and does not exist"):
        Model.load(tmp_path / "two" / "model.json")


def test_classes_that_cannot_be_found_again_are_not_saved(tmp_path):
    class Local(Component):
        pass

    model = Model("m")
    model.add("part", Local())
    model.add("heavy", Mass(m=-1.0))
    with pytest.raises(ModelError) as caught:
        model.save(tmp_path / "m.json")
    assert "move it there to save the model" in caught.value.faults[0]
    assert "below its least value" in caught.value.faults[1]
    assert not list(tmp_path.iterdir())


def good() -> dict:
    return {
        "schema": 1,
        "name": "m",
        "components": {
            "body": {"class": "multibody.library:Mass", "values": {"m": 1.0}},
            "spring": {"class": "multibody.library:Spring", "values": {"stiffness": 2.0}},
            "push": {"class": "multibody.library:ForceSource"},
        },
        "connections": [["spring.a", "ground"], ["spring.b", "body.flange", "push.flange"]],
        "inputs": [{"name": "force", "targets": ["push.force"]}],
        "outputs": {"x": "body.position"},
    }


def test_a_file_written_by_hand(tmp_path):
    path = tmp_path / "m.json"
    path.write_text(json.dumps(good()))
    system = Model.load(path).build(compiled=False)
    assert system.rhs(0.0, np.array([1.0, 0.0]), np.array([3.0])) == pytest.approx([0.0, 1.0])


def changed(*path, to=None, drop=False):
    def apply(content):
        inner = content
        for key in path[:-1]:
            inner = inner[key]
        if drop:
            del inner[path[-1]]
        else:
            inner[path[-1]] = to
        return content

    return apply


BROKEN = {
    "no schema": (changed("schema", drop=True), "not a model file: it has no entry 'schema'"),
    "newer schema": (changed("schema", to=2), "has schema 2, this version reads 1: update the package"),
    "odd schema": (changed("schema", to="1"), "has schema '1'"),
    "no components": (changed("components", drop=True), "the entry 'components' is missing"),
    "components as list": (changed("components", to=[]), "'components' has to be a dict, it is a list"),
    "name is a number": (changed("name", to=1), "'name' has to be a str"),
    "unknown entry": (
        changed("conections", to=[]),
        "unknown entry 'conections'; did you mean 'connections'?",
    ),
    "component without class": (
        changed("components", "body", to={}),
        "component 'body': give an object with 'class'",
    ),
    "component is text": (
        changed("components", "body", to="Mass"),
        "component 'body': give an object with 'class'",
    ),
    "class without module": (
        changed("components", "body", "class", to="Mass"),
        '"module:Class" or "file.py:Class"',
    ),
    "module with an odd name": (
        changed("components", "body", "class", to="os;x:Mass"),
        "neither the name of a module",
    ),
    "module that is not there": (
        changed("components", "body", "class", to="multibody.nowhere:M"),
        "cannot be imported",
    ),
    "class that is not there": (
        changed("components", "body", "class", to="multibody.library:Spri"),
        "'Spri'; did you mean 'Spring'?",
    ),
    "not a component class": (
        changed("components", "body", "class", to="pathlib:Path"),
        "no component class 'Path'",
    ),
    "a function": (changed("components", "body", "class", to="os:system"), "no component class 'system'"),
    "file that is not there": (
        changed("components", "body", "class", to="gone.py:Mass"),
        "does not exist: restore it",
    ),
    "unknown part": (
        changed("components", "body", "value", to={}),
        "unknown entry 'value'; did you mean 'values'?",
    ),
    "values as list": (changed("components", "body", "values", to=[1.0]), "'values' has to be an object"),
    "value as text": (
        changed("components", "body", "values", "m", to="2 kg"),
        "'m' has to be a number in SI",
    ),
    "value true": (changed("components", "body", "values", "m", to=True), "'m' has to be a number in SI"),
    "value out of bounds": (changed("components", "body", "values", "m", to=-1.0), "below its least value"),
    "unknown value": (
        changed("components", "body", "values", "mass", to=1.0),
        "Mass has no parameter 'mass'",
    ),
    "missing value": (
        changed("components", "spring", "values", drop=True),
        "'stiffness' (force per length, N/m) is required",
    ),
    "wrong option": (changed("components", "body", "options", to={"free": 3}), "option 'free' is 3"),
    "wrong table": (changed("components", "body", "tables", to={"c": [1, 2]}), "table 'c' has to be"),
    "connection as text": (
        changed("connections", 0, to="spring.a"),
        "connection 0 has to be a list of endpoints",
    ),
    "connection of numbers": (changed("connections", 1, to=[1, 2]), "connection 1 has to be a list"),
    "input without name": (
        changed("inputs", 0, to={"targets": []}),
        "input 0 has to be an object with 'name'",
    ),
    "input without targets": (changed("inputs", 0, "targets", drop=True), "'targets' has to be a list"),
    "input with odd entry": (
        changed("inputs", 0, "dealy", to=1.0),
        "unknown entry 'dealy'; did you mean 'delay'?",
    ),
    "input with odd default": (changed("inputs", 0, "default", to="1"), "'default' has to be a number in SI"),
    "output that is a number": (changed("outputs", "x", to=3), "output 'x' has to name a quantity"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_broken_file(case, tmp_path):
    change, words = BROKEN[case]
    path = tmp_path / "m.json"
    path.write_text(json.dumps(change(good())))
    with pytest.raises(ModelError) as caught:
        Model.load(path)
    assert words in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "not JSON: Expecting property name enclosed in double quotes at line 1, column 2"),
        ("", "not JSON"),
        ("[1, 2]", "not a model file"),
        ('{"schema": 1, "schema": 1}', "'schema' appears twice"),
        ('{"schema": NaN}', "NaN is not a number that a model can have"),
        ("\xff\xfe", "not UTF-8 text"),
    ],
)
def test_file_that_is_no_model(text, words, tmp_path):
    path = tmp_path / "m.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(ModelError) as caught:
        Model.load(path)
    assert words in str(caught.value)


def test_user_file_that_fails(tmp_path):
    (tmp_path / "bad.py").write_text("1 / 0\n")
    content = changed("components", "body", "class", to="bad.py:Mass")(good())
    (tmp_path / "m.json").write_text(json.dumps(content))
    with pytest.raises(ModelError, match=r"running '.*bad\.py' failed: ZeroDivisionError"):
        Model.load(tmp_path / "m.json")


def test_all_faults_of_a_file_at_once(tmp_path):
    content = good()
    for change in (
        BROKEN[k][0] for k in ("value true", "missing value", "connection as text", "input with odd default")
    ):
        content = change(content)
    (tmp_path / "m.json").write_text(json.dumps(content))
    with pytest.raises(ModelError) as caught:
        Model.load(tmp_path / "m.json")
    assert len(caught.value.faults) == 4


def test_describe_names_everything():
    text = machine().describe()
    for words in (
        "axis.body",
        "Spring",
        "stiffness  33333.3  N/m",
        "3 points",
        "spring.a – damper.a – ground",
        "force → push.force",
        "tension = spring.tension",
    ):
        assert " ".join(words.split()) in " ".join(text.split())


def test_places_are_known_before_building():
    places = machine().places()
    assert [p.name for p in places] == [p.name for p in machine().build(compiled=False).places]
    assert "spring" in [p.name for p in places]
    with pytest.raises(ModelError, match="no components"):
        Model("m").places()


def test_an_effect_leaves_the_names_of_the_places_as_they_are():
    from discrepancy.effects.effect import Effect
    from discrepancy.rigs.axis import axis_case

    model = axis_case(1).problem(seed=1).model
    before = {p.name: (p.first_port, p.second_port) for p in model.places()}
    for name in before:
        place = next(p for p in model.places() if p.name == name)
        once = Effect.at_place("coulomb_friction", place).added_to(model)
        twice = Effect.at_place("coulomb_friction", place, number=2).added_to(once)
        assert {p.name: (p.first_port, p.second_port) for p in twice.places()} == before
